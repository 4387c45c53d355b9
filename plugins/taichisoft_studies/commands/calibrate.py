"""`taichisoft study calibrate`: parameters whose runs repeat what was measured."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from taichisoft.optional_packages import extra, require
from taichisoft_studies.commands import study_options
from taichisoft_studies.errors import StudyError

FIT, PICTURE = "fit.json", "fit.png"


def calibrate(
    study: Annotated[str, typer.Argument(help="Study file (.toml), or the name of a shipped one.")],
    output: study_options.Output,
    data: Annotated[
        list[Path] | None,
        typer.Option("--data", help="Measured data (CSV), one for each experiment that names none (repeatable)."),
    ] = None,
    jobs: study_options.Jobs = None,
    scheduler: study_options.Scheduler = None,
    dashboard: study_options.Dashboard = None,
) -> None:
    """Fit parameters to measured curves, with an interval of confidence and a plot of the data over the fit."""
    require("taichisoft study calibrate", "distributed", install=extra("studies"))
    from rich.console import Console

    from taichisoft.atomic_file import atomic_file
    from taichisoft.running import print_line, print_warning
    from taichisoft_studies.calibration_file import Calibration, read_measurement
    from taichisoft_studies.least_squares import calibrate as fit_parameters
    from taichisoft_studies.least_squares import complaints, misfits, statics
    from taichisoft_studies.study_file import check_study, find_study, read_tables

    path = find_study(study)
    tables: dict[str, Any] = read_tables(path)
    study_options.add_cluster(tables, jobs, scheduler, dashboard)
    study_options.add_plugins(tables)
    asked = check_study(Calibration, tables, str(path))
    study_options.load_plugins(asked)
    files = _files(asked, path, data or [])
    measured = [
        read_measurement(experiment, file, f"{path}: experiments.{index}")
        for index, (experiment, file) in enumerate(zip(asked.experiments, files, strict=True))
    ]
    console = Console()
    for index in range(len(measured)):
        if said := statics(asked, index)[1]:
            print_line(console, said)

    def tried(values: Mapping[str, float], cost: float) -> None:
        said = ", ".join(f"{key} = {value:.6g}" for key, value in values.items())
        print_line(console, f"{said}: cost {cost:.6g}")

    most = len(measured) * 2 * len(asked.parameters)
    with study_options.announced_workers(console, asked.cluster, most, output) as workers:
        fit = fit_parameters(asked, measured, output, workers, tried)
    for key, value in fit.values.items():
        low, high = fit.intervals[key]
        print_line(console, f"{key} = {value:.6g} (95 %: {low:.6g} to {high:.6g})")
    for file, residuals in zip(files, fit.residuals, strict=True):
        print_line(console, f"{file.name}: residual {', '.join(f'{one:.4g}' for one in residuals)}")
    for complaint in complaints(asked, fit, output):
        print_warning(console, complaint)
    for hint in misfits(asked, measured, fit):
        print_line(console, f"{hint}; look at {PICTURE}")
    found = {
        "parameters": {key: {"value": value, "interval_95": fit.intervals[key]} for key, value in fit.values.items()},
        "residuals": {str(file): residuals for file, residuals in zip(files, fit.residuals, strict=True)},
        "correlation_of_residuals": fit.correlation,
        "evaluations": fit.evaluations,
    }
    with atomic_file(output / FIT, StudyError) as partial:
        partial.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")
    _draw(asked, measured, fit, files, output / PICTURE)
    print_line(console, f"fit in {output / FIT}, data over fit in {output / PICTURE}")


def _files(study: Any, path: Path, data: Sequence[Path]) -> list[Path]:
    """The file of each experiment: its own, or the next one of --data.

    Raises:
        StudyError: there are too few or too many.
    """
    missing = sum(experiment.data is None for experiment in study.experiments)
    if len(data) != missing:
        raise StudyError(f"--data: {len(data)} given; {path} has {missing} experiments without data of their own")
    waiting = iter(data)
    return [next(waiting) if one.data is None else path.parent / one.data for one in study.experiments]


def _draw(study: Any, measured: Any, fit: Any, files: Sequence[Path], path: Path) -> None:
    """Draw every curve: the data as dots, the fit as a line."""
    from matplotlib.figure import Figure

    from taichisoft.atomic_file import atomic_file
    from taichisoft_outputs.plots.figure import figure_bytes

    count = sum(len(experiment.curves) for experiment in study.experiments)
    figure = Figure(figsize=(6.0, 2.6 * count), layout="constrained")
    waiting = iter(figure.subplots(count, 1, squeeze=False)[:, 0])
    for experiment, one, modelled, file in zip(study.experiments, measured, fit.modelled, files, strict=True):
        for curve, values, line in zip(experiment.curves, one.curves, modelled, strict=True):
            axes = next(waiting)
            axes.plot(one.over, values, ".", markersize=3, color="#999999", label=file.name)
            axes.plot(one.over, line, color="#d55e00", linewidth=1.2, label="fit")
            axes.set_xlabel(experiment.over_column, parse_math=False)
            axes.set_ylabel(curve.column[:40], parse_math=False)
            axes.grid(alpha=0.3)
            axes.legend(frameon=False, fontsize=8)
    with atomic_file(path, StudyError) as partial:
        partial.write_bytes(figure_bytes(figure, "png"))
