"""`taichisoft study optimise`: the values that make a figure of a run largest or smallest."""

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from taichisoft.optional_packages import extra, require
from taichisoft_studies.commands import study_options
from taichisoft_studies.errors import StudyError

CURVE = "optimisation.png"


def optimise(
    study: Annotated[str, typer.Argument(help="Study file (.toml), or the name of a shipped one.")],
    output: study_options.Output,
    trials: Annotated[int | None, typer.Option(help="Number of runs, earlier ones included.")] = None,
    jobs: study_options.Jobs = None,
    scheduler: study_options.Scheduler = None,
    dashboard: study_options.Dashboard = None,
) -> None:
    """Search for the best values of keys; started again, also on another machine, it continues the same study."""
    require("taichisoft study optimise", "distributed", "optuna", "pandas", "pyarrow", install=extra("studies"))
    from rich.console import Console

    from taichisoft.running import print_line
    from taichisoft_studies.optimisation_file import Optimisation, with_function_paths
    from taichisoft_studies.optimiser import counted, open_study, take_over_abandoned, take_over_errors
    from taichisoft_studies.results_table import write_table
    from taichisoft_studies.study_file import check_study, find_study, read_tables
    from taichisoft_studies.trials import optimise as search
    from taichisoft_studies.trials import trial_rows
    from taichisoft_studies.winners import WINNERS, draw_winner, make_winners, value_line

    path = find_study(study)
    tables: dict[str, Any] = with_function_paths(read_tables(path), path.parent)
    study_options.add_cluster(tables, jobs, scheduler, dashboard)
    study_options.add_plugins(tables)
    tables |= {"trials": trials} if trials is not None else {}
    asked = check_study(Optimisation, tables, str(path))
    study_options.load_plugins(asked)
    console = Console()
    made = open_study(asked, output)
    made.set_user_attr("folder", str(output.resolve()))
    for count, what in (
        (take_over_abandoned(made), "of a process that has ended"),
        (take_over_errors(made), "that ended with an error"),
    ):
        if count:
            print_line(console, f"{count} trials {what} are made again")
    with study_options.announced_workers(console, asked.cluster, asked.trials, output) as workers:
        with study_options.progress_bar(console, "trials", asked.trials, len(counted(made))) as advance:

            def done(trial: Any, record: Mapping[str, Any]) -> None:
                values = made.trials[trial.number].values
                result = record["status"] if values is None else value_line(asked.objectives, values)
                advance(f"trial {trial.number}: {result} {record['message']}".rstrip())

            search(asked, output, made, workers, done)
        rows = trial_rows(asked, made)
        written = write_table(rows, output)
        names = [f"{name} [{one.unit}]" if one.unit else name for name, one in asked.objectives.items()]
        _draw_curve(made, names, output)
        statuses = Counter(row["status"] for row in rows)
        print_line(console, ", ".join(f"{count} {status}" for status, count in sorted(statuses.items())))
        print_line(console, f"results in {written}")
        winners = make_winners(asked, made, output, workers, lambda line: print_line(console, line))
    for line in (f"winners in {output / WINNERS}", *draw_winner(winners[0], output / "winner")):
        print_line(console, line)


def _draw_curve(trials: Any, names: list[str], output: Path) -> None:
    """Draw the objective of every trial, and the best so far among the trials that satisfy all constraints."""
    import numpy as np
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator
    from optuna.study import StudyDirection

    from taichisoft.atomic_file import atomic_file
    from taichisoft_outputs.plots.figure import figure_bytes
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
