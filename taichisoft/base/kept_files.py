"""Results that take long to make, kept in the user's cache for later processes; a damaged one is made anew."""

import functools
import hashlib
import io
import os
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from taichisoft.base.files import cache_folder
from taichisoft.base.text import warn_caller

OLD = 90 * 86400.0
"""Age at which results, most of them of earlier versions, are removed [s]."""


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
        for other in path.parent.iterdir():
            if time.time() - other.stat().st_mtime > OLD:
                other.unlink()
    except FileNotFoundError:  # another process has removed it
        pass
    except OSError as error:
        with suppress(OSError):
            partial.unlink(missing_ok=True)
        _warn_of(path.parent, error.strerror or str(error))


def kept_arrays(
    kind: str, depends_on: Sequence[bytes], make: Callable[[], Sequence[np.ndarray]]
) -> tuple[np.ndarray, ...]:
    """The arrays that `make` gives, kept from an earlier process if there `depends_on` was the same."""
    key = hashlib.sha256()
    for part in depends_on:
        key.update(len(part).to_bytes(8) + part)
    path = kept_folder(kind) / f"{key.hexdigest()}.npz"
    if (data := read_kept(path)) is not None:
        return tuple(np.load(io.BytesIO(data)).values())
    arrays = make()
    stream = io.BytesIO()
    np.savez(stream, *arrays)
    keep(path, stream.getvalue())
    return tuple(arrays)


@functools.cache
def source_of(file: str) -> bytes:
    """Source of a module, on which what it makes depends."""
    return Path(file).read_bytes()


@functools.cache
def _tell_of_damage(path: Path) -> None:
    print(f"taichisoft: {path} is damaged and is made anew", file=sys.stderr)


@functools.cache
def _warn_of(folder: Path, why: str) -> None:
    warn_caller(f"nothing can be kept in {folder} ({why}), and every start takes longer")
