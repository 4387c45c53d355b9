"""The commands `taichisoft study`: sweep, optimise, calibrate, compare and report, with the options that they share."""

import csv
import json
import sys
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from taichisoft.base import extra, printable, require, say
from taichisoft.errors import GoalMissed
from taichisoft_studies.errors import StudyError

if TYPE_CHECKING:
    from rich.console import Console

    from taichisoft_studies.study_file import AnyStudy, Cluster
    from taichisoft_studies.workers import Workers

# Options and progress of the commands of studies.

Jobs = Annotated[
    int | None,
    typer.Option("--jobs", "-j", metavar="N", help="Runs at a time on this machine; as many as CPUs otherwise."),
]
Scheduler = Annotated[
    str | None, typer.Option("--scheduler", metavar="tls://HOST:8786", help="A Dask scheduler whose workers are used.")
]
Output = Annotated[Path, typer.Option("--output", "-o", help="Folder of the study.")]


def requested_plugins(arguments: Sequence[str] | None = None) -> list[str]:
    """Absolute paths of the plug-ins that the command line names, for the processes that make the runs."""
    from taichisoft.running import FILE_OPTION

    paths: list[Path] = []
    waiting = iter(sys.argv[1:] if arguments is None else arguments)
    for argument in waiting:
        option, separator, value = argument.partition("=")
        if option == FILE_OPTION:
            paths.append(Path(value if separator else next(waiting, "")).expanduser().resolve())
    return list(dict.fromkeys(map(str, paths)))


def make_study(
    kind: "type[AnyStudy]", tables: dict[str, Any], source: str, jobs: int | None, scheduler: str | None
) -> "AnyStudy":
    """The study of tables, to which the options of the command line are added; its plug-ins are loaded here as well,
    since they provide keys."""
    from taichisoft.running import load_plugin
    from taichisoft_studies.study_file import check_study

    if jobs is not None and jobs < 1:
        raise StudyError(f"--jobs {jobs}: must be at least 1")
    cluster = {key: value for key, value in (("workers", jobs), ("scheduler", scheduler)) if value is not None}
    if cluster:
        tables["cluster"] = {**tables.get("cluster", {}), **cluster}
    if plugins := requested_plugins():
        tables["plugins"] = list(dict.fromkeys([*tables.get("plugins", []), *plugins]))
    study = check_study(kind, tables, source)
    for plugin in study.plugins:
        load_plugin(plugin)
    return study


@contextmanager
def announced_workers(console: "Console", cluster: "Cluster", tasks: int) -> "Iterator[Workers]":
    """The workers of a study, with a line about them."""
    from taichisoft.running import print_line, print_warning
    from taichisoft_studies import workers

    if caution := workers.caution(cluster):
        print_warning(console, caution)
    with workers.study_workers(cluster, tasks) as made:
        print_line(console, made.about)
        yield made


def print_statuses(console: "Console", statuses: Counter[str], table: Path) -> None:
    """Print the number of runs by status, and where their table is."""
    from taichisoft.running import print_line

    print_line(console, ", ".join(f"{count} {status}" for status, count in sorted(statuses.items())))
    print_line(console, f"results in {table}")


# `taichisoft study optimise`: the values that make a figure of a run largest or smallest.

CURVE = "optimisation.png"
SECONDS_BETWEEN_TABLES = 10.0
"""Time between two tables of the trials so far, which a killed search leaves."""


