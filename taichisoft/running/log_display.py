"""What is logged while a command works, shown on its console."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.text import Text

PROJECT_LOGGER = "taichisoft"


@contextmanager
def logged_to(console: Console) -> Iterator[None]:
    """Print each message of the logger "taichisoft" and those below it as one line, as long as it lasts."""
    logger, handler = logging.getLogger(PROJECT_LOGGER), _ConsoleHandler(console)
    level_before = logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    try:
        yield
    finally:
        logger.setLevel(level_before)
        logger.removeHandler(handler)


class _ConsoleHandler(logging.Handler):
    def __init__(self, console: Console):
        super().__init__()
        self._console = console

    def emit(self, record: logging.LogRecord) -> None:
        self._console.print(Text(record.getMessage()), soft_wrap=True)
