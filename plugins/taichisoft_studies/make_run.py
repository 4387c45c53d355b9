"""Makes one run in a folder: the scene, its controller and outputs, and its status."""

import errno
import json
import random
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft.base import atomic_file, read_arrays
from taichisoft.control import Observation
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
from taichisoft.running import Output
from taichisoft_studies.errors import StudyError
from taichisoft_studies.run_folder import (
    BEYOND_LAW,
    COMPLETED,
    ERROR,
    LOG,
    METRICS,
    PRUNED,
    RunJob,
    finished,
    new_folder,
    remove_partial,
    write_record,
)
from taichisoft_studies.study_file import Expression

if TYPE_CHECKING:
    from taichisoft.contact import Model
    from taichisoft.mechanics import State
    from taichisoft.step import StepReport
    from taichisoft_outputs.metrics import MetricsOutput

# Pruning: a run that an optimiser watches ends early when it cannot become one of the better ones.


class Pruned(ControllerFailed):
    """A run was ended because others were better at the same simulated time."""


class PruningOutput(Output):
    """Reports the objective to the optimiser periodically, and ends the run when it is pruned."""

    def __init__(self, metrics: "MetricsOutput", parameters: Mapping[str, Any], settings: Mapping[str, Any]):
        """Prepare.

        Args:
            metrics: figures of the same run; it is asked after every step.
            parameters: values of the run by key.
            settings: "journal", file of the optimiser's storage, and "trial", its identity there;
                "objective", text of the expression; "every" [s], "warm_up" [s] and "trials", before which nothing is
                pruned.
        """
        self._metrics, self._parameters, self._settings = metrics, parameters, settings
        self._objective = Expression(settings["objective"], "objectives")
        self._period = 1

    def begin(self, model: "Model", state: "State") -> None:
        """Find the trial."""
        from taichisoft_studies.optimiser import open_trial

        self._trial = open_trial(self._settings)
        self._period = max(1, round(self._settings["every"] / model.scene.time.step))
        self._count = 0

    def record(self, state: "State", report: "StepReport") -> None:
        """Report the objective at every period.

        Raises:
            Pruned: the run cannot become one of the better ones.
        """
        self._count += 1
        if self._count % self._period or report.time < self._settings["warm_up"]:
            return
        value = self._objective({**self._metrics.figures("running"), "parameters": self._parameters})
        self._trial.report(value, step=self._count)
        if self._trial.should_prune():
            raise Pruned(f"{self._objective.text} = {value:.6g} at {report.time:g} s: others were better by then")


# The curves of a run: expressions of what a controller sees, evaluated after every step.


def observed_values(observation: Observation) -> dict[str, Any]:
    """The observation's attributes by name; `normal_forces["finger|cube"]` is that of a pair."""
    values = {one.name: getattr(observation, one.name) for one in fields(observation) if one.name != "state"}
    return {name: _named_pairs(value) for name, value in values.items()}


def _named_pairs(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {"|".join(key) if isinstance(key, tuple) else key: one for key, one in value.items()}
    return value


CURVES = "curves.npz"


class CurvesOutput(Output):
    """Evaluates expressions after every step, and writes their values at the end."""

    def __init__(self, folder: Path, expressions: Mapping[str, str]):
        """Prepare; `expressions` are texts by the name of the curve.

        Raises:
            StudyError: one is not valid.
        """
        self._folder = folder
        self._expressions = {name: Expression(text, name) for name, text in expressions.items()}
        self._rows: list[list[float]] = []

    def begin(self, model: "Model", state: "State") -> None:
        """Forget an earlier run."""
        self._rows = []

    def record(self, state: "State", report: "StepReport") -> None:
        """Note the values after a step.

        Raises:
            StudyError: an expression names what a run does not have.
        """
        names = observed_values(report.observation.truth)
        self._rows.append([expression(names) for expression in self._expressions.values()])

    def end(self, outcome: str) -> None:
        """Write curves.npz: a column for each expression, shape (step_count,)."""
        columns = dict(zip(self._expressions, np.array(self._rows, dtype=float).T, strict=False))
        path = self._folder / CURVES
        with atomic_file(path, StudyError) as partial, partial.open("wb") as file:
            np.savez(file, **columns)


def read_curves(folder: Path) -> dict[str, np.ndarray]:
    """The columns that a run noted.

    Raises:
        StudyError: the run has none.
    """
    path = folder / CURVES
    try:
        return read_arrays(path)
    except (OSError, ValueError) as error:
        raise StudyError(f"{path}: not readable: {error}") from error


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
    from taichisoft.running import Simulation, make_controller, make_output, run
    from taichisoft.scene import scene_from_toml

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
