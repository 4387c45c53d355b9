"""Reduced models of soft bodies: training, basis, cubature and validation."""

from typing import TYPE_CHECKING

from taichisoft.plugin_system import hookimpl

if TYPE_CHECKING:
    import typer


@hookimpl
def taichisoft_commands(application: "typer.Typer") -> None:
    """Add `taichisoft reduce`."""
    from taichisoft_reduction.reduce_command import reduce

    application.command()(reduce)
