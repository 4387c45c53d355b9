"""`taichisoft sweep`: a scene with many values of its keys."""

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from taichisoft.errors import GoalMissed
from taichisoft_studies.commands import options
from taichisoft_studies.extras import StudyError, require
from taichisoft_studies.value_texts import varied

STUDY = "study.toml"


def sweep(
    study: Annotated[
        str, typer.Argument(help="Study file (.toml), or a scene's file or name with --vary.", metavar="STUDY|SCENE")
    ],
    output: options.Output,
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
    jobs: options.Jobs = None,
    scheduler: options.Scheduler = None,
    dashboard: options.Dashboard = None,
    again: Annotated[
        bool, typer.Option("--again", help="Make runs anew that timed out, or whose process or workers were lost.")
    ] = False,
) -> None:
    """Run a scene with many values of its keys; what has ended is not done again, and one that fails stops no other."""
    require("taichisoft sweep", "distributed", "pandas", "pyarrow")
    from rich.console import Console

    from taichisoft.running.messages import print_line
    from taichisoft_studies.results import result_row, write_table
    from taichisoft_studies.run_folder import COMPLETED, ERROR, finished, read_record
    from taichisoft_studies.study_file import Sweep, check_study, find_study, read_tables
    from taichisoft_studies.sweep import RUNS, forget_unsure, make_missing, sweep_jobs

    console = Console()
    tables: dict[str, Any]
    if vary and not (study.endswith(".toml") and _is_study(Path(study))):
        tables, source = {"scene": study, "vary": {}}, "sweep"
    else:
        path = find_study(study)
        tables, source = read_tables(path), str(path)
    _add_options(tables, vary, sample, seed, set_, controller, duration, record, time_limit)
    options.add_cluster(tables, jobs, scheduler, dashboard)
    asked = check_study(Sweep, tables, source)
    options.load_plugins(asked)
    planned = sweep_jobs(asked, output)
    _write_study(tables, output)
    if again:
        forget_unsure(planned)
    ended = sum(finished(job) is not None for job in planned)
    missing = len(planned) - ended
    if ended:
        console.print(f"{ended} of {len(planned)} runs have ended before", highlight=False)
    failed_before = sum((read_record(job.place) or {}).get("status") == ERROR for job in planned)
    if failed_before:
        console.print(f"{failed_before} runs that ended with an error are made again", highlight=False)

    if missing:
        with options.announced_workers(console, asked.cluster, missing, output) as workers:
            records = _make(console, planned, workers, ended, make_missing)
    else:
        records = [one for job in planned if (one := finished(job)) is not None]
    rows = [result_row(one, f"{RUNS}/{one['run']}") for one in records]
    written = write_table(rows, output)
    statuses = Counter(record["status"] for record in records)
    console.print(", ".join(f"{count} {status}" for status, count in sorted(statuses.items())), highlight=False)
    print_line(console, f"results in {written}")
    failed = len(records) - statuses[COMPLETED]
    if failed:
        raise GoalMissed(f"{output}: {failed} of {len(records)} runs failed")


def _make(console: Any, planned: Any, workers: Any, ended: int, make_missing: Any) -> list[dict[str, Any]]:
    """Make what is missing, with a bar and a line for each run that fails."""
    from taichisoft_studies.progress import progress_bar
    from taichisoft_studies.run_folder import COMPLETED

    with progress_bar(console, "runs", len(planned), ended) as count:

        def done(job: Any, record: Mapping[str, Any]) -> None:
            failed = record["status"] != COMPLETED
            count(f"{job.name}: {record['status']}: {record['message']}" if failed else "")

        records: list[dict[str, Any]] = make_missing(planned, workers, done)
    return records


def _is_study(path: Path) -> bool:
    """Whether a file is a study, not a scene: it names a scene."""
    from taichisoft_studies.study_file import read_tables

    return path.is_file() and isinstance(read_tables(path).get("scene"), str)


def _add_options(
    tables: dict[str, Any],
    vary: list[str] | None,
    sample: str | None,
    seed: int | None,
    set_: list[str] | None,
    controller: str | None,
    duration: float | None,
    record: bool,
    time_limit: float | None,
) -> None:
    """Put what the command line says into a study's tables."""
    if vary:
        tables["vary"] = {**tables.get("vary", {}), **varied(vary)}
    if sample is not None:
        method, _, count = sample.partition(":")
        if not count.isdecimal():
            raise StudyError(f"--sample {sample}: must look like lhs:100")
        tables["sample"] = {"method": method, "count": int(count)}
    said = {"seed": seed, "controller": controller, "duration": duration, "time_limit": time_limit}
    tables |= {key: value for key, value in said.items() if value is not None}
    if set_:
        tables["set"] = [*tables.get("set", []), *set_]
    if record:
        tables["outputs"] = list(dict.fromkeys([*tables.get("outputs", ["metrics"]), "recording"]))
    options.add_plugins(tables)


def _write_study(tables: Mapping[str, Any], output: Path) -> None:
    """Keep the study beside its results, with what the command line said."""
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
