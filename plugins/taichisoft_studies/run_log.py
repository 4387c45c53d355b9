"""The log of a run: everything that is printed while it is made, by Python, by Taichi and by gmsh."""

import logging
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from taichisoft.running import PROJECT_LOGGER


@contextmanager
def printed_to(path: Path) -> Iterator[None]:
    """Send standard output and error of this process, and the messages of our loggers, to the end of a file."""
    before = os.dup(1), os.dup(2)
    handler = logging.StreamHandler(sys.stderr)
    logger = logging.getLogger(PROJECT_LOGGER)
    logger.setLevel(logging.INFO)
    with path.open("ab") as log:
        os.dup2(log.fileno(), 1)
        os.dup2(log.fileno(), 2)
        logger.addHandler(handler)
        try:
            yield
        finally:
            logger.removeHandler(handler)
            sys.stdout.flush()
            sys.stderr.flush()
            for number, descriptor in enumerate(before, 1):
                os.dup2(descriptor, number)
                os.close(descriptor)
