"""Checksums beside stored files, to detect changed or incomplete files."""

import hashlib
from pathlib import Path

from taichisoft.atomic_file import atomic_file

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