def optimise(
    study: Annotated[str, typer.Argument(help="Study file (.toml), or the name of a shipped one.")],
    output: Output,
    trials: Annotated[int | None, typer.Option(help="Number of runs, earlier ones included.")] = None,
    jobs: Jobs = None,
    scheduler: Scheduler = None,
) -> None:
    """Search for the best values of keys; started again, also on another machine, it continues the same study."""
    require("taichisoft study optimise", "optuna", "pandas", "pyarrow", install=extra("studies"))
    from rich.console import Console

    from taichisoft.running import print_line, progress_bar
    from taichisoft_studies.optimiser import Optimisation, counted, open_study, with_function_paths
    from taichisoft_studies.results_table import write_table
    from taichisoft_studies.shape_search import run_descent
    from taichisoft_studies.study_file import find_study, read_tables
    from taichisoft_studies.trials import (
        WINNERS,
        draw_winner,
        make_winners,
        run_trials,
        take_over_abandoned,
        take_over_errors,
        trial_rows,
        value_line,
    )

    path = find_study(study)
    tables: dict[str, Any] = with_function_paths(read_tables(path), path.parent)
    tables |= {"trials": trials} if trials is not None else {}
    search = make_study(Optimisation, tables, str(path), jobs, scheduler)
    console = Console()
    made = open_study(search, output)
    made.set_user_attr("folder", str(output.resolve()))
    for count, what in (
        (take_over_abandoned(made), "of a process that has ended"),
        (take_over_errors(made), "that ended with an error"),
    ):
        if count:
            print_line(console, f"{count} trials {what} are made again")
    with announced_workers(console, search.cluster, search.trials) as workers:
        with progress_bar(console, "trials", search.trials, begun=len(counted(made))) as advance:
            written = time.monotonic()

            def done(trial: Any, record: Mapping[str, Any]) -> None:
                nonlocal written
                values = made.trials[trial.number].values
                result = record["status"] if values is None else value_line(search.objectives, values)
                advance(f"trial {trial.number}: {result} {record['message']}".rstrip())
                if time.monotonic() > written + SECONDS_BETWEEN_TABLES:  # it reads every run
                    write_table(trial_rows(search, made), output)
                    written = time.monotonic()

            make_trials = run_descent if search.sampler == "gradient" else run_trials
            make_trials(search, output, made, workers, done)
        rows = trial_rows(search, made)
        table = write_table(rows, output)
        _draw_curve(made, [figure.label(name) for name, figure in search.objectives.items()], output)
        print_statuses(console, Counter(row["status"] for row in rows), table)
        with progress_bar(console, "runs of winners", search.winners * len(search.by_scene())) as advance:
            winners = make_winners(
                search, made, output, workers, lambda line: print_line(console, line), lambda *_: advance("")
            )
    for line in (f"winners in {output / WINNERS}", *draw_winner(winners[0], output / "winner")):
        print_line(console, line)


def _draw_curve(trials: Any, names: list[str], output: Path) -> None:
    """Draw the objective of every trial, and the best so far among the trials that satisfy all constraints."""
    import numpy as np
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator
    from optuna.study import StudyDirection

    from taichisoft.base import atomic_file
    from taichisoft_outputs.plots import figure_bytes
    from taichisoft_studies.optimiser import is_feasible

    ended = [trial for trial in trials.trials if trial.values is not None]
    if not ended:
        return
    feasible = np.array([is_feasible(trial) for trial in ended])
    numbers, values = np.array([trial.number for trial in ended]), np.array([trial.values for trial in ended])
    figure = Figure(figsize=(6.0, 2.8 * len(names)), layout="constrained")
    for index, axes in enumerate(figure.subplots(len(names), 1, squeeze=False)[:, 0]):
        value, within = values[:, index], values[feasible, index]
        better = np.maximum if trials.directions[index] == StudyDirection.MAXIMIZE else np.minimum
        axes.plot(numbers, value, ".", color="#999999", label="trials")
        axes.plot(numbers[feasible], within, ".", color="#0072b2", label="within the constraints")
        axes.step(numbers[feasible], better.accumulate(within), where="post", color="#d55e00", label="best so far")
        axes.set_xlabel("trial")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.set_ylabel(names[index], parse_math=False)
        axes.grid(alpha=0.3)
        axes.legend(frameon=False, fontsize=8)
    with atomic_file(output / CURVE, StudyError) as partial:
        partial.write_bytes(figure_bytes(figure, "png"))


# `taichisoft study calibrate`: parameters whose runs repeat what was measured.

FIT, FIT_PICTURE = "fit.json", "fit.png"


