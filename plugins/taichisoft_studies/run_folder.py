"""The folder of a run: it appears when the run has ended, and `run.json` in it says how."""

import hashlib
import json
import os
import shutil
import socket
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import taichisoft
from taichisoft import Scene
from taichisoft.base import atomic_file, named_os_errors
from taichisoft.scene import Table, scene_to_toml
from taichisoft_studies.errors import StudyError

# One run of a study as plain data that can be sent to another machine, and the hash that its folder is called by.

DIGITS = 16
"""Digits of the hash in a folder's name."""


@dataclass(frozen=True)
class RunJob:
    """A run to be made.

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
        pruning: settings of pruning, see `make_run.py`; None: no pruning.
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

    @property
    def place(self) -> Path:
        """Its folder."""
        return Path(self.folder) / self.name

    def to_json(self) -> str:
        """As text, in one line."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> "RunJob":
        """What `to_json` wrote."""
        values = json.loads(text)
        return cls(**{**values, "outputs": tuple(values["outputs"]), "plugins": tuple(values["plugins"])})


def make_job(scene: Scene, folder: Path, **others: Any) -> RunJob:
    """The job of a run of a scene; `others` are the attributes of `RunJob` that are not worked out here.

    Raises:
        StudyError: a file that the scene or the job names cannot be read.
    """
    name = run_hash(
        scene, others.get("duration"), others.get("seed", 1), others.get("plugins", ()), others.get("watch")
    )
    return RunJob(name=name, folder=str(folder.resolve()), scene=scene_to_toml(scene), **others)


def run_hash(
    scene: Table, duration: float | None, seed: int, plugins: tuple[str, ...], watch: Mapping[str, str] | None = None
) -> str:
    """The hash of all that decides what comes out of a run: the resolved scene, seed, version, contents of its files.

    Files count by what is in them, not by where they lie, so that a study can be moved or done on two machines.

    Raises:
        StudyError: a file cannot be read.
    """
    parts = {
        "scene": _by_contents(scene.model_dump(mode="json", exclude_none=True)),
        "duration": duration,
        "seed": seed,
        "version": taichisoft.__version__,
        "plugins": [_code_digest(Path(plugin)) for plugin in plugins],
        "watch": dict(watch) if watch is not None else None,
    }
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:DIGITS]


def _by_contents(value: Any) -> Any:
    """Tables in which the absolute path of every file is replaced by a digest of the file."""
    if isinstance(value, Mapping):
        return {key: _by_contents(one) for key, one in value.items()}
    if isinstance(value, list):
        return [_by_contents(one) for one in value]
    if isinstance(value, str) and value.startswith("/") and Path(value).is_file():
        return _file_digest(Path(value))
    return value


def _file_digest(path: Path) -> str:
    """A digest of a file; for a geometry file, also of the files that it names."""
    try:
        whole = hashlib.sha256(path.read_bytes())
        if path.suffix.lower() == ".toml":
            from taichisoft_meshing.geometry_file import read_tables
            from taichisoft_meshing.mesh_job import named_files

            for named in named_files(read_tables(path)[1], path.parent):
                whole.update(named.read_bytes())
    except OSError as error:
        raise StudyError(f"{path}: cannot be read: {error.strerror or error}") from error
    return whole.hexdigest()


def _code_digest(plugin: Path) -> str:
    files = sorted(plugin.rglob("*.py")) if plugin.is_dir() else [plugin]
    try:
        return hashlib.sha256(b"".join(hashlib.sha256(file.read_bytes()).digest() for file in files)).hexdigest()
    except OSError as error:
        raise StudyError(f"--plugin {plugin}: cannot be read: {error.strerror or error}") from error


# Work that a process has begun and not ended: its owner, and whether that process has ended.

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

    Another machine, or another process of this one, may be making the same: its folder is left alone. That of another
    machine is abandoned when nothing was added to it for longer than an attempt may take, `time_limit` [s].
    """
    found = []
    for partial in sorted(folder.glob(f".{name}.*.partial")):
        whose = partial.name.removeprefix(f".{name}.").removesuffix(".partial")
        try:
            is_old = time.time() - partial.stat().st_mtime > time_limit + CLOCKS
        except OSError:  # it has just got its name
            continue
        if is_gone(whose) or (is_old and whose != owner()):
            found.append(partial)
    return found


def remove_abandoned(folder: Path, name: str, time_limit: float) -> None:
    """Remove what unfinished attempts at `name` have left, see `abandoned`."""
    for partial in abandoned(folder, name, time_limit):
        shutil.rmtree(partial, ignore_errors=True)


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
