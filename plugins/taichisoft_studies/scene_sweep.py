"""`taichisoft study sweep`: a scene with many values of its keys."""

import shutil
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from taichisoft import Scene
from taichisoft.base import extra, require
from taichisoft.errors import GoalMissed, MeshError
from taichisoft_studies import study_options
from taichisoft_studies.errors import StudyError
from taichisoft_studies.run_folder import RunJob, finished, make_job, read_record, record_loss
from taichisoft_studies.study_file import MOST, Study, Sweep, combinations, scene_with, value_from
from taichisoft_studies.worker_task import do_run
from taichisoft_studies.workers import LOST, Workers

# Sweeps: the jobs of a study, and the loop that has the missing ones made.

RUNS = "runs"
UNSURE = ("timeout", "process lost", LOST)
"""Statuses that depend on the machine: `--again` repeats such runs."""


def fixed_overrides(study: Study) -> dict[str, Any]:
    """The values that all runs of a study have, by key.

    Raises:
        StudyError: one of `set` does not look like "key=value".
    """
    values: dict[str, Any] = {}
    for text in study.set:
        key, separator, given = text.partition("=")
        if not separator or not key.strip():
            raise StudyError(f"set = {text!r}: must look like contact.friction=0.3")
        values[key.strip()] = value_from(given)
    return values


def job_for(study: Study, parameters: Mapping[str, Any], folder: Path, seed: int, **others: Any) -> RunJob:
    """The job of one run of a study, with these values.

    Raises:
        SceneError, StudyError: a key or value is not valid; it is named.
    """
    scene = scene_with(study.scene, {**fixed_overrides(study), **parameters}, study.controller)
    outputs = tuple(dict.fromkeys(("metrics", *study.outputs)))
    return make_job(
        scene,
        folder / RUNS,
        source=study.scene,
        parameters=dict(parameters),
        duration=study.duration,
        outputs=tuple(sorted(outputs, key=lambda name: name != "recording")),  # others may need it before them
        plugins=tuple(study.plugins),
        seed=seed,
        time_limit=study.time_limit,
        **others,
    )


def sweep_jobs(study: Sweep, folder: Path) -> list[RunJob]:
    """The jobs of a sweep in their order; two that are the same run are there once.

    Raises:
        SceneError, StudyError, MeshError: a key or value is not valid.
    """
    chosen = combinations(study.vary, study.sample, study.seed)
    if len(chosen) * study.repeats > MOST:
        raise StudyError(f"repeats = {study.repeats}: {len(chosen) * study.repeats} runs are more than {MOST}")
    jobs = [job_for(study, values, folder, study.seed + repeat) for values in chosen for repeat in range(study.repeats)]
    check_geometries(jobs)
    return list({job.name: job for job in jobs}.values())


def check_geometries(jobs: Sequence[RunJob]) -> None:
    """Refuse a study of which no run has a geometry that can be made, such as one with a misspelt dimension.

    Raises:
        MeshError: as of the first run.
    """
    from taichisoft.scene import scene_from_toml
    from taichisoft_meshing.geometry_file import is_geometry, make_geometry, read_tables
    from taichisoft_meshing.mesh_command import merge_tables

    first: MeshError | None = None
    for job in jobs:
        scene: Scene = scene_from_toml(job.scene, job.source)
        try:
            for body in scene.soft_bodies.values():
                file = Path(body.mesh.file)
                if is_geometry(body.mesh.file):
                    kind, tables = read_tables(file)
                    make_geometry(kind, merge_tables(tables, body.mesh.request.get("set", {})), file)
            return
        except MeshError as error:
            first = first or error
    if first is not None:
        raise first


def make_missing(
    jobs: Sequence[RunJob], workers: Workers, done: Callable[[RunJob, Mapping[str, Any]], None]
) -> list[dict[str, Any]]:
    """Have every job made that has not ended yet; the records come in the order of the jobs.

    Args:
        jobs: all runs; the records of ended runs are only read.
        workers: make the runs.
        done: called with each job that was made, and its record, as they end.

    Raises:
        StudyError: a record cannot be written, or the workers are gone.
    """
    records = {job.name: finished(job) for job in jobs}
    by_name = {job.name: job for job in jobs}
    missing = [job for job in jobs if records[job.name] is None]
    for job in missing:
        workers.submit(job.name, do_run, job.to_json())
    for _ in missing:
        name, record = workers.next_done()
        records[name] = checked_record(by_name[name], record)
        done(by_name[name], records[name] or {})
    return [record for record in records.values() if record is not None]


def checked_record(job: RunJob, record: dict[str, Any] | None) -> dict[str, Any]:
    """What a worker answered, or the record of a run whose workers were lost.

    Raises:
        StudyError: no record could be written.
    """
    if record is None:
        return record_loss(job, LOST, "its workers were killed, one after the other")
    if "error" in record:
        raise StudyError(f"run {job.name}: {record['error']}")
    return record


def forget_unsure(jobs: Sequence[RunJob]) -> None:
    """Remove runs that failed for a reason that another try may not meet."""
    for job in jobs:
        record = read_record(job.place)
        if record is not None and record["status"] in UNSURE:
            shutil.rmtree(job.place, ignore_errors=True)


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
    from taichisoft_studies.study_file import Sweep, check_study, find_study, read_tables, varied

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

    from taichisoft.base import atomic_file, named_os_errors

    with named_os_errors(f"--output {output}", StudyError):
        output.mkdir(parents=True, exist_ok=True)
    with atomic_file(output / STUDY, StudyError) as partial:
        partial.write_text(tomli_w.dumps(_without_none(tables)), encoding="utf-8")


def _without_none(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _without_none(one) for key, one in value.items() if one is not None}
    return value