def calibrate(
    study: Annotated[str, typer.Argument(help="Study file (.toml), or the name of a shipped one.")],
    output: Output,
    data: Annotated[
        list[Path] | None,
        typer.Option("--data", help="Measured data (CSV), one for each experiment that names none (repeatable)."),
    ] = None,
    gradient: Annotated[
        bool, typer.Option("--gradient", help="Go down by gradients of the runs first, as method = 'gradient'.")
    ] = False,
    jobs: Jobs = None,
    scheduler: Scheduler = None,
) -> None:
    """Fit parameters to measured curves, with an interval of confidence and a plot of the data over the fit."""
    from rich.console import Console

    from taichisoft.base import atomic_file
    from taichisoft.running import print_line, print_warning, progress_bar
    from taichisoft_studies.least_squares import Calibration, complaints, misfits, read_measurement, statics
    from taichisoft_studies.least_squares import fit_parameters as fit_parameters
    from taichisoft_studies.study_file import find_study, read_tables

    path = find_study(study)
    tables = {**read_tables(path), **({"method": "gradient"} if gradient else {})}
    calibration = make_study(Calibration, tables, str(path), jobs, scheduler)
    files = _files(calibration, path, data or [])
    measured = [
        read_measurement(experiment, file, f"{path}: experiments.{index}")
        for index, (experiment, file) in enumerate(zip(calibration.experiments, files, strict=True))
    ]
    console = Console()
    for index in range(len(measured)):
        if message := statics(calibration, index)[1]:
            print_line(console, message)

    def tried(values: Mapping[str, float], cost: float) -> None:
        text = ", ".join(f"{key} = {value:.6g}" for key, value in values.items())
        print_line(console, f"{text}: cost {cost:.6g}")

    runs = sum(experiment.test is None for experiment in calibration.experiments)
    most = 2 * runs * len(calibration.parameters)
    with (
        announced_workers(console, calibration.cluster, most) as workers,
        progress_bar(console, "runs, at most", calibration.most_steps * (runs + most)) as made,
    ):
        fit = fit_parameters(calibration, measured, output, workers, tried, lambda job, record: made(""))
    for key, value in fit.values.items():
        low, high = fit.intervals[key]
        print_line(console, f"{key} = {value:.6g} (95 %: {low:.6g} to {high:.6g})")
    for file, residuals in zip(files, fit.residuals, strict=True):
        print_line(console, f"{file.name}: residual {', '.join(f'{residual:.4g}' for residual in residuals)}")
    for complaint in complaints(calibration, fit, output):
        print_warning(console, complaint)
    for hint in misfits(calibration, measured, fit):
        print_line(console, f"{hint}; look at {FIT_PICTURE}")
    result = {
        "parameters": {key: {"value": value, "interval_95": fit.intervals[key]} for key, value in fit.values.items()},
        "residuals": {str(file): residuals for file, residuals in zip(files, fit.residuals, strict=True)},
        "correlation_of_residuals": fit.correlation,
        "evaluations": fit.evaluations,
    }
    with atomic_file(output / FIT, StudyError) as partial:
        partial.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    _draw_fit(calibration, measured, fit, files, output / FIT_PICTURE)
    print_line(console, f"fit in {output / FIT}, data over fit in {output / FIT_PICTURE}")


def _files(study: Any, path: Path, data: Sequence[Path]) -> list[Path]:
    """The file of each experiment: its own, or the next one of --data."""
    missing = sum(experiment.data is None for experiment in study.experiments)
    if len(data) != missing:
        raise StudyError(f"--data: {len(data)} given; {path} has {missing} experiments without data of their own")
    waiting = iter(data)
    own = [experiment.data for experiment in study.experiments]
    return [next(waiting) if name is None else path.parent / name for name in own]


def _draw_fit(study: Any, measured: Any, fit: Any, files: Sequence[Path], path: Path) -> None:
    """Draw every curve: the data as dots, the fit as a line."""
    from matplotlib.figure import Figure

    from taichisoft.base import atomic_file
    from taichisoft_outputs.plots import figure_bytes

    count = sum(len(experiment.labels) for experiment in study.experiments)
    figure = Figure(figsize=(6.0, 2.6 * count), layout="constrained")
    waiting = iter(figure.subplots(count, 1, squeeze=False)[:, 0])
    for experiment, data, modelled, file in zip(study.experiments, measured, fit.modelled, files, strict=True):
        for label, values, line in zip(experiment.labels, data.curves, modelled, strict=True):
            axes = next(waiting)
            axes.plot(data.over, values, ".", markersize=3, color="#999999", label=file.name)
            axes.plot(data.over, line, color="#d55e00", linewidth=1.2, label="fit")
            axes.set_xlabel(experiment.over_label, parse_math=False)
            axes.set_ylabel(label, parse_math=False)
            axes.grid(alpha=0.3)
            axes.legend(frameon=False, fontsize=8)
    with atomic_file(path, StudyError) as partial:
        partial.write_bytes(figure_bytes(figure, "png"))


# `taichisoft study compare`: several runs in one picture, and the keys and metrics in which they differ.

TABLE, PICTURE = "comparison.csv", "comparison.png"


