"""The folder of a run: it appears when the run has ended, and `run.json` in it says how."""

import json
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from taichisoft.atomic_file import atomic_file, named_os_errors
from taichisoft_studies.errors import StudyError
from taichisoft_studies.run_job import RunJob
from taichisoft_studies.unfinished import abandoned, partial_folder, remove_abandoned

RECORD = "run.json"
LOG = "log.txt"
METRICS = "metrics.json"
COMPLETED, PRUNED, BEYOND_LAW, ERROR = "completed", "pruned", "beyond the law", "error"


def read_record(folder: Path) -> dict[str, Any] | None:
    """The content of `run.json` in a folder; None if it is missing or incomplete.

    Keys: "run", "parameters", "seed", "version", "outputs", "status" ("completed" or a reason such as "diverged"),
    "message" (one line, empty where it completed), "metrics",
    "warnings" (one line each).
    """
    try:
        record = json.loads((folder / RECORD).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return record if isinstance(record, dict) and "status" in record else None


def finished(job: RunJob) -> dict[str, Any] | None:
    """The record of a job that has ended with all outputs that it needs now, or None.

    A run that ended with an error counts as not made: the disk may have been full, or the fault may be gone by now.
    """
    record = read_record(job.place)
    if record is not None and record["status"] == PRUNED and job.pruning is None:  # now it is to go to its end
        return None
    if record is not None and record["status"] == ERROR:
        return None
    return record if record is not None and set(job.outputs) <= set(record.get("outputs", ())) else None


@contextmanager
def new_folder(job: RunJob) -> Iterator[Path]:
    """Give a folder to make a run in, which gets the run's name when its record has been written, or else vanishes.

    If another process was faster, its folder stays. A folder that lacks an output stays until it is replaced.

    Raises:
        StudyError: it cannot be written.
    """
    partial = partial_folder(Path(job.folder), job.name)
    try:
        with named_os_errors(partial, StudyError):
            shutil.rmtree(partial, ignore_errors=True)
            partial.mkdir(parents=True)
        yield partial
        with named_os_errors(job.place, StudyError):
            if (partial / RECORD).exists():
                _give_name(partial, job)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def write_record(
    job: RunJob, folder: Path, status: str, message: str, metrics: Mapping[str, Any], warnings: Sequence[str] = ()
) -> dict[str, Any]:
    """Write `run.json`, and return its content.

    Raises:
        StudyError: it cannot be written.
    """
    import taichisoft

    record = {
        "run": job.name,
        "parameters": dict(job.parameters),
        "seed": job.seed,
        "version": taichisoft.__version__,
        "outputs": list(job.outputs),
        "status": status,
        "message": message,
        "metrics": dict(metrics),
        "warnings": list(warnings),
    }
    with atomic_file(folder / RECORD, StudyError) as partial:
        partial.write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")
    return record


def record_loss(job: RunJob, status: str, message: str) -> dict[str, Any]:
    """Make the folder of a run whose process was ended from outside, with the log that it left.

    Raises:
        StudyError: it cannot be written.
    """
    attempts = abandoned(Path(job.folder), job.name, job.time_limit)
    logs = [attempt / LOG for attempt in attempts if (attempt / LOG).is_file()]
    with new_folder(job) as folder:
        for log in logs[:1]:
            shutil.copy(log, folder / LOG)
        record = write_record(job, folder, status, message, {})
    remove_partial(job)
    return record


def remove_partial(job: RunJob) -> None:
    """Remove what unfinished attempts at a run have left."""
    remove_abandoned(Path(job.folder), job.name, job.time_limit)


def _give_name(partial: Path, job: RunJob) -> None:
    if finished(job) is None:
        shutil.rmtree(job.place, ignore_errors=True)
    try:
        partial.rename(job.place)
    except OSError:
        if finished(job) is None:  # otherwise another process has made the same run
            raise
