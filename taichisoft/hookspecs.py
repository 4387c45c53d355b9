"""The hooks that a plug-in may implement, all of them; the built-in features use the same ones."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import pluggy

if TYPE_CHECKING:
    import typer

PROJECT = "taichisoft"
hookspec = pluggy.HookspecMarker(PROJECT)
hookimpl = pluggy.HookimplMarker(PROJECT)


@hookspec
def taichisoft_controllers() -> Mapping[str, Callable[..., Any]]:  # type: ignore[empty-body]
    """Controllers by name, asked for when a run starts: each value makes a `taichisoft.controller.Controller`."""


@hookspec
def taichisoft_outputs() -> Mapping[str, Callable[..., Any]]:  # type: ignore[empty-body]
    """Outputs by name, asked for when a run starts: each value makes a `taichisoft.output.Output`."""


@hookspec
def taichisoft_commands(application: "typer.Typer") -> None:
    """Add sub-commands to the `taichisoft` command line; called once when it starts."""
