"""The folder for results that take long to make: the user's cache, or a folder for temporary files.

Services, cron jobs and containers often have no home or a read-only home, in which Taichi itself crashes.
"""

import os
import stat
import sys
import tempfile
from pathlib import Path

from taichisoft.input_file import from_home
from taichisoft.terminal_text import printable

VARIABLE = "XDG_CACHE_HOME"
"""Environment variable with the folder of all programs' caches, also used by libraries and child processes."""


def cache_folder() -> Path:
    """Our folder in the user's cache, or one for temporary files if the cache is not writable, with a single warning.

    The environment is then set to it, so that other libraries and child processes use the same folder.
    """
    ours = "taichisoft"
    if sys.platform != "linux":
        import platformdirs

        return platformdirs.user_cache_path(ours, appauthor=False)
    home = from_home("~")  # "~" itself if the user has no home
    named = Path(os.environ.get(VARIABLE) or home / ".cache")
    if not (named.is_absolute() and _can_be_written(named / ours)):
        temporary = temporary_cache()
        print(
            f"taichisoft: {printable(str(named))} cannot be written; compiled kernels and meshes are kept in "
            f"{printable(str(temporary))} ({VARIABLE} can name another folder)",
            file=sys.stderr,
        )
        named = temporary
    os.environ[VARIABLE] = str(named)
    os.environ.setdefault("HOME", str(home if home.is_absolute() else named))  # without HOME, Taichi ends the process
    return named / ours


def temporary_cache() -> Path:
    """A folder of this user for temporary files: the same in every run, unless another user could have made it."""
    user = os.getuid()
    folder = Path(tempfile.gettempdir()) / f"taichisoft-cache-{user}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
        # Its content is executed: no other user may own it or write to it.
        own = stat.S_ISDIR(found.st_mode) and found.st_uid == user and not found.st_mode & 0o022
        if own and _can_be_written(folder):
            return folder
    except OSError:
        pass
    return Path(tempfile.mkdtemp(prefix="taichisoft-cache-"))


def _can_be_written(folder: Path) -> bool:
    """Whether the folder exists or can be made, and files can be written to it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False
