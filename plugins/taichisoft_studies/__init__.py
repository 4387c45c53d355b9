"""Studies of many runs: sweeps, comparisons, optimisation and calibration, through Dask and Optuna."""

from typing import TYPE_CHECKING

from taichisoft.plugin_system.hookspecs import hookimpl

if TYPE_CHECKING:
    import typer


@hookimpl
def taichisoft_commands(application: "typer.Typer") -> None:
    """Add `taichisoft sweep`, `mesh-sweep`, `optimise`, `calibrate`, `compare` and `study`."""
    from taichisoft_studies.commands.calibrate import calibrate
    from taichisoft_studies.commands.compare import compare
    from taichisoft_studies.commands.mesh_sweep import mesh_sweep
    from taichisoft_studies.commands.optimise import optimise
    from taichisoft_studies.commands.report import study
    from taichisoft_studies.commands.sweep import sweep

    application.command("sweep")(sweep)
    application.command("mesh-sweep")(mesh_sweep)
    application.command("optimise")(optimise)
    application.command("calibrate")(calibrate)
    application.command("compare")(compare)
    application.add_typer(study, name="study")
