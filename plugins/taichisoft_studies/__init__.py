"""Studies of many runs: sweeps, comparisons, optimisation and calibration, through Dask and Optuna."""

from typing import TYPE_CHECKING

from taichisoft.running import hookimpl

if TYPE_CHECKING:
    import typer


@hookimpl
def taichisoft_commands(application: "typer.Typer") -> None:
    """Add `taichisoft characterise`, `converge`, `study` and what is below it, `mesh sweep`, `new measured-case`."""
    import typer

    from taichisoft_studies.finger_commands import characterise, converge, measured_case, mesh_sweep
    from taichisoft_studies.study_commands import calibrate, compare, optimise, report, sweep

    study = typer.Typer(help="Study many runs: sweep, optimise, calibrate, compare, report.", no_args_is_help=True)
    for command in (sweep, optimise, calibrate, compare, report):
        study.command()(command)
    mesh = typer.Typer()
    mesh.command("sweep")(mesh_sweep)
    application.command()(characterise)
    application.command()(converge)
    application.add_typer(study, name="study")
    new = typer.Typer()
    new.command("measured-case")(measured_case)
    application.add_typer(mesh, name="mesh")
    application.add_typer(new, name="new")
