"""The hooks that a plug-in may implement, all of them; the built-in features use the same ones."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import pluggy

if TYPE_CHECKING:
    import typer

    from taichisoft.session import Session
    from taichisoft.simulation import StepReport

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


@hookspec
def taichisoft_run_begins(session: "Session") -> None:
    """A run is about to make its first step: the controller has been reset, and the outputs have begun."""


@hookspec
def taichisoft_step_done(session: "Session", report: "StepReport") -> None:
    """A step is done, and every output has recorded it."""


@hookspec
def taichisoft_run_ends(session: "Session", outcome: str) -> None:
    """A run has ended, however it did: "completed", "interrupted", or the text of the error. The outputs have ended."""


@hookspec
def taichisoft_picture_wanted(session: "Session") -> None:
    """Somebody asks for a picture of the present state: between two steps, also while the run is paused."""
