"""Warnings and log messages on a console, one line each; does not import Taichi."""

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.text import Text

from taichisoft.terminal_text import plain, printable

PROJECT_LOGGER = "taichisoft"


def print_line(console: Console, line: str) -> None:
    """Print one line, without markup."""
    console.print(plain(line), soft_wrap=True)


def print_warning(console: Console, message: str) -> None:
    """Print a warning in one line, without markup."""
    console.print(Text.assemble(("warning: ", "yellow"), printable(message)), soft_wrap=True)


@contextmanager
def warnings_printed_to(console: Console) -> Iterator[None]:
    """Print Python's warnings by `print_warning` within the context."""
    with warnings.catch_warnings():
        warnings.showwarning = lambda message, *_, **__: print_warning(console, str(message))
        yield


@contextmanager
def logged_to(console: Console) -> Iterator[None]:
    """Print messages of the logger "taichisoft" and its children, one line each, within the context."""
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
        print_line(self._console, record.getMessage())
