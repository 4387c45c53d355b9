"""Meshing in a process of its own: gmsh may crash on a broken file, or never come to an end, and nothing else does."""

import logging
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from taichisoft.base import WorkerLost, WorkerSlow, call_apart
from taichisoft.errors import MeshError
from taichisoft.running import FILE_OPTION, load_requested, plugin_registry, provided_by_plugin
from taichisoft_meshing.cad_body import CadBody
from taichisoft_meshing.mesh_job import MadeMesh, MeshJob, make_mesh
from taichisoft_meshing.mould_parts import write_mould

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
    """
    if not _known_elsewhere(job):
        return make_mesh(job, stage)
    stage("meshing")
    made: MadeMesh = _call_with_plugins(make_mesh, job, time_limit=time_limit)
    return made


def write_mould_apart(job: MeshJob, folder: Path, form: Mapping[str, Any]) -> None:
    """Write a mould as `write_mould` does, in a process of its own, or in this one as above."""
    if not _known_elsewhere(job):
        write_mould(job, folder, form)
    else:
        _call_with_plugins(write_mould, job, folder, form)


def _call_with_plugins(
    function: Callable[..., Any], job: MeshJob, *arguments: Any, time_limit: float = TIME_LIMIT
) -> Any:
    """Call a function in another process that has the plug-ins of this one."""
    files = [origin.place for origin in plugin_registry().origins.values() if origin.kind == "file"]
    started = time.monotonic()

    def report() -> None:
        LOGGER.info("meshing %s: %.0f s so far", job.file, time.monotonic() - started)

    try:
        return call_apart(
            "taichisoft_meshing.mesh_process:call_here",
            *(files, function, job, *arguments),
            time_limit=time_limit,
            meanwhile=report,
            every=BETWEEN_LINES,
        )
    except WorkerLost as lost:
        slow = isinstance(lost, WorkerSlow)
        problem = f"it took more than {time_limit:g} s; take larger elements" if slow else lost
        raise MeshError(f"{job.file}: the process that meshes it ended without a mesh: {problem}") from lost


def read_step_apart(path: Path) -> CadBody:
    """Read a STEP file as `read_step` does, in a process of its own."""
    try:
        body: CadBody = call_apart("taichisoft_meshing.cad_body:read_step", path, time_limit=TIME_LIMIT)
    except WorkerLost as lost:
        raise MeshError(f"{path}: the process that reads it ended: {lost}") from lost
    return body


def call_here(files: Sequence[str], function: Callable[..., Any], *arguments: Any) -> Any:
    """What the process does: it loads the plug-ins of `files` and calls a function, without printing warnings."""
    warnings.simplefilter("ignore")
    load_requested([word for file in files for word in (FILE_OPTION, file)])
    return function(*arguments)


def _known_elsewhere(job: MeshJob) -> bool:
    """Whether another process finds the plug-in that knows the kind."""
    for plugin, by_name in provided_by_plugin("geometry kind"):
        if job.kind in by_name:
            origin = plugin_registry().origins[plugin]
            return origin.kind == "file" or bool(origin.distribution)
    return False
