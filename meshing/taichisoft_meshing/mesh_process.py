"""Meshing in a process of its own: gmsh may crash on a broken file, or never come to an end, and nothing else does."""

import logging
import pickle
import subprocess
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

from taichisoft.child_process import PYTHON, end_with_parent, how_it_ended, lifeline
from taichisoft.errors import MeshError, PluginError, TaichisoftError
from taichisoft.plugin_system.commands import FILE_OPTION, load_requested
from taichisoft.plugin_system.hooks import provided_by_plugin
from taichisoft.plugin_system.plugins import plugin_registry
from taichisoft_meshing.mesh_job import MadeMesh, MeshJob, make_mesh

LOGGER = logging.getLogger("taichisoft.meshing")

TIME_LIMIT = 3600.0
"""Longest time that a mesh may take [s]."""
BETWEEN_LINES = 30.0
"""Time between two lines that say how long a mesh has taken so far [s]."""


def make_mesh_apart(
    job: MeshJob, stage: Callable[[str], None] = lambda name: None, time_limit: float = TIME_LIMIT
) -> MadeMesh:
    """Make a mesh as `make_mesh` does, in a process of its own.

    A kind of geometry that only this process knows, an object of somebody's code, is meshed in this one.

    Args:
        job: the request for the mesh.
        stage: called with the name of the stage that begins.
        time_limit: longest time [s].

    Raises:
        MeshError: something in the tables is not valid, they cannot be meshed, or the process ended without a mesh.
        PluginError: the plug-in of the kind failed.
    """
    if not _known_elsewhere(job):
        return make_mesh(job, stage)
    stage("meshing")
    files = [origin.place for origin in plugin_registry().origins.values() if origin.kind == "file"]
    with TemporaryDirectory(prefix="taichisoft-mesh-") as folder:
        asked, answer = Path(folder) / "job", Path(folder) / "answer"
        asked.write_bytes(pickle.dumps(job))
        arguments = [str(asked), str(answer), *(word for file in files for word in (FILE_OPTION, file))]
        problem = _run([*PYTHON, "-m", "taichisoft_meshing.mesh_process", *arguments], job.file, time_limit)
        if problem:
            lost = ChildProcessError(problem)
            raise MeshError(f"{job.file}: the process that meshes it ended without a mesh: {problem}") from lost
        made = pickle.loads(answer.read_bytes())
    if isinstance(made, TaichisoftError):
        raise made
    assert isinstance(made, MadeMesh)
    return made


def _known_elsewhere(job: MeshJob) -> bool:
    """Whether another process finds the plug-in that knows the kind."""
    for plugin, by_name in provided_by_plugin("geometry kind"):
        if job.kind in by_name:
            origin = plugin_registry().origins[plugin]
            return origin.kind == "file" or bool(origin.distribution)
    return False


def _run(command: list[str], file: Path, time_limit: float) -> str:
    """Wait for a process, and say now and then that it goes on; one line when it did not end well."""
    started = time.monotonic()
    with lifeline() as stdin:
        child = subprocess.Popen(command, stdin=stdin, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        try:
            while True:
                spent = time.monotonic() - started
                if spent >= time_limit:
                    return f"it took more than {time_limit:g} s; take larger elements"
                try:
                    _, errors = child.communicate(timeout=min(BETWEEN_LINES, time_limit - spent))
                    return how_it_ended(child.returncode, errors)
                except subprocess.TimeoutExpired:
                    LOGGER.info("meshing %s: %.0f s so far", file, time.monotonic() - started)
        finally:
            child.kill()
            child.communicate()


def _answer(job: MeshJob) -> MadeMesh | TaichisoftError:
    try:
        load_requested(sys.argv[3:])
        return make_mesh(job)
    except (MeshError, PluginError) as error:
        return type(error)(str(error))  # without its traceback, which cannot be sent


if __name__ == "__main__":
    end_with_parent()  # whoever is killed with a mesh half made leaves no process that goes on for an hour
    warnings.simplefilter("ignore")  # they come with the mesh, as its remarks
    Path(sys.argv[2]).write_bytes(pickle.dumps(_answer(pickle.loads(Path(sys.argv[1]).read_bytes()))))
