"""Child processes, in which a hang or a crash of a native library can do no harm, and how they ended in one line."""

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

PYTHON = (sys.executable, "-P")
"""This Python, which takes no modules from the current folder, as the command that starts it takes none.

A user's script there may be called `gmsh.py`, and the folder may come from somebody else."""


@dataclass(frozen=True)
class ChildResult:
    """How a child process ended.

    Attributes:
        problem: one line that says what went wrong; empty when the process ended well.
        output: what the process wrote to standard output.
    """

    problem: str
    output: str = ""


def run_python(
    arguments: Sequence[str | Path],
    time_limit: float,
    environment: Mapping[str, str] | None = None,
    folder: Path | None = None,
) -> ChildResult:
    """Run this Python in a child process, and kill it when it takes too long.

    Args:
        arguments: what Python is started with.
        time_limit: longest duration [s].
        environment: its environment variables; ours when they are not given.
        folder: where it runs; our current folder when it is not given.
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


@contextmanager
def lifeline() -> Iterator[int]:
    """Give the standard input of a child process that calls `end_with_parent`: it closes when this process ends.

    However that happens, since the operating system closes it; within `with`, nothing is ever written to it.
    """
    watched, held = os.pipe()
    try:
        yield watched
    finally:
        os.close(watched)
        os.close(held)


def end_with_parent() -> None:
    """End this process at once when its standard input closes, see `lifeline`: nobody waits for its answer any more."""

    def wait() -> None:
        while os.read(0, 1):
            pass
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()


def how_it_ended(exit_code: int, errors: str | bytes) -> str:
    """One line that says why a process failed, from its exit code and its standard error; empty when it did not."""
    if exit_code < 0:
        return f"the process was ended by {signal.Signals(-exit_code).name}"
    return (last_line(errors) or f"exit code {exit_code}") if exit_code else ""


def last_line(text: str | bytes) -> str:
    """The last line of what a process has written; empty when it has written nothing."""
    text = text.decode(errors="replace") if isinstance(text, bytes) else text
    return (text.strip().splitlines() or [""])[-1]
