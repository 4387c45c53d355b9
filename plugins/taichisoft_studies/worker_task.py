"""What a Dask worker does for a study: it has the process beside it make a run, and notes how that ended."""

import signal
from typing import Any

from taichisoft.worker import WorkerLost, WorkerSlow
from taichisoft_studies.make_mesh import MeshRun, mesh_failure
from taichisoft_studies.run_child import child_with
from taichisoft_studies.run_folder import record_loss
from taichisoft_studies.run_job import RunJob
from taichisoft_studies.run_process import MESH, RUN

KILLS = 3
"""How often the process beside a worker may be killed in a run: it may have needed more memory than there is."""


def do_run(text: str) -> dict[str, Any]:
    """Make a run from its JSON; returns its record, or {"error": ...} where none could be written."""
    job = RunJob.from_json(text)
    try:
        return _ask(job, RUN, text)
    except WorkerSlow:
        return record_loss(job, "timeout", f"not done within {job.time_limit:g} s")
    except WorkerLost as lost:
        return record_loss(job, "process lost", str(lost))


def do_mesh(text: str) -> dict[str, Any]:
    """Make a mesh from its JSON; returns its outcome."""
    run = MeshRun.from_json(text)
    try:
        return _ask(run, MESH, text)
    except WorkerSlow:
        return mesh_failure(run, f"not meshed within {run.time_limit:g} s")
    except WorkerLost as lost:
        return mesh_failure(run, f"its process ended without a mesh ({lost})")


def _ask(job: RunJob | MeshRun, kind: str, text: str) -> dict[str, Any]:
    """The answer of the process beside this worker; when it is killed, a new one is asked.

    Raises:
        WorkerSlow: the job took too long.
        WorkerLost: the process crashed, or was killed too often.
    """
    kills = 0
    while True:
        try:
            answer: dict[str, Any] = child_with(job.plugins, kind == RUN).ask((kind, text), job.time_limit)
            return answer
        except WorkerLost as lost:
            kills += 1
            if lost.signal not in (signal.SIGKILL, signal.SIGTERM) or kills == KILLS:
                raise
