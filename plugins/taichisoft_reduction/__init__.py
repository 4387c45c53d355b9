"""Reduced models of soft bodies: training, basis, cubature and validation."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from taichisoft.running import Imported, hookimpl

if TYPE_CHECKING:
    import typer

    from taichisoft.running import RunOption


@hookimpl
def taichisoft_commands(application: "typer.Typer") -> None:
    """Add `taichisoft reduce`."""
    from taichisoft_reduction.reduce_command import reduce

    application.command()(reduce)


@hookimpl
def taichisoft_outputs() -> Mapping[str, Callable[..., Any]]:
    """The output that compares a reduced model with the full one."""
    return Imported(__name__, {"reduced-check": "reduced_check:ReducedCheckOutput"})


@hookimpl
def taichisoft_run_options() -> "Mapping[str, RunOption]":
    """Options of `taichisoft run` that bring it."""
    from taichisoft.running import RunOption

    return {
        "--reduced-check": RunOption(
            "reduced-check", "Run the full model beside reduced bodies, and say where they part."
        ),
        "--check-tolerance": RunOption(
            "reduced-check", "The same, to within PERCENT of the largest change.", "tolerance", str, "PERCENT"
        ),
    }
