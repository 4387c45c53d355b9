"""gmsh for one mesh: silent, the same every time, closed again whatever happens, its log kept when it fails."""

import ctypes
import os
import signal
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from taichisoft.errors import MeshError
from taichisoft.optional_packages import require

Way = TypeVar("Way")
Made = TypeVar("Made")

TRIANGLE, TETRAHEDRON = 2, 4  # gmsh's numbers for the linear ones

FRONTAL, MESH_ADAPT, DELAUNAY = 6, 1, 5
SURFACE_ALGORITHMS = (FRONTAL, MESH_ADAPT, DELAUNAY)
"""gmsh's numbers: the first gives the best triangles, the others fail less on surfaces that are hard to unroll."""


class GmshFailure(Exception):
    """gmsh gave a wrong result without an error of its own; raised inside a session, this becomes a MeshError."""


@contextmanager
def gmsh_session(body: str) -> Iterator[Any]:
    """The module gmsh, initialised to use its own optimiser and Netgen's; its whole state ends with the session.

    gmsh runs on one thread, because several threads number the nodes in a random order, and reads no configuration of
    the user: the same calls give the same mesh, node for node. Its messages are kept in a file only if it fails.

    Args:
        body: name of what is meshed in errors, for example "this finger" or "body.step".

    Raises:
        PackageMissing: gmsh is not installed.
        MeshError: gmsh cannot be loaded, is already in use in this process, or fails. A failure inside the session,
            gmsh's or a GmshFailure, becomes one line that names the file with gmsh's log.
    """
    require("meshing", "gmsh")
    try:
        import gmsh
    except (ImportError, OSError) as error:
        raise MeshError(
            f"gmsh cannot be loaded ({_one_line(error)}); `taichisoft doctor` says which system libraries to install"
        ) from error
    if gmsh.isInitialized():
        raise MeshError(f"gmsh is already in use in this process; finalize it before meshing {body}")
    # Not interruptible: gmsh would take over the signal handlers, and can only do so in the main thread.
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    _keep_broken_pipes_an_error()
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("General.NumThreads", 1)
        gmsh.option.setNumber("Mesh.Optimize", 1)
        gmsh.option.setNumber("Mesh.OptimizeNetgen", 1)
        gmsh.logger.start()
        yield gmsh
    except Exception as error:
        if type(error) not in (Exception, GmshFailure):  # gmsh raises plain Exception; others are not its own
            raise
        raise MeshError(f"gmsh cannot mesh {body}: {_one_line(error)}; {_kept_log(gmsh)}") from error
    finally:
        gmsh.finalize()


def first_success(body: str, ways: Sequence[Way], make: Callable[[Any, Way], Made]) -> Made:
    """Make something in several ways, each in a session of its own, until one does not fail.

    Args:
        body: name of what is meshed in errors.
        ways: ways to make it, in the order in which they are tried.
        make: called with gmsh and a way.

    Returns:
        The result of the first way that did not fail.

    Raises:
        MeshError: the last way failed.
    """
    for number, way in enumerate(ways, 1):
        with gmsh_session(body) as gmsh:  # each its own: gmsh does nothing more after it has failed
            try:
                return make(gmsh, way)
            except Exception as error:
                if type(error) not in (Exception, GmshFailure, MeshError) or number == len(ways):
                    raise
    raise ValueError("ways is empty; give at least one")


def tetrahedra(gmsh: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nodes in use and tetrahedra of the session's mesh, which gmsh makes positive.

    Returns:
        Node positions [mm], shape (node_count, 3); elements, shape (element_count, 4); gmsh's number of each node,
        in ascending order.

    Raises:
        GmshFailure: there are none.
    """
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    corner_tags = gmsh.model.mesh.getElementsByType(TETRAHEDRON)[1]
    if len(corner_tags) == 0:
        raise GmshFailure("no tetrahedra came out")
    order = np.argsort(tags)
    used, corners = np.unique(corner_tags, return_inverse=True)
    nodes = coordinates.reshape(-1, 3)[order[np.searchsorted(tags[order], used)]]
    return nodes, corners.reshape(-1, 4).astype(np.int32), used


def obey_size_fields(gmsh: Any) -> None:
    """Let the smallest of all size fields made so far decide everywhere; a distance is not a size."""
    field = gmsh.model.mesh.field
    smallest = field.add("Min")
    field.setNumbers(smallest, "FieldsList", [tag for tag in field.list() if field.getType(tag) != "Distance"])
    field.setAsBackgroundMesh(smallest)


def gmsh_version() -> str:
    """The version of gmsh that is installed, found without loading it."""
    try:
        return version("gmsh")
    except PackageNotFoundError:  # installed by other means than pip
        return "unknown"


def _keep_broken_pipes_an_error() -> None:
    """Undo a side effect of gmsh's start, after which the signal of a broken pipe would end the process.

    Python ignores that signal and raises BrokenPipeError instead; in threads it cannot set it itself.
    """
    if hasattr(signal, "SIGPIPE") and signal.getsignal(signal.SIGPIPE) is signal.SIG_IGN:
        ctypes.CDLL(None).signal(int(signal.SIGPIPE), ctypes.c_void_p(int(signal.SIG_IGN)))


def _kept_log(gmsh: Any) -> str:
    """Write gmsh's messages to a file that stays, and say where it is."""
    lines = "\n".join(gmsh.logger.get())
    try:
        handle, name = tempfile.mkstemp(prefix="taichisoft-gmsh-", suffix=".log")
        os.close(handle)
        Path(name).write_text(lines + "\n", encoding="utf-8")
    except OSError as error:
        return f"gmsh's log cannot be written: {error.strerror or error}"
    return f"gmsh's log is {name}"


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())
