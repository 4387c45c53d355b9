"""Child processes: how one ended, and signals that wait until nothing is half done."""

import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

# Interruption of a run by Ctrl and c, a batch system's SIGTERM or the end of the terminal, between steps only.

HANG_UP = getattr(signal, "SIGHUP", None)  # Windows has none
SIGNALS = (signal.SIGINT, signal.SIGTERM, *([HANG_UP] if HANG_UP is not None else []))

_came: list[int] = []
"""Signals noted but not yet acted upon."""


def stop_if_asked() -> None:
    """Raise KeyboardInterrupt if a signal was noted; called between steps, and between the parts of a step.

    A step stores its new state at its end, so an interrupted step has changed nothing. As in Python, signals are for
    the main thread; other threads continue.
    """
    if _came and _is_main_thread():
        raise KeyboardInterrupt


@contextmanager
def deferred_signals() -> Iterator[Callable[[], None]]:
    """Note the first signal within the context instead of raising it; yields `stop_if_asked`, which raises it.

    So the outputs contain either all of a step or nothing of it. A second signal raises at once, but for a hang-up: a
    terminal that closes sends it twice. Ignored signals stay ignored, and outside the main thread nothing is deferred,
    because Python calls handlers only there.
    """

    if not _is_main_thread():
        yield stop_if_asked
        return

    def note(number: int, _frame: Any) -> None:
        if number != HANG_UP:
            stop_if_asked()
        _came.append(number)

    noted_outside = _came.copy()
    _came.clear()
    try:
        with _handled_by(note):
            yield stop_if_asked
    finally:
        _came[:] = noted_outside


@contextmanager
def interrupted_by_signals() -> Iterator[None]:
    """Raise KeyboardInterrupt for SIGTERM and a hang-up within the context, as for Ctrl and c, so that all is ended."""

    def interrupt(number: int, _frame: Any) -> None:
        if number == HANG_UP:
            signal.signal(number, signal.SIG_IGN)
        raise KeyboardInterrupt

    if not _is_main_thread():
        yield
        return
    with _handled_by(interrupt):
        yield


@contextmanager
def _handled_by(handler: Callable[[int, Any], None]) -> Iterator[None]:
    """Handle all signals that are not ignored."""
    handled = [number for number in SIGNALS if signal.getsignal(number) not in (signal.SIG_IGN, None)]
    before = {number: signal.signal(number, handler) for number in handled}
    try:
        yield
    finally:
        for number, earlier in before.items():
            signal.signal(number, earlier)


def _is_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()


# Child processes, which confine hangs and crashes of native libraries, and their failures in one line.

PYTHON = (sys.executable, "-P")
"""This Python, without the current folder in its path for modules, like the parent.

A user's script in that folder may be called `gmsh.py`, and the folder may come from another person."""


@dataclass(frozen=True)
class ChildResult:
    """Result of a child process.

    Attributes:
        problem: error in one line; empty on success.
        output: standard output of the process.
    """

    problem: str
    output: str = ""


def run_python(
    arguments: Sequence[str | Path],
    time_limit: float,
    environment: Mapping[str, str] | None = None,
    folder: Path | None = None,
) -> ChildResult:
    """Run this Python in a child process, and kill it after a time limit.

    Args:
        arguments: arguments of Python.
        time_limit: longest duration [s].
        environment: environment variables of the child; None: the parent's.
        folder: current folder of the child; None: the parent's.
    """
    try:
        child = subprocess.run(
            [*PYTHON, *arguments],
            env=environment,
            cwd=folder,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=time_limit,
        )
    except subprocess.TimeoutExpired:
        return ChildResult(f"no answer within {time_limit:g} s")
    return ChildResult(how_it_ended(child.returncode, child.stderr), child.stdout)


def how_it_ended(exit_code: int, errors: str | bytes) -> str:
    """The reason of a failure in one line, from exit code and standard error; empty on success."""
    if exit_code < 0:
        return f"the process was ended by {signal.Signals(-exit_code).name}"
    return (last_line(errors) or f"exit code {exit_code}") if exit_code else ""


def last_line(text: str | bytes) -> str:
    """The last line of a process's output; empty without output."""
    text = text.decode(errors="replace") if isinstance(text, bytes) else text
    return (text.strip().splitlines() or [""])[-1]
