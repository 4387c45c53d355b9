"""Running Python in a child process, where a hang or a crash of a native library can do no harm."""

import signal
import subprocess
import sys
from dataclasses import dataclass


@dataclass(frozen=True)
class ChildResult:
    """How a child process ended.

    Attributes:
        problem: one line; empty when it ended well.
        output: what it wrote to standard output.
    """

    problem: str
    output: str = ""


def run_python(arguments: list[str], time_limit: float) -> ChildResult:
    """Run this Python with `arguments`; kill it after `time_limit` [s]."""
    try:
        child = subprocess.run(
            [sys.executable, *arguments],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=time_limit,
        )
    except subprocess.TimeoutExpired:
        return ChildResult(f"no answer within {time_limit:g} s")
    if child.returncode < 0:
        return ChildResult(f"the process was ended by {signal.Signals(-child.returncode).name}", child.stdout)
    if child.returncode > 0:
        lines = child.stderr.strip().splitlines()
        return ChildResult(lines[-1] if lines else f"exit code {child.returncode}", child.stdout)
    return ChildResult("", child.stdout)
