"""A gmsh of one's own: silent, the same every time, closed again whatever happens, its log kept when it fails."""

import ctypes
import os
import signal
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from taichisoft.errors import MeshError


class GmshFailure(Exception):
    """What came out of gmsh is not what was asked for; raised inside a session, it becomes a MeshError."""


@contextmanager
def gmsh_session(body: str) -> Iterator[Any]:
    """The module gmsh, initialised with Netgen's and its own optimiser on; its whole state ends with the session.

    It runs on one thread, because several number the nodes as they come, and reads no configuration of the user:
    the same calls give the same mesh, node for node. What gmsh says goes to a file if it fails, else nowhere.

    Args:
        body: what is meshed, as the error calls it, for example "this finger" or "body.step".

    Raises:
        MeshError: gmsh cannot be loaded, is already in use in this process, or fails. A failure inside the session,
            gmsh's or a GmshFailure, is told in one line that names the file with gmsh's log.
    """
    try:
        import gmsh
    except (ImportError, OSError) as error:
        raise MeshError(
            f"gmsh cannot be loaded ({_one_line(error)}); it needs the system libraries of X11 and OpenGL, "
            "on Debian libglu1-mesa libgl1 libxcursor1 libxinerama1 libxft2"
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


def _keep_broken_pipes_an_error() -> None:
    """Undo what gmsh's start does behind Python's back: from then on the signal of a broken pipe would end the process.

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
