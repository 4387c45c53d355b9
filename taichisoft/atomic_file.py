"""Atomic writing: files get their names when complete, so that no reader sees a partial file."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from uuid import uuid4

from taichisoft.errors import TaichisoftError


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
