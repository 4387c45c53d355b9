"""Tries with mistakes in them: each must end well, or in one line.

A try is drawn from its number alone, so that one that fails can be made again. Tries run in child processes, a batch in
each: a crash, and a try that takes too long, are failures like a traceback.
"""

import contextlib
import io
import json
import os
import shutil
import signal
import sys
import tempfile
import traceback
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from taichisoft.child_process import run_python

SECONDS = 60.0
"""Most processor time of a try [s]; one that waits for ever is ended with its batch."""
BATCH = 100
"""Tries in one process."""
LONGEST_LINE = 2000
"""Characters that an error may have."""
EXIT_CODES = (0, 1, 2)
KINDS = {
    "scenes": "taichisoft_benchmarks.faults.scenes",
    "command lines": "taichisoft_benchmarks.faults.command_lines",
    "mesh files": "taichisoft_benchmarks.faults.mesh_files",
    "STEP files": "taichisoft_benchmarks.faults.step_files",
}
"""What has mistakes in it, and the module whose `write_files` makes what all tries need, and whose `attempt` makes the
files of a try in the current folder and returns its command line."""


@dataclass(frozen=True)
class Failure:
    """A try that ended neither well nor in one line.

    Attributes:
        number: number of the try.
        what: the command line.
        problem: how it ended, in one line.
    """

    number: int
    what: str
    problem: str


class _TooLong(BaseException):
    """A try took more than SECONDS."""


def how_it_went(number: int, arguments: list[str]) -> Failure | None:
    """Type a command line: None where it ended well or in one line."""
    from taichisoft.command_line import main

    shown = " ".join(arguments)
    shown = shown if len(shown) <= 200 else shown[:197] + "..."
    before, errors, written = sys.argv, io.StringIO(), io.StringIO()
    sys.argv = ["taichisoft", *arguments]
    signal.signal(signal.SIGPROF, _raise_too_long)
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    try:
        with contextlib.redirect_stderr(errors), contextlib.redirect_stdout(written):
            main()
    except SystemExit as end:
        code = end.code if end.code is not None else 0
    except _TooLong:
        return Failure(number, shown, f"no end within {SECONDS:g} s of processor time")
    except BaseException as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        problem = f"{type(error).__name__}: {str(error)[:200]} ({place.filename}, line {place.lineno})"
        return Failure(number, shown, problem)
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        sys.argv = before
    told = [line for line in errors.getvalue().splitlines() if not line.startswith("taichisoft: TAICHISOFT_DISABLE")]
    if code not in EXIT_CODES:
        return Failure(number, shown, f"exit code {code}")
    if "Traceback" in errors.getvalue() and "plug-in" not in told[0]:
        return Failure(number, shown, f"a traceback: {told[-1][:200]}")
    shows_help = not told and "Usage:" in written.getvalue()  # of a command that wants another one after it
    if code == 2 and len(told) != 1 and not shows_help:
        return Failure(number, shown, f"{len(told)} lines of errors: {told[:2]}")
    if any(len(line) > LONGEST_LINE for line in told):
        return Failure(number, shown, f"an error of {max(map(len, told))} characters: {told[0][:100]}")
    return None


def _raise_too_long(_number: int, _frame: Any) -> None:
    raise _TooLong


def run_batch(kind: str, first: int, count: int) -> list[Failure]:
    """Make tries in this process, in a folder of its own."""
    module = import_module(KINDS[kind])
    failures = []
    folder, before = tempfile.mkdtemp(prefix="tries-"), Path.cwd()
    os.chdir(folder)
    try:
        module.write_files()
        for number in range(first, first + count):
            print(f"at {number}", file=sys.__stdout__, flush=True)
            failure = how_it_went(number, module.attempt(number))
            if failure is not None:
                failures.append(failure)
    finally:
        os.chdir(before)
        shutil.rmtree(folder, ignore_errors=True)
    return failures


def run_tries(kind: str, count: int, first: int = 0) -> list[Failure]:
    """Make tries in child processes; a batch that crashes goes on after the try that crashed it."""
    failures: list[Failure] = []
    done, end = first, first + count
    while done < end:
        size = min(BATCH, end - done)
        child = run_python(["-m", "taichisoft_benchmarks.faults.tries", kind, str(done), str(size)], SECONDS * size)
        lines = child.output.splitlines()
        reached = max((int(line.split()[1]) for line in lines if line.startswith("at ")), default=done)
        failures += [Failure(**json.loads(line)) for line in lines if line.startswith("{")]
        if child.problem:
            failures.append(Failure(reached, "", child.problem))
            done = reached + 1
        else:
            done += size
    return failures


if __name__ == "__main__":
    for found in run_batch(sys.argv[1], int(sys.argv[2]), int(sys.argv[3])):
        print(json.dumps(found.__dict__), file=sys.__stdout__)
