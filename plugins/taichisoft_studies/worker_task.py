"""What a Dask worker does for a study: it has the process beside it make a run, and notes how that ended."""

import io
import json
import logging
import os
import shutil
import signal
import sys
import traceback
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from taichisoft.base import Link, Worker, WorkerLost, WorkerSlow
from taichisoft.errors import TaichisoftError
from taichisoft.running import PROJECT_LOGGER
from taichisoft_studies.run_folder import RunJob, partial_folder, record_loss

# The process beside a worker that makes its runs: it can be killed when one takes too long, and may crash.
#
# Taichi and its kernels are loaded once for many runs, since that takes longer than a short run.

START_LIMIT = 600.0
"""Time that the process has to load Taichi and the plug-ins [s]; on a busy network disk it may take minutes."""

_child: tuple[Worker, tuple[str, ...], bool] | None = None


def child_with(plugins: Sequence[str], with_engine: bool) -> Worker:
    """The process of this worker, which makes runs with these plug-ins: the one that is there, or a new one.

    Args:
        plugins: paths of the plug-ins that it has loaded.
        with_engine: whether it has loaded Taichi, outside of any run's time limit.

    Raises:
        WorkerLost: it cannot start; the text says why.
    """
    global _child
    wanted = (tuple(plugins), with_engine)
    if _child is None or not _child[0].alive or _child[1:] != wanted:
        if _child is not None:
            _child[0].end()
            _child = None
        _child = (_started(*wanted), *wanted)
    return _child[0]


def _started(plugins: tuple[str, ...], with_engine: bool) -> Worker:
    one_thread = {"TAICHISOFT_THREADS": "1", "OMP_NUM_THREADS": "1"}
    worker = Worker("taichisoft_studies.worker_task:make_runs", one_thread, captured=False)
    try:
        worker.ask((plugins, with_engine), START_LIMIT)
    except WorkerSlow as slow:
        raise WorkerLost(f"it did not start within {START_LIMIT:g} s") from slow
    except TaichisoftError as error:
        worker.end()
        raise WorkerLost(str(error)) from error
    return worker


# What the process beside a worker does: it makes runs and meshes, one after the other.
#
# What a run prints, in Python or in C, goes to the run's log.

RUN, MESH = "run", "mesh"


def make_runs(link: Link) -> None:
    """Load what runs need, say that it is loaded, and make them.

    The first message is paths of plug-ins, and whether runs are simulated; each further one is RUN or MESH and the job
    as JSON, answered by the run's record or the mesh's outcome, or by {"error": ...}.
    """
    assert isinstance(sys.stdout, io.TextIOWrapper)
    sys.stdout.reconfigure(line_buffering=True)  # a killed run keeps all its lines
    _load(*link.receive())
    link.send("ready")
    while True:
        link.send(_answer(*link.receive()))


def _load(plugins: Sequence[str], with_engine: bool) -> None:
    if with_engine:
        from taichisoft.running import Simulation  # noqa: F401  # starts Taichi
    from taichisoft.running import load_plugin, plugin_registry

    plugin_registry()
    for plugin in plugins:
        load_plugin(plugin)


def _answer(kind: str, job: str) -> dict[str, Any]:
    from taichisoft_studies.make_run import make_run

    try:
        if kind == MESH:
            return make_variant(MeshRun.from_json(job))
        return make_run(RunJob.from_json(job), printed_to)
    except TaichisoftError as error:
        return {"error": " ".join(str(error).split())}
    except Exception as error:
        traceback.print_exc()
        return {"error": f"{type(error).__name__}: {' '.join(str(error).split())}"}


# The log of a run: everything that is printed while it is made, by Python, by Taichi and by gmsh.


@contextmanager
def printed_to(path: Path) -> Iterator[None]:
    """Send standard output and error of this process, and the messages of our loggers, to the end of a file."""
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


# A run that ends at the mesh: one variant of a geometry, meshed into a folder.


@dataclass(frozen=True)
class MeshRun:
    """A mesh to be made, as plain data that can be sent to another machine.

    Attributes:
        name: name of its folder, and of the files in it.
        folder: absolute path of the folder that holds the folders of all variants.
        geometry: the attributes of `taichisoft_meshing.mesh_job.MeshJob`, the file as text.
        force: whether a mesh that misses a limit is written all the same.
        plugins: paths of the plug-ins that it needs.
        time_limit: longest time that it may take [s].
    """

    name: str
    folder: str
    geometry: Mapping[str, Any]
    force: bool
    plugins: tuple[str, ...]
    time_limit: float

    def to_json(self) -> str:
        """As text, in one line."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> "MeshRun":
        """What `to_json` wrote."""
        values = json.loads(text)
        return cls(**{**values, "plugins": tuple(values["plugins"])})

    @property
    def place(self) -> Path:
        """Its folder."""
        return Path(self.folder) / self.name


def make_variant(run: MeshRun) -> dict[str, Any]:
    """Write a mesh to its folder, unless it lies there, and return its "problem", "figures" and "remarks"."""
    from taichisoft_meshing.mesh_job import MeshJob, make_mesh, require_fit
    from taichisoft_meshing.mesh_set import RECORD, move_set, write_files

    job = MeshJob(**{**run.geometry, "file": Path(run.geometry["file"])})
    partial = partial_folder(Path(run.folder), run.name)
    try:
        record = _record(run.place / RECORD)
        if record is not None and _is_of(record, job) and (run.force or not record["problems"]):
            return {"problem": "", "figures": _figures(record), "remarks": record["remarks"] + record["problems"]}
        made = make_mesh(job)
        if not run.force:
            require_fit(made, "--force writes the mesh all the same")
        shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir(parents=True)
        write_files(made, partial, run.name)
        record = _record(partial / RECORD)
        assert record is not None
        move_set(partial, run.place)
        figures = {**_figures(record), "seconds": round(made.seconds, 2)}
        return {"problem": "", "figures": figures, "remarks": [*made.remarks, *made.problems]}
    except TaichisoftError as error:
        return {"problem": " ".join(str(error).split()), "figures": {}, "remarks": []}
    except Exception as error:  # a plug-in's mesh that cannot be measured, a disk that is full
        problem = f"{job.file}: {type(error).__name__}: {' '.join(str(error).split())}"
        return {"problem": problem, "figures": {}, "remarks": []}
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def mesh_failure(run: MeshRun, problem: str) -> dict[str, Any]:
    """The outcome of a mesh whose process was ended, and nothing left of it."""
    for partial in Path(run.folder).glob(f".{run.name}.*.partial"):
        shutil.rmtree(partial, ignore_errors=True)
    return {"problem": f"{run.geometry['file']}: {problem}", "figures": {}, "remarks": []}


def _record(path: Path) -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None


def _is_of(record: Any, job: Any) -> bool:
    """Whether a record is that of this very mesh."""
    try:
        return record["inputs_sha256"] is not None and record["inputs_sha256"] == job.fingerprint()
    except (KeyError, TypeError, OSError):
        return False


def _figures(record: Any) -> dict[str, Any]:
    """What the summary of a sweep says about a mesh."""
    counts, volumes, quality = record["counts"], record["volumes_mm3"], record["quality"]
    return {
        **counts,
        **{f"{name}_mm3": volume for name, volume in volumes.items() if name != "outer"},
        "smallest_radius_ratio": quality["radius_ratio"]["smallest"],
        "elements_across_walls": quality["elements_across_walls"],
    }


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
