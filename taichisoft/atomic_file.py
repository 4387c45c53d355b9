"""Files that appear under their names when they are complete, so that nobody ever reads half of one."""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from taichisoft.errors import TaichisoftError


@contextmanager
def named_os_errors(path: Path, error: type[TaichisoftError] = TaichisoftError) -> Iterator[None]:
    """What the operating system refuses here is an error about writing `path`.

    Raises:
        error: An OSError was raised here.
    """
    try:
        yield
    except OSError as failure:
        raise error(f"{path}: cannot be written: {failure.strerror or failure}") from failure


@contextmanager
def whole_file(path: Path, error: type[TaichisoftError] = TaichisoftError) -> Iterator[Path]:
    """A place beside `path` to write to; what is there in the end is moved to `path`, what was half done is removed.

    Raises:
        error: the file cannot be written; the old one, if there was one, is as it was.
    """
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        with named_os_errors(path, error):
            yield partial
            partial.replace(path)
    finally:
        with suppress(OSError):
            partial.unlink(missing_ok=True)
