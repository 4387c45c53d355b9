"""`taichisoft study sweep`: a scene with many values of its keys."""

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from taichisoft.errors import GoalMissed
from taichisoft.optional_packages import extra, require
from taichisoft_studies.commands import study_options
from taichisoft_studies.errors import StudyError

STUDY = "study.toml"


def sweep(
    study: Annotated[
        str, typer.Argument(help="Study file (.toml), or a scene's file or name with --vary.", metavar="STUDY|SCENE")
    ],
    output: study_options.Output,
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
    jobs: study_options.Jobs = None,
    scheduler: study_options.Scheduler = None,
    dashboard: study_options.Dashboard = None,
    again: Annotated[
        bool, typer.Option("--again", help="Repeat runs that timed out, or whose process or workers were lost.")
    ] = False,
) -> None:
    """Run a scene with many values of its keys; what has ended is not done again, and one that fails stops no other."""
    require("taichisoft study sweep", "distributed", "pandas", "pyarrow", install=extra("studies"))
    from rich.console import Console

    from taichisoft.running import print_line
    from taichisoft_studies.results_table import result_row, write_table
    from taichisoft_studies.run_folder import COMPLETED, ERROR, finished, read_record
    from taichisoft_studies.study_file import Sweep, check_study, find_study, read_tables
    from taichisoft_studies.sweep_runs import RUNS, forget_unsure, make_missing, sweep_jobs
    from taichisoft_studies.varied_values import varied

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
    study_options.add_plugins(tables)
    study_options.add_cluster(tables, jobs, scheduler, dashboard)
    asked = check_study(Sweep, tables, source)
    study_options.load_plugins(asked)
    planned = sweep_jobs(asked, output)
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
            study_options.announced_workers(console, asked.cluster, len(planned) - ended, output) as workers,
            study_options.progress_bar(console, "runs", len(planned), ended) as count,
        ):

            def done(job: Any, record: Mapping[str, Any]) -> None:
                failed = record["status"] != COMPLETED
                count(f"{job.name}: {record['status']}: {record['message']}" if failed else "")

            records = make_missing(planned, workers, done)
    else:
        records = [one for job in planned if (one := finished(job)) is not None]
    written = write_table([result_row(one, f"{RUNS}/{one['run']}") for one in records], output)
    statuses = Counter(record["status"] for record in records)
    print_line(console, ", ".join(f"{count} {status}" for status, count in sorted(statuses.items())))
    print_line(console, f"results in {written}")
    failed = len(records) - statuses[COMPLETED]
    if failed:
        raise GoalMissed(f"{output}: {failed} of {len(records)} runs failed")


def _is_study(path: Path) -> bool:
    """Whether a file is a study, not a scene: it names a scene."""
    from taichisoft_studies.study_file import read_tables

    return path.is_file() and isinstance(read_tables(path).get("scene"), str)


def _sample(text: str) -> dict[str, Any]:
    """The table of an option "METHOD:COUNT".

    Raises:
        StudyError: the text has another form.
    """
    method, _, count = text.partition(":")
    if not count.isdecimal():
        raise StudyError(f"--sample {text}: must look like lhs:100")
    return {"method": method, "count": int(count)}


def _write_study(tables: Mapping[str, Any], output: Path) -> None:
    """Keep the study, with the options of the command line, beside its results."""
    import tomli_w

    from taichisoft.atomic_file import atomic_file, named_os_errors

    with named_os_errors(f"--output {output}", StudyError):
        output.mkdir(parents=True, exist_ok=True)
    with atomic_file(output / STUDY, StudyError) as partial:
        partial.write_text(tomli_w.dumps(_without_none(tables)), encoding="utf-8")


def _without_none(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _without_none(one) for key, one in value.items() if one is not None}
    return value
