"""Results that take long to make, kept in the user's cache for later processes; a damaged one is made anew."""

import functools
import hashlib
import os
import sys
import threading
from contextlib import suppress
from pathlib import Path

from taichisoft.cache_folder import cache_folder
from taichisoft.caller_warnings import warn_caller


@functools.cache
def kept_folder(kind: str) -> Path:
    """The folder for results of a kind."""
    folder = cache_folder() / kind
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
    return folder


def read_kept(path: Path) -> bytes | None:
    """What was kept in a file, if it is there and whole."""
    try:
        checksum, _, data = path.read_bytes().partition(b"\n")
    except OSError:
        return None
    if hashlib.sha256(data).hexdigest().encode() == checksum:
        return data
    _tell_of_damage(path)
    return None


def keep(path: Path, data: bytes) -> None:
    """Keep data in a file, which gets its name when it is complete; where it cannot be written, a warning says so."""
    partial = path.with_name(f".{path.name}.{os.getpid()}.{threading.get_ident()}")
    try:
        partial.write_bytes(hashlib.sha256(data).hexdigest().encode() + b"\n" + data)
        partial.replace(path)
    except OSError as error:
        with suppress(OSError):
            partial.unlink(missing_ok=True)
        _warn_of(path.parent, error.strerror or str(error))


@functools.cache
def _tell_of_damage(path: Path) -> None:
    print(f"taichisoft: {path} is damaged and is made anew", file=sys.stderr)


@functools.cache
def _warn_of(folder: Path, why: str) -> None:
    warn_caller(f"nothing can be kept in {folder} ({why}), and every start takes longer")