def compare(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="Folders of runs, or their recordings.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder of the picture and the table.")] = Path(
        "out/comparison"
    ),
    only: Annotated[str | None, typer.Option(metavar="NAMES", help="Panels, separated by commas.")] = None,
) -> None:
    """Plot several runs over each other, and list the keys and metrics in which they differ."""
    from rich.console import Console
    from rich.table import Table

    from taichisoft.base import atomic_file, plain
    from taichisoft.running import print_line
    from taichisoft_outputs.recording.layout import FILE_NAME
    from taichisoft_studies.run_comparison import differences, draw_comparison, labels, run_folder

    if len(runs) < 2:
        raise StudyError("study compare: needs two runs or more")
    folders = [run_folder(run) for run in runs]
    names = labels(folders)
    rows = differences(folders)
    with atomic_file(output / TABLE, StudyError) as partial:
        output.mkdir(parents=True, exist_ok=True)
        with partial.open("w", encoding="utf-8", newline="") as file:
            csv.writer(file).writerows([["key", *names], *([key, *values] for key, values in rows.items())])
    table = Table("")
    for name in names:
        table.add_column(plain(name))
    for key, values in rows.items():
        table.add_row(plain(key), *(plain(_short(value)) for value in values))
    console = Console()
    console.print(table)
    print_line(console, str(output / TABLE))
    unrecorded = [folder for folder in folders if not (folder / FILE_NAME).exists()]
    if unrecorded:
        print_line(console, f"no plots: {unrecorded[0]} has no recording (--record)")
        return
    panels = [name.strip() for name in only.split(",")] if only is not None else None
    picture = draw_comparison(folders, names, panels, "png")
    path = output / PICTURE
    with atomic_file(path, StudyError) as partial:
        partial.write_bytes(picture)
    print_line(console, str(path))


def _short(value: Any) -> str:
    if value is None:
        return "-"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


# `taichisoft study report`: one page about a study.

PAGE = "report.html"


def report(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Folder of the study.")],
    metric: Annotated[
        list[str] | None,
        typer.Option("--metric", help="A metric that the page is about; the first decides which runs are best."),
    ] = None,
    smallest: Annotated[bool, typer.Option("--smallest", help="The smallest value of it is best.")] = False,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="The page  \\[default: FOLDER/report.html]")
    ] = None,
) -> None:
    """Write one page: effect of each parameter, scatter, best runs with pictures, failures."""
    require("taichisoft study report", "pandas", "pyarrow", install=extra("studies"))
    from taichisoft.base import atomic_file
    from taichisoft_studies.results_table import read_table
    from taichisoft_studies.study_page import BEST, best_runs, figure_columns, study_page

    table = read_table(folder)
    figures = figure_columns(table, metric)
    if figures:
        for place in best_runs(table, figures[0], not smallest, BEST)["folder"]:
            _draw(folder / place)
    page = study_page(table, folder, metric, smallest)
    path = output or folder / PAGE
    with atomic_file(path, StudyError) as partial:
        path.parent.mkdir(parents=True, exist_ok=True)
        partial.write_text(page, encoding="utf-8")
    say(path)


def _draw(run: Path) -> Any:
    """Draw the last moment of a run that was recorded, unless it is drawn; where that cannot be done, say why."""
    from taichisoft.errors import TaichisoftError
    from taichisoft_outputs.recording.layout import FILE_NAME
    from taichisoft_outputs.recording.reader import read_recording
    from taichisoft_outputs.rendering.video import render_pictures
    from taichisoft_studies.study_page import PICTURES

    recording = run / FILE_NAME
    if not recording.is_file() or any((run / picture).is_file() for picture in PICTURES):
        return
    try:
        with read_recording(recording) as opened:
            last = float(opened.times[-1])
        render_pictures(recording, {"after": last}, run)
    except TaichisoftError as error:
        typer.echo(printable(f"no picture of {run}: {error}"), err=True)


# `taichisoft study sweep`: a scene with many values of its keys.

STUDY = "study.toml"


