"""Sweeps: the jobs of a study, and the loop that has the missing ones made."""

import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from taichisoft import Scene
from taichisoft.errors import MeshError
from taichisoft_studies.errors import StudyError
from taichisoft_studies.run_job import RunJob, finished, make_job, read_record
from taichisoft_studies.study_file import MOST, Study, Sweep, combinations, scene_with, value_from
from taichisoft_studies.workers import UNSURE, Workers

RUNS = "runs"


def fixed_overrides(study: Study) -> dict[str, Any]:
    """The values that all runs of a study have, by key."""
    values: dict[str, Any] = {}
    for text in study.set:
        key, separator, given = text.partition("=")
        if not separator or not key.strip():
            raise StudyError(f"set = {text!r}: must look like contact.friction=0.3")
        values[key.strip()] = value_from(given)
    return values


def job_for(study: Study, parameters: Mapping[str, Any], folder: Path, seed: int, **others: Any) -> RunJob:
    """The job of one run of a study, with these values."""
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
    """The jobs of a sweep in their order; two that are the same run are there once."""
    chosen = combinations(study.vary, study.sample, study.seed)
    if len(chosen) * study.repeats > MOST:
        raise StudyError(f"repeats = {study.repeats}: {len(chosen) * study.repeats} runs are more than {MOST}")
    jobs = [job_for(study, values, folder, study.seed + repeat) for values in chosen for repeat in range(study.repeats)]
    check_geometries(jobs)
    return list({job.name: job for job in jobs}.values())


def check_geometries(jobs: Sequence[RunJob]) -> None:
    """Refuse a study of which no run has a geometry that can be made, such as one with a misspelt dimension."""
    from taichisoft.scene import scene_from_toml
    from taichisoft_meshing.geometry_file import is_geometry, make_geometry, read_tables
    from taichisoft_meshing.mesh_job import merge_tables

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
    jobs: Sequence[RunJob], workers: Workers, done: Callable[[RunJob, Mapping[str, Any]], None] = lambda *_: None
) -> list[dict[str, Any]]:
    """Have every job made that has not ended yet; the records come in the order of the jobs.

    Args:
        jobs: all runs; the records of ended runs are only read.
        workers: make the runs.
        done: called with each job that was made, and its record, as they end.
    """
    records = {job.name: finished(job) for job in jobs}
    missing = {job.name: job for job in jobs if records[job.name] is None}
    for name, job in missing.items():
        workers.submit(name, job)
    for _ in missing:
        name, record = workers.next_done()
        records[name] = record
        done(missing[name], record)
    return [record for record in records.values() if record is not None]


def forget_unsure(jobs: Sequence[RunJob]) -> None:
    """Remove runs that failed for a reason that another try may not meet."""
    for job in jobs:
        record = read_record(job.place)
        if record is not None and record["status"] in UNSURE:
            shutil.rmtree(job.place, ignore_errors=True)
