"""Checksums beside files that are kept: whether one is still as it was written."""

import hashlib
from pathlib import Path

from taichisoft.atomic_file import atomic_file

SUFFIX = ".sha256"


def keep_checksum(path: Path) -> None:
    """Write the SHA-256 of a file beside it, after the file itself: a file without one was not finished.

    Raises:
        TaichisoftError: it cannot be written.
    """
    with atomic_file(checksum_file(path)) as partial:
        partial.write_text(f"{_checksum(path)}  {path.name}\n", encoding="utf-8")


def is_as_kept(path: Path) -> bool:
    """Whether a file is there, with the checksum that was written beside it."""
    try:
        return checksum_file(path).read_text(encoding="utf-8").split(maxsplit=1)[:1] == [_checksum(path)]
    except (OSError, ValueError):
        return False


def checksum_file(path: Path) -> Path:
    """Where the checksum of a file is."""
    return path.with_name(path.name + SUFFIX)


def _checksum(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