def sweep(
    study: Annotated[
        str, typer.Argument(help="Study file (.toml), or a scene's file or name with --vary.", metavar="STUDY|SCENE")
    ],
    output: Output,
    vary: Annotated[
        list[str] | None,
        typer.Option(
            "--vary",
            metavar="KEY=VALUES",
            help="A key of the scene, its controller or geometry, with its values: a,b,c or low:high:count.",
        ),
    ] = None,
    sample: Annotated[
        str | None,
        typer.Option(
            "--sample", metavar="METHOD:COUNT", help="Samples instead of all combinations: lhs, sobol, random."
        ),
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Start of the random numbers  \\[default: 1].")] = None,
    set_: Annotated[list[str] | None, typer.Option("--set", help="A value that all runs have (repeatable).")] = None,
    controller: Annotated[str | None, typer.Option(help="Name of a controller  \\[default: the scene's own].")] = None,
    duration: Annotated[float | None, typer.Option(help="Simulated time of each run \\[s].")] = None,
    record: Annotated[bool, typer.Option("--record", help="Record every run (recording.h5).")] = False,
    time_limit: Annotated[float | None, typer.Option(help="Longest time for one run \\[s].")] = None,
    jobs: Jobs = None,
    scheduler: Scheduler = None,
    again: Annotated[
        bool, typer.Option("--again", help="Repeat runs that timed out, or whose process or workers were lost.")
    ] = False,
) -> None:
    """Run a scene with many values of its keys; what has ended is not done again, and one that fails stops no other."""
    require("taichisoft study sweep", "pandas", "pyarrow", install=extra("studies"))
    from rich.console import Console

    from taichisoft.running import print_line, progress_bar
    from taichisoft_studies.results_table import result_row, write_table
    from taichisoft_studies.run_job import COMPLETED, ERROR, finished, read_record
    from taichisoft_studies.study_file import Sweep, find_study, read_tables, varied
    from taichisoft_studies.sweep_runs import RUNS, forget_unsure, make_missing, sweep_jobs

    console = Console()
    tables: dict[str, Any] = {"scene": study}
    source = "study sweep"
    if not vary or (study.endswith(".toml") and _is_study(Path(study))):
        path = find_study(study)
        tables, source = read_tables(path), str(path)
    tables["vary"] = {**tables.get("vary", {}), **varied(vary or ())}
    options = {"seed": seed, "controller": controller, "duration": duration, "time_limit": time_limit}
    tables |= {key: value for key, value in options.items() if value is not None}
    tables["set"] = [*tables.get("set", []), *(set_ or ())]
    if sample is not None:
        tables["sample"] = _sample(sample)
    if record:
        tables["outputs"] = list(dict.fromkeys([*tables.get("outputs", ["metrics"]), "recording"]))
    plan = make_study(Sweep, tables, source, jobs, scheduler)
    planned = sweep_jobs(plan, output)
    _write_study(tables, output)
    if again:
        forget_unsure(planned)
    ended = sum(finished(job) is not None for job in planned)
    failed_before = sum((read_record(job.place) or {}).get("status") == ERROR for job in planned)
    if ended:
        print_line(console, f"{ended} of {len(planned)} runs have ended before")
    if failed_before:
        print_line(console, f"{failed_before} runs that ended with an error are made again")
    if ended < len(planned):
        with (
            announced_workers(console, plan.cluster, len(planned) - ended) as workers,
            progress_bar(console, "runs", len(planned), begun=ended) as count,
        ):

            def done(job: Any, record: Mapping[str, Any]) -> None:
                failed = record["status"] != COMPLETED
                count(f"{job.name}: {record['status']}: {record['message']}" if failed else "")

            records = make_missing(planned, workers, done)
    else:
        records = [ended_run for job in planned if (ended_run := finished(job)) is not None]
    written = write_table([result_row(ended_run, f"{RUNS}/{ended_run['run']}") for ended_run in records], output)
    statuses = Counter(record["status"] for record in records)
    print_statuses(console, statuses, written)
    failed = len(records) - statuses[COMPLETED]
    if failed:
        raise GoalMissed(f"{output}: {failed} of {len(records)} runs failed")


def _is_study(path: Path) -> bool:
    """Whether a file is a study, not a scene: it names a scene."""
    from taichisoft_studies.study_file import read_tables

    return path.is_file() and isinstance(read_tables(path).get("scene"), str)


def _sample(text: str) -> dict[str, Any]:
    """The table of an option "METHOD:COUNT"."""
    method, _, count = text.partition(":")
    if not count.isdecimal():
        raise StudyError(f"--sample {text}: must look like lhs:100")
    return {"method": method, "count": int(count)}


def _write_study(tables: Mapping[str, Any], output: Path) -> None:
    """Keep the study, with the options of the command line, beside its results."""
    import tomli_w

    from taichisoft.base import atomic_file, named_os_errors

    with named_os_errors(f"--output {output}", StudyError):
        output.mkdir(parents=True, exist_ok=True)
    with atomic_file(output / STUDY, StudyError) as partial:
        partial.write_text(tomli_w.dumps(_without_none(tables)), encoding="utf-8")


def _without_none(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _without_none(item) for key, item in value.items() if item is not None}
    return value
