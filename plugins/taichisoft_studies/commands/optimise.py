"""`taichisoft optimise`: the values that make a figure of a run largest or smallest."""

import csv
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from taichisoft_studies.commands import options
from taichisoft_studies.extras import StudyError, require

WINNERS, CURVE = "winners.csv", "optimisation.png"


def optimise(
    study: Annotated[str, typer.Argument(help="Study file (.toml), or the name of a shipped one.")],
    output: options.Output,
    trials: Annotated[int | None, typer.Option(help="Number of runs, earlier ones included.")] = None,
    jobs: options.Jobs = None,
    scheduler: options.Scheduler = None,
    dashboard: options.Dashboard = None,
) -> None:
    """Search for the best values of keys; started again, also on another machine, it goes on with the same study."""
    require("taichisoft optimise", "distributed", "optuna", "pandas", "pyarrow")
    from rich.console import Console

    from taichisoft.running.messages import print_line
    from taichisoft_studies.optimisation_file import Optimisation, with_function_paths
    from taichisoft_studies.optimise import optimise as search
    from taichisoft_studies.optimise import trial_rows
    from taichisoft_studies.optimiser import counted, open_study, take_over_abandoned, take_over_errors
    from taichisoft_studies.progress import progress_bar
    from taichisoft_studies.results import write_table
    from taichisoft_studies.study_file import check_study, find_study, read_tables

    path = find_study(study)
    tables: dict[str, Any] = with_function_paths(read_tables(path), path.parent)
    options.add_cluster(tables, jobs, scheduler, dashboard)
    options.add_plugins(tables)
    tables |= {"trials": trials} if trials is not None else {}
    asked = check_study(Optimisation, tables, str(path))
    options.load_plugins(asked)
    console = Console()
    made = open_study(asked, output)
    made.set_user_attr("folder", str(output.resolve()))
    taken = take_over_abandoned(made)
    if taken:
        console.print(f"{taken} trials of a process that is gone are made again", highlight=False)
    failed = take_over_errors(made)
    if failed:
        console.print(f"{failed} trials that ended with an error are made again", highlight=False)
    names = list(asked.objectives)
    with options.announced_workers(console, asked.cluster, asked.trials, output) as workers:
        with progress_bar(console, "trials", asked.trials, len(counted(made))) as count:

            def done(trial: Any, record: Mapping[str, Any]) -> None:
                ended = made.trials[trial.number]
                said = record["status"] if ended.values is None else _values(names, ended.values)
                count(f"trial {trial.number}: {said} {record['message']}".rstrip())

            search(asked, output, made, workers, done)
        rows = trial_rows(asked, made)
        written = write_table(rows, output)
        _draw_curve(made, names, output)
        statuses = Counter(row["status"] for row in rows)
        console.print(", ".join(f"{count} {status}" for status, count in sorted(statuses.items())), highlight=False)
        print_line(console, f"results in {written}")
        _make_winners(console, asked, made, output, workers)


def _values(names: list[str], values: Any) -> str:
    return ", ".join(f"{name} {value:.6g}" for name, value in zip(names, values, strict=True))


def _make_winners(console: Any, study: Any, trials: Any, output: Path, workers: Any) -> None:
    """Run the best trials again as `finer` wants, and write what came out beside what the search saw."""
    from taichisoft.atomic_file import atomic_file
    from taichisoft.running.messages import print_line
    from taichisoft_studies.objectives import figures
    from taichisoft_studies.optimise import accepted, winner_job
    from taichisoft_studies.optimiser import best_trials
    from taichisoft_studies.run_folder import read_record
    from taichisoft_studies.sweep import RUNS, make_missing
    from taichisoft_studies.winner_parts import write_winner

    best = best_trials(trials, study.winners)
    if not best:
        raise StudyError(f"{output}: no trial has completed and satisfies all constraints; results.csv says why")
    jobs = []
    for trial in best:
        record = read_record(output / RUNS / trial.user_attrs["run"])
        assert record is not None
        jobs.append(winner_job(study, output, record["parameters"]))
    unique = {job.name: job for job in jobs}
    records = {one["run"]: one for one in make_missing(list(unique.values()), workers, lambda job, record: None)}
    wanted = figures(study)
    header = ["trial", *study.variables, *wanted, *(f"{name} finer" for name in wanted), "status", "folder"]
    rows = []
    for trial, job in zip(best, jobs, strict=True):
        record = records[job.name]
        counts = accepted(study, record)
        finer: list[Any] = [figure(record, job.place) for figure in wanted.values()] if counts else []
        cells = [*job.parameters.values(), *trial.values, *(finer or [""] * len(wanted))]
        rows.append([trial.number, *cells, record["status"], f"{RUNS}/{job.name}"])
        again = _values(list(wanted), finer) if finer else f"{record['status']}: {record['message']}"
        print_line(console, f"best: trial {trial.number}: {_values(list(wanted), trial.values)}; made again: {again}")
        for key, value in job.parameters.items():
            print_line(console, f"  {key} = {value}")
    with atomic_file(output / WINNERS, StudyError) as partial, partial.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows([header, *rows])
    print_line(console, f"winners in {output / WINNERS}")
    for line in write_winner(jobs[0], output / "winner"):
        print_line(console, line)


def _draw_curve(trials: Any, names: list[str], output: Path) -> None:
    """Draw the objective of every trial, and the best so far among those that satisfy all constraints."""
    from matplotlib.figure import Figure
    from optuna.study import StudyDirection

    from taichisoft.atomic_file import atomic_file
    from taichisoft_plugins.plots.figure import figure_bytes
    from taichisoft_studies.optimiser import VIOLATIONS

    ended = [trial for trial in trials.trials if trial.values is not None]
    if not ended:
        return
    figure = Figure(figsize=(6.0, 2.8 * len(names)), layout="constrained")
    grid = figure.subplots(len(names), 1, squeeze=False)
    for index, (axes, name) in enumerate(zip(grid[:, 0], names, strict=True)):
        feasible = [trial for trial in ended if all(v <= 0.0 for v in trial.user_attrs.get(VIOLATIONS, ()))]
        better = max if trials.directions[index] == StudyDirection.MAXIMIZE else min
        best = [better(trial.values[index] for trial in feasible[: end + 1]) for end in range(len(feasible))]
        axes.plot(
            [one.number for one in ended], [one.values[index] for one in ended], ".", color="#999999", label="trials"
        )
        axes.plot(
            [one.number for one in feasible],
            [one.values[index] for one in feasible],
            ".",
            color="#0072b2",
            label="within the constraints",
        )
        axes.step([one.number for one in feasible], best, where="post", color="#d55e00", label="best so far")
        axes.set_xlabel("trial")
        axes.set_ylabel(name, parse_math=False)
        axes.grid(alpha=0.3)
        axes.legend(frameon=False, fontsize=8)
    with atomic_file(output / CURVE, StudyError) as partial:
        partial.write_bytes(figure_bytes(figure, "png"))
