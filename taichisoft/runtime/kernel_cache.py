"""Where compiled kernels are kept for later processes, and how processes share them.

Taichi reads its list of kernels at its start and writes it at its end. It guards the list by a file for which it waits
0.2 s; then it warns, and neither finds nor keeps kernels. Processes that start together would meet that, and all from
then on if one is killed meanwhile, because its file stays. So a lock that is waited for, and that ends with its
process, is held around both moments: then Taichi's file belongs to nobody.
"""

import atexit
import contextlib
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from taichisoft.cache_folder import cache_folder
from taichisoft.caller_warnings import warn_caller

VARIABLE = "TI_OFFLINE_CACHE_FILE_PATH"
"""Taichi's own environment variable; without it kernels are kept in the user's cache folder."""


def kernel_folder() -> Path:
    """Where kernels are kept."""
    return Path(_LOCK.name).parent


def has_kernels() -> bool:
    """Whether an earlier process has left kernels."""
    return any(kernel_folder().glob("*.tic"))


def _open_lock() -> IO[str]:
    """The lock file in the folder of kernels; where nothing can be written, Taichi is given a folder for this process,
    because it crashes without one."""
    usual = cache_folder() / "kernels"  # called in any case: without a home folder it sets the environment for Taichi
    folder = Path(os.environ.setdefault(VARIABLE, str(usual)))
    try:
        folder.mkdir(parents=True, exist_ok=True)
        return (folder / "lock").open("w")
    except OSError as error:
        why = f"compiled kernels cannot be kept in {folder} ({error.strerror}) and every start takes a minute"
        warn_caller(f"{why}; {VARIABLE} can name another folder")
        os.environ[VARIABLE] = tempfile.mkdtemp(prefix="taichisoft-kernels-")
        atexit.register(shutil.rmtree, os.environ[VARIABLE], ignore_errors=True)
        return _open_lock()


_LOCK = _open_lock()
atexit.register(_LOCK.close)  # what is registered later, such as Taichi's own end, comes before it


@contextlib.contextmanager
def alone_with_kernels() -> Iterator[None]:
    """Wait until no other process reads or writes the list of kernels."""
    try:
        import fcntl

        fcntl.flock(_LOCK, fcntl.LOCK_EX)
    except (ImportError, OSError):  # on Windows and some network drives Taichi's own guard must do
        yield
        return
    try:
        Path(_LOCK.name).with_name("ticache.lock").unlink(missing_ok=True)
        yield
    finally:
        fcntl.flock(_LOCK, fcntl.LOCK_UN)
