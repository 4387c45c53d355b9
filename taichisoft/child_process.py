"""Child processes, which confine hangs and crashes of native libraries, and their failures in one line."""

import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

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
