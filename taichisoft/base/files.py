"""Files: written atomically, checksums, the user's cache, and files that a user names."""

import hashlib
import io
import os
import re
import stat
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any
from uuid import uuid4

from taichisoft.base.text import printable
from taichisoft.errors import TaichisoftError

if TYPE_CHECKING:
    import numpy as np

# Input files: existence, tables of TOML, and arrays of numpy.

DEEPEST = 50
"""Largest depth of nested tables and lists, which are processed recursively."""
LONG_INTEGER = re.compile(r"(?<![\w.])[+-]?\d[\d_]{400,}(?![\w.])")
"""An integer of hundreds of digits; Python refuses to parse thousands, and no number of a scene has that many."""


def is_file(path: Path) -> bool:
    """Whether a readable file exists; False for a name that no file can have."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def is_folder(path: Path) -> bool:
    """Whether a readable folder exists; False for a name that no folder can have."""
    try:
        return path.is_dir()
    except (OSError, ValueError):
        return False


def from_home(path: str | Path) -> Path:
    """Replace a leading "~" by the home folder; unchanged if the user does not exist."""
    try:
        return Path(path).expanduser()
    except RuntimeError:
        return Path(path)


def parse_toml(text: str) -> dict[str, Any]:
    """Parse TOML to tables.

    Raises:
        ValueError: the text is not TOML, or nested too deep.
    """
    try:
        tables = tomllib.loads(text)
    except RecursionError:
        raise ValueError(f"it is nested deeper than {DEEPEST} tables or lists") from None
    except tomllib.TOMLDecodeError:
        raise
    except ValueError as error:
        raise ValueError("it has an integer of thousands of digits" if LONG_INTEGER.search(text) else error) from None
    level: list[Any] = [tables]
    for _ in range(DEEPEST):
        level = [inner for entry in level for inner in (entry.values() if isinstance(entry, dict) else entry)]
        level = [entry for entry in level if isinstance(entry, dict | list)]
        if not level:
            return tables
    raise ValueError(f"it is nested deeper than {DEEPEST} tables or lists")


def read_toml(path: Path) -> dict[str, Any]:
    """Read the tables of a TOML file.

    Raises:
        OSError: the file cannot be read.
        ValueError: the file is not TOML, or nested too deep.
    """
    return parse_toml(path.read_text(encoding="utf-8"))


def read_arrays(path: str | Path) -> "dict[str, np.ndarray]":
    """Read the arrays of an .npz file by name; the checksum of each is compared before it is interpreted.

    Raises:
        OSError: the file cannot be read.
        ValueError: the file is damaged, or does not contain plain arrays.
    """
    import zipfile  # imported here, so that --help need not wait

    from numpy.lib.format import read_array

    try:
        with Path(path).open("rb") as file, zipfile.ZipFile(file) as archive:
            file.seek(-12 - len(archive.comment), io.SEEK_END)
            count = int.from_bytes(file.read(2), "little")
            if len(archive.namelist()) != count:  # a wrong length in the directory hides entries from zipfile
                raise ValueError(f"its directory has {len(archive.namelist())} arrays instead of {count}")
            if len(set(archive.namelist())) != count:
                raise ValueError("two of its arrays have one name")
            contents = {name.removesuffix(".npy"): archive.read(name) for name in archive.namelist()}
        return {name: read_array(io.BytesIO(content), allow_pickle=False) for name, content in contents.items()}
    except OSError:
        raise
    except Exception as error:  # of any kind: flags and versions of a damaged zip file lead to RuntimeError and more
        raise ValueError(f"not a whole .npz file: {error or type(error).__name__}") from error


# The folder for results that take long to make: the user's cache, or a folder for temporary files.
#
# Services, cron jobs and containers often have no home or a read-only home, in which Taichi itself crashes.

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
        status = folder.lstat()
        # Its content is executed: no other user may own it or write to it.
        own = stat.S_ISDIR(status.st_mode) and status.st_uid == user and not status.st_mode & 0o022
        if own and _can_be_written(folder):
            return folder
    except OSError:
        pass
    return Path(tempfile.mkdtemp(prefix="taichisoft-cache-"))


def _can_be_written(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


# Atomic writing: files get their names when complete, so that no reader sees a partial file.


@contextmanager
def named_os_errors(path: Path | str, error: type[TaichisoftError] = TaichisoftError) -> Iterator[None]:
    """Convert the operating system's errors within the context to errors about writing `path`.

    Raises:
        error: the operating system refused an operation.
    """
    try:
        yield
    except OSError as failure:
        raise error(f"{path}: cannot be written: {failure.strerror or failure}") from failure


def partial_path(path: Path) -> Path:
    """A unique path beside `path` for the partial file, which no other thread, process or machine uses."""
    return path.with_name(f".{path.name}.{uuid4().hex}.partial")


@contextmanager
def atomic_file(path: Path, error: type[TaichisoftError] = TaichisoftError) -> Iterator[Path]:
    """Yield a path beside `path` to write to; a complete file is then moved to `path`, an incomplete one removed.

    Raises:
        error: the file cannot be written; an existing file is unchanged.
    """
    partial = partial_path(path)
    try:
        with named_os_errors(path, error):
            yield partial
            partial.replace(path)
    finally:
        with suppress(OSError):
            partial.unlink(missing_ok=True)


# Checksums beside stored files, to detect changed or incomplete files.

SUFFIX = ".sha256"


def keep_checksum(path: Path) -> None:
    """Write the SHA-256 of a complete file beside it; a file without a checksum is incomplete.

    Raises:
        TaichisoftError: the checksum cannot be written.
    """
    with atomic_file(checksum_file(path)) as partial:
        partial.write_text(f"{_checksum(path)}  {path.name}\n", encoding="utf-8")


def is_as_kept(path: Path) -> bool:
    """Whether a file exists and matches the checksum beside it."""
    try:
        return checksum_file(path).read_text(encoding="utf-8").split(maxsplit=1)[:1] == [_checksum(path)]
    except (OSError, ValueError):
        return False


def checksum_file(path: Path) -> Path:
    """Path of the checksum of a file."""
    return path.with_name(path.name + SUFFIX)


def _checksum(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
