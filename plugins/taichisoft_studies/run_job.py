"""One run of a study: its job as plain data, its folder, which appears when the run has ended, and how it is made."""

import errno
import hashlib
import json
import logging
import os
import random
import shutil
import socket
import sys
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

import taichisoft
from taichisoft import Scene
from taichisoft.base import atomic_file, named_os_errors, read_arrays
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
from taichisoft.running import PROJECT_LOGGER, Output
from taichisoft.scene import Table, scene_to_toml
from taichisoft_studies.errors import StudyError
from taichisoft_studies.study_file import Expression

if TYPE_CHECKING:
    from taichisoft.contact import Model
    from taichisoft.mechanics import State
    from taichisoft.step import StepReport
    from taichisoft_outputs.metrics import MetricsOutput

DIGITS = 16
"""Digits of the hash in a folder's name."""
RECORD, LOG, METRICS, CURVES = "run.json", "log.txt", "metrics.json", "curves.npz"
COMPLETED, PRUNED, BEYOND_LAW, ERROR = "completed", "pruned", "beyond the law", "error"
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


@dataclass(frozen=True)
class RunJob:
    """A run to be made, as plain data that can be sent to another machine.

    Attributes:
        name: name of its folder: the hash of all that decides its results.
        folder: absolute path of the folder that holds the folders of all runs.
        scene: resolved scene as TOML.
        source: name of the scene, which begins errors.
        parameters: values by key that distinguish it from other runs of the study.
        duration: simulated time [s]; None for the scene's.
        outputs: names of the outputs that watch it.
        plugins: paths of the plug-ins that it needs.
        seed: seed of Python's and numpy's random numbers.
        time_limit: longest time that it may take [s].
        watch: quantities recorded at every step, text of an expression by name; or None.
        pruning: settings of `PruningOutput`; None: no pruning.
        gradient: what is to be derived and by what, see `kept_run.derived`; None: nothing.
    """

    name: str
    folder: str
    scene: str
    source: str
    parameters: Mapping[str, Any]
    duration: float | None = None
    outputs: tuple[str, ...] = ("metrics",)
    plugins: tuple[str, ...] = ()
    seed: int = 1
    time_limit: float = 3600.0
    watch: Mapping[str, str] | None = None
    pruning: Mapping[str, Any] | None = None
    gradient: Mapping[str, Any] | None = None
    needs_engine: ClassVar = True

    @property
    def place(self) -> Path:
        """Its folder."""
        return Path(self.folder) / self.name

    def make(self) -> dict[str, Any]:
        """Make the run, with what it prints in its log, and return its record."""
        return make_run(self, is_logged=True)

    def lost(self, status: str, message: str) -> dict[str, Any]:
        """Make the folder of a run whose process was lost, with the log that it left, and return its record."""
        attempts = abandoned(Path(self.folder), self.name, self.time_limit)
        logs = [attempt / LOG for attempt in attempts if (attempt / LOG).is_file()]
        with new_folder(self) as folder:
            for log in logs[:1]:
                shutil.copy(log, folder / LOG)
            record = write_record(self, folder, status, message, {})
        self.clean()
        return record

    def clean(self) -> None:
        """Remove what unfinished attempts at the run have left."""
        remove_abandoned(Path(self.folder), self.name, self.time_limit)


def make_job(scene: Scene, folder: Path, **others: Any) -> RunJob:
    """The job of a run of a scene; `others` are the remaining attributes of `RunJob`."""
    keys = ("watch", "gradient")
    name = run_hash(
        scene, others.get("duration"), others.get("seed", 1), others.get("plugins", ()), *map(others.get, keys)
    )
    return RunJob(name=name, folder=str(folder.resolve()), scene=scene_to_toml(scene), **others)


