"""The folder in which things are kept that take long to make: the user's cache, or one for temporary files.

Services, jobs of cron and containers often have no home, or one that nobody may write to. Taichi itself crashes there.
"""

import os
import stat
import sys
import tempfile
from pathlib import Path

from taichisoft.input_file import from_home
from taichisoft.terminal_text import printable

VARIABLE = "XDG_CACHE_HOME"
"""The folder of all programs' caches; other libraries, and child processes, find theirs by it, too."""


def cache_folder() -> Path:
    """Our folder in the user's cache; where nothing can be written there one for temporary files, which is said once.

    From then on the environment names it, so that other libraries and child processes take the same.
    """
    ours = "taichisoft"
    if sys.platform != "linux":
        import platformdirs

        return platformdirs.user_cache_path(ours, appauthor=False)
    home = from_home("~")  # "~" itself where the user has none
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
    os.environ.setdefault("HOME", str(home if home.is_absolute() else named))  # Taichi ends the process without one
    return named / ours


def temporary_cache() -> Path:
    """A folder of this user among the temporary files: the same on every run, unless it could be somebody else's."""
    user = os.getuid()
    folder = Path(tempfile.gettempdir()) / f"taichisoft-cache-{user}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
        # What lies in it is executed: nobody else may have made it, or write to it.
        own = stat.S_ISDIR(found.st_mode) and found.st_uid == user and not found.st_mode & 0o022
        if own and _can_be_written(folder):
            return folder
    except OSError:
        pass
    return Path(tempfile.mkdtemp(prefix="taichisoft-cache-"))


def _can_be_written(folder: Path) -> bool:
    """Whether the folder is there, or can be made, and takes files."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False
