"""Files that appear under their names when they are complete, so that nobody ever reads half of one."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from uuid import uuid4

from taichisoft.errors import TaichisoftError


@contextmanager
def named_os_errors(path: Path | str, error: type[TaichisoftError] = TaichisoftError) -> Iterator[None]:
    """Make an error about writing `path` of what the operating system refuses.

    Raises:
        error: something was refused.
    """
    try:
        yield
    except OSError as failure:
        raise error(f"{path}: cannot be written: {failure.strerror or failure}") from failure


def partial_path(path: Path) -> Path:
    """A name beside `path` for what becomes it when it is complete: of no other thread, process or machine."""
    return path.with_name(f".{path.name}.{uuid4().hex}.partial")


@contextmanager
def atomic_file(path: Path, error: type[TaichisoftError] = TaichisoftError) -> Iterator[Path]:
    """Give a place beside `path` to write to; a complete file is then moved to `path`, an incomplete one removed.

    Raises:
        error: the file cannot be written; the old one, if there was one, is as it was.
    """
    partial = partial_path(path)
    try:
        with named_os_errors(path, error):
            yield partial
            partial.replace(path)
    finally:
        with suppress(OSError):
            partial.unlink(missing_ok=True)