def run_hash(
    scene: Table,
    duration: float | None,
    seed: int,
    plugins: tuple[str, ...],
    watch: Mapping[str, str] | None = None,
    gradient: Mapping[str, Any] | None = None,
) -> str:
    """The hash of all that decides the results of a run: the resolved scene, seed, version, contents of its files.

    Files count by their contents, not by their paths, so that a study can be moved or done on two machines.
    """
    parts = {
        "scene": _by_contents(scene.model_dump(mode="json", exclude_none=True)),
        "duration": duration,
        "seed": seed,
        "version": taichisoft.__version__,
        "plugins": [_code_digest(Path(plugin)) for plugin in plugins],
        "watch": dict(watch) if watch is not None else None,
        **({"gradient": _by_contents(gradient)} if gradient is not None else {}),
    }
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:DIGITS]


def _by_contents(value: Any) -> Any:
    """Tables in which the absolute path of every file is replaced by a digest of the file."""
    if isinstance(value, Mapping):
        return {key: _by_contents(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_by_contents(item) for item in value]
    if isinstance(value, str) and value.startswith("/") and Path(value).is_file():
        return _file_digest(Path(value))
    return value


def _file_digest(path: Path) -> str:
    """A digest of a file; for a geometry file, also of the files that it names."""
    try:
        digest = hashlib.sha256(path.read_bytes())
        if path.suffix.lower() == ".toml":
            from taichisoft_meshing.geometry_file import read_tables
            from taichisoft_meshing.mesh_job import named_files

            for named in named_files(read_tables(path)[1], path.parent):
                digest.update(named.read_bytes())
    except OSError as error:
        raise StudyError(f"{path}: cannot be read: {error.strerror or error}") from error
    return digest.hexdigest()


def _code_digest(plugin: Path) -> str:
    files = sorted(plugin.rglob("*.py")) if plugin.is_dir() else [plugin]
    try:
        return hashlib.sha256(b"".join(hashlib.sha256(file.read_bytes()).digest() for file in files)).hexdigest()
    except OSError as error:
        raise StudyError(f"--plugin {plugin}: cannot be read: {error.strerror or error}") from error


# Folders of unfinished work: ".NAME.HOST-PID.partial", of which HOST-PID is the owner, a process.

CLOCKS = 60.0
"""By how much the clocks of two machines may differ [s]."""


def owner() -> str:
    """Identity of this process on all machines, "HOST-PID"."""
    return f"{socket.gethostname()}-{os.getpid()}"


def is_gone(owner: str) -> bool:
    """Whether an owner is a process of this machine that has ended; nothing is known of other machines."""
    host, _, pid = owner.rpartition("-")
    if host != socket.gethostname() or not pid.isdecimal():
        return False
    try:
        os.kill(int(pid), 0)
    except ProcessLookupError:
        return True
    except OSError:
        return False
    return False


def partial_folder(folder: Path, name: str) -> Path:
    """Where this process makes what will be called `name` in a folder."""
    return folder / f".{name}.{owner()}.partial"


def abandoned(folder: Path, name: str, time_limit: float) -> list[Path]:
    """Folders of unfinished attempts at `name` whose process has ended.

    The folder of another running process of this machine is left alone. That of another machine is abandoned when
    nothing was added to it for longer than an attempt may take, `time_limit` [s].
    """
    ended = []
    for partial in sorted(folder.glob(f".{name}.*.partial")):
        its_owner = partial.name.removeprefix(f".{name}.").removesuffix(".partial")
        try:
            is_old = time.time() - partial.stat().st_mtime > time_limit + CLOCKS
        except OSError:  # it has just got its name
            continue
        if is_gone(its_owner) or (is_old and its_owner != owner()):
            ended.append(partial)
    return ended


def remove_abandoned(folder: Path, name: str, time_limit: float) -> None:
    """Remove what unfinished attempts at `name` have left, see `abandoned`."""
    for partial in abandoned(folder, name, time_limit):
        shutil.rmtree(partial, ignore_errors=True)


def read_record(folder: Path) -> dict[str, Any] | None:
    """The content of `run.json` in a folder; None if it is missing or incomplete.

    Keys: "run", "parameters", "seed", "version", "outputs", "status" ("completed" or a reason such as "diverged"),
    "message" (one line, empty for a completed run), "metrics", "warnings" (one line each).
    """
    try:
        record = json.loads((folder / RECORD).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return record if isinstance(record, dict) and "status" in record else None


def finished(job: RunJob) -> dict[str, Any] | None:
    """The record of a job that has ended with all its outputs, or None.

    A run that ended with an error counts as not made: the disk may have been full, or the fault may be gone by now.
    """
    record = read_record(job.place)
    if record is None or record["status"] == ERROR or (record["status"] == PRUNED and job.pruning is None):
        return None
    return record if set(job.outputs) <= set(record.get("outputs", ())) else None


@contextmanager
def new_folder(job: RunJob) -> Iterator[Path]:
    """A folder to make a run in, which gets the run's name if its record was written, and otherwise is removed.

    If another process was faster, its folder stays. A folder that lacks an output stays until it is replaced.
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


def _give_name(partial: Path, job: RunJob) -> None:
    if finished(job) is None:
        shutil.rmtree(job.place, ignore_errors=True)
    try:
        partial.rename(job.place)
    except OSError:
        if finished(job) is None:  # otherwise another process has made the same run
            raise


def write_record(
    job: RunJob, folder: Path, status: str, message: str, metrics: Mapping[str, Any], warned: Sequence[str] = ()
) -> dict[str, Any]:
    """Write `run.json`, and return its content, see `read_record`."""
    record = {
        "run": job.name,
        "parameters": dict(job.parameters),
        "seed": job.seed,
        "version": taichisoft.__version__,
        "outputs": list(job.outputs),
        "status": status,
        "message": message,
        "metrics": dict(metrics),
        "warnings": list(warned),
    }
    with atomic_file(folder / RECORD, StudyError) as partial:
        partial.write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")
    return record


def make_run(job: RunJob, is_logged: bool = False) -> dict[str, Any]:
    """Make a run, unless another process has finished it, and return its record.

    Args:
        job: the run.
        is_logged: whether all that this process prints meanwhile goes to the run's log.
    """
    record = finished(job)
    if record is not None:
        return record
    with new_folder(job) as folder:
        with _printed_to(folder / LOG if is_logged else None), _warnings_kept() as lines:
            status, message = _run(job, folder)
        record = write_record(job, folder, status, message, _metrics(folder), lines)
    job.clean()
    return record


@contextmanager
def _printed_to(path: Path | None) -> Iterator[None]:
    """Append standard output and error of this process, of libraries in C as well, and our messages to a file."""
    if path is None:
        yield
        return
    before = os.dup(1), os.dup(2)
    handler = logging.StreamHandler(sys.stderr)
    logger = logging.getLogger(PROJECT_LOGGER)
    logger.setLevel(logging.INFO)
    with path.open("ab") as log:
        os.dup2(log.fileno(), 1)
        os.dup2(log.fileno(), 2)
        logger.addHandler(handler)
        try:
            yield
        finally:
            logger.removeHandler(handler)
            sys.stdout.flush()
            sys.stderr.flush()
            for number, descriptor in enumerate(before, 1):
                os.dup2(descriptor, number)
                os.close(descriptor)


@contextmanager
def _warnings_kept() -> Iterator[list[str]]:
    """The warnings within the context, one line each, which are printed as well."""
    lines: list[str] = []
    with warnings.catch_warnings():
        warnings.simplefilter("default")  # a warning of an earlier run of this process counts again
        show: Callable[..., None] = warnings.showwarning

        def keep(message: Warning | str, *others: Any, **named: Any) -> None:
            lines.append(" ".join(str(message).split()))
            show(message, *others, **named)

        warnings.showwarning = keep
        yield lines


def reason(error: Exception) -> str:
    """The status of a run that raised an error; "error" where the machine lacked something, such as space on a disk."""
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
    from taichisoft_studies.kept_run import KeptSimulation, OpenLoop, derived

    scene = scene_from_toml(job.scene, job.source)
    controller = make_controller(scene)
    if job.gradient is not None:
        controller = OpenLoop(controller, make_controller(scene))
    simulation = Simulation(scene) if job.gradient is None else KeptSimulation(scene)
    outputs = [make_output(name, folder) for name in job.outputs]
    if job.watch is not None:
        outputs.append(CurvesOutput(folder, job.watch))
    if job.pruning is not None:
        metrics: Any = outputs[job.outputs.index("metrics")]
        outputs.append(PruningOutput(metrics, job.parameters, job.pruning))
    run(simulation, controller, outputs, job.duration)
    if job.gradient is not None and isinstance(simulation, KeptSimulation):
        figures, columns = _metrics(folder), read_curves(folder) if job.watch else {}
        named = {**figures, "parameters": dict(job.parameters)}
        found = derived(simulation, job.gradient, job.watch or {}, columns, named, _observed_values)
        with atomic_file(folder / METRICS, StudyError) as partial:
            partial.write_text(json.dumps({**figures, **found}, indent=2) + "\n", encoding="utf-8")


def _metrics(folder: Path) -> dict[str, Any]:
    """The figures of metrics.json; none if the run ended before they were written."""
    try:
        metrics = json.loads((folder / METRICS).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return metrics if isinstance(metrics, dict) else {}


class Pruned(ControllerFailed):
    """A run was ended because others were better at the same simulated time."""


class PruningOutput(Output):
    """Reports the objective to the optimiser periodically, and ends a run that cannot become one of the better ones."""

    def __init__(self, metrics: "MetricsOutput", parameters: Mapping[str, Any], settings: Mapping[str, Any]):
        """Prepare.

        Args:
            metrics: figures of the same run; read after every step.
            parameters: values of the run by key.
            settings: "journal", file of the optimiser's storage; "trial", its number there; "objective", text of the
                expression; "every" [s]; "warm_up" [s] and "trials", before which nothing is pruned.
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
        """Report the objective at every period; raises `Pruned`."""
        self._count += 1
        if self._count % self._period or report.time < self._settings["warm_up"]:
            return
        value = self._objective({**self._metrics.figures("running"), "parameters": self._parameters})
        self._trial.report(value, step=self._count)
        if self._trial.should_prune():
            raise Pruned(f"{self._objective.text} = {value:.6g} at {report.time:g} s: others were better by then")


class CurvesOutput(Output):
    """Evaluates expressions of what a controller sees after every step, and writes their values at the end."""

    def __init__(self, folder: Path, expressions: Mapping[str, str]):
        """Prepare; `expressions` are texts by the name of the curve."""
        self._folder = folder
        self._expressions = {name: Expression(text, name) for name, text in expressions.items()}
        self._rows: list[list[float]] = []

    def begin(self, model: "Model", state: "State") -> None:
        """Forget an earlier run."""
        self._rows = []

    def record(self, state: "State", report: "StepReport") -> None:
        """Evaluate the expressions after a step."""
        names = _observed_values(report.observation.truth)
        self._rows.append([expression(names) for expression in self._expressions.values()])

    def end(self, outcome: str) -> None:
        """Write curves.npz: a column for each expression, shape (step_count,)."""
        columns = dict(zip(self._expressions, np.array(self._rows, dtype=float).T, strict=False))
        with atomic_file(self._folder / CURVES, StudyError) as partial, partial.open("wb") as file:
            np.savez(file, **columns)


def _observed_values(observation: Observation) -> dict[str, Any]:
    """The observation's attributes by name; `normal_forces["finger|cube"]` is that of a pair."""
    values = {field.name: getattr(observation, field.name) for field in fields(observation) if field.name != "state"}
    return {name: _named_pairs(value) for name, value in values.items()}


def _named_pairs(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {"|".join(key) if isinstance(key, tuple) else key: item for key, item in value.items()}
    return value


def read_curves(folder: Path) -> dict[str, np.ndarray]:
    """The columns that `CurvesOutput` wrote."""
    path = folder / CURVES
    try:
        return read_arrays(path)
    except (OSError, ValueError) as error:
        raise StudyError(f"{path}: not readable: {error}") from error
