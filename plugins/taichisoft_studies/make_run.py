"""Makes one run in a folder: the scene, its controller and outputs, and its status."""

import errno
import json
import random
import warnings
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from typing import Any

import numpy as np

from taichisoft.errors import (
    BeyondLaw,
    ControlError,
    ControllerFailed,
    GoalMissed,
    MeshError,
    NotPositiveDefinite,
    PluginError,
    SceneError,
    SimulationDiverged,
    TaichisoftError,
)
from taichisoft_studies.pruning import Pruned, PruningOutput
from taichisoft_studies.run_folder import (
    BEYOND_LAW,
    COMPLETED,
    ERROR,
    LOG,
    METRICS,
    PRUNED,
    finished,
    new_folder,
    remove_partial,
    write_record,
)
from taichisoft_studies.run_job import RunJob

REASONS: tuple[tuple[type[TaichisoftError], str], ...] = (
    (MeshError, "mesh refused"),
    (SimulationDiverged, "diverged"),
    (NotPositiveDefinite, "diverged"),
    (ControllerFailed, "controller failed"),
    (ControlError, "controller failed"),
    (BeyondLaw, BEYOND_LAW),
    (GoalMissed, "goal missed"),
    (PluginError, "plug-in failed"),
    (SceneError, "scene refused"),
)
SHORTAGES = (
    errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS,
    errno.EIO, errno.ESTALE, errno.ENOMEM, errno.EMFILE, errno.ENFILE,
)  # fmt: skip
"""Errors of the machine's state, such as a full disk, not of the run."""


def make_run(
    job: RunJob, logged_in: Callable[[Path], AbstractContextManager[object]] = lambda path: nullcontext()
) -> dict[str, Any]:
    """Make a run, unless another process has finished it, and return its record.

    Args:
        job: the run.
        logged_in: sends what the run prints to the file that it is given, as long as it lasts.

    Raises:
        StudyError: its folder cannot be written.
    """
    record = finished(job)
    if record is not None:
        return record
    with new_folder(job) as folder:
        with logged_in(folder / LOG), _warnings_kept() as said:
            status, message = _run(job, folder)
        record = write_record(job, folder, status, message, _metrics(folder), said)
    remove_partial(job)
    return record


@contextmanager
def _warnings_kept() -> Iterator[list[str]]:
    """The warnings within the context, one line each, which are printed as well."""
    said: list[str] = []
    with warnings.catch_warnings():
        warnings.simplefilter("default")  # what an earlier run of this process has said counts again
        show: Callable[..., None] = warnings.showwarning

        def keep(message: Warning | str, *others: Any, **named: Any) -> None:
            said.append(" ".join(str(message).split()))
            show(message, *others, **named)

        warnings.showwarning = keep
        yield said


def reason(error: Exception) -> str:
    """One of a few words for an error, for tables: which key, or which body, its message says.

    What the machine lacked, such as space on a disk, is an "error" wherever it was met: it says nothing of the scene.
    """
    if _is_of_the_machine(error):
        return ERROR
    if isinstance(error, SceneError) and isinstance(error.__cause__, MeshError):
        return "mesh refused"
    return next((name for kind, name in REASONS if isinstance(error, kind)), ERROR)


def _is_of_the_machine(error: BaseException | None) -> bool:
    """Whether memory, a disk or a process failed, or that is what caused the error."""
    while error is not None:
        lost = isinstance(error, MemoryError | ChildProcessError)
        if lost or (isinstance(error, OSError) and error.errno in SHORTAGES):
            return True
        error = error.__cause__
    return False


def _run(job: RunJob, folder: Path) -> tuple[str, str]:
    """Status and message of the run."""
    random.seed(job.seed)
    np.random.seed(job.seed)  # plug-ins may draw from either
    try:
        _simulate(job, folder)
    except Pruned as pruned:
        return PRUNED, str(pruned)
    except Exception as error:
        text = str(error) if isinstance(error, TaichisoftError) else f"{type(error).__name__}: {error}"
        return reason(error), " ".join(text.split())
    return COMPLETED, ""


def _simulate(job: RunJob, folder: Path) -> None:
    from taichisoft.building import Simulation, make_controller, make_output
    from taichisoft.running import run
    from taichisoft.scenes import scene_from_toml
    from taichisoft_studies.curves_output import CurvesOutput

    (folder / "scene.toml").write_text(job.scene, encoding="utf-8")
    scene = scene_from_toml(job.scene, job.source)
    controller = make_controller(scene)
    simulation = Simulation(scene)
    outputs = [make_output(name, folder) for name in job.outputs]
    if job.watch is not None:
        outputs.append(CurvesOutput(folder, job.watch))
    if job.pruning is not None:
        metrics: Any = outputs[job.outputs.index("metrics")]
        outputs.append(PruningOutput(metrics, job.parameters, job.pruning))
    run(simulation, controller, outputs, job.duration)


def _metrics(folder: Path) -> dict[str, Any]:
    """The figures of metrics.json; none where the run has not come so far."""
    try:
        metrics = json.loads((folder / METRICS).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return metrics if isinstance(metrics, dict) else {}
