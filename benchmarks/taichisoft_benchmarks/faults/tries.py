"""Command lines with mistakes, or about files with mistakes: each must end well, or in one line.

A try is drawn from its number alone, so that a failure can be repeated: `python -m taichisoft_benchmarks.faults.tries
KIND FIRST COUNT`. Tries run in child processes, a batch in each: a crash and a hang are failures like a traceback.
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
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from taichisoft.base import run_python
from taichisoft_benchmarks.faults import broken_meshes, command_lines, mistaken_scenes

SECONDS = 60.0
"""Most processor time of a try [s]; a try that sleeps for ever is ended with its batch."""
BATCH = 100
"""Tries in one process."""
LONGEST_LINE = 2000
"""Characters that an error may have."""
EXIT_CODES = (0, 1, 2)
KINDS: dict[str, tuple[Callable[[], None], Callable[[int], list[str]]]] = {
    "scenes": (lambda: None, mistaken_scenes.attempt),
    "command lines": (command_lines.write_files, command_lines.attempt),
    "mesh files": (broken_meshes.write_files, broken_meshes.attempt),
    "STEP files": (broken_meshes.write_step_file, broken_meshes.attempt_step_file),
}
"""A function that writes the files that all tries need, and one that writes the files of a try and returns its command
line; both work in the current folder."""


class _TooLong(BaseException):
    """A try took more than SECONDS."""


def how_it_went(arguments: list[str]) -> str:
    """Run a command line in this process; returns the failure, empty if it ended well or in one line."""
    from taichisoft.command_line import main

    before, errors, written = sys.argv, io.StringIO(), io.StringIO()
    sys.argv = ["taichisoft", *arguments]
    signal.signal(signal.SIGPROF, _raise_too_long)
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    try:
        with contextlib.redirect_stderr(errors), contextlib.redirect_stdout(written):
            main()
        return "main returned"
    except SystemExit as end:
        problem = _problem(end.code if end.code is not None else 0, errors.getvalue(), written.getvalue())
    except _TooLong:
        problem = f"no end within {SECONDS:g} s of processor time"
    except BaseException as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        problem = f"{type(error).__name__}: {str(error)[:200]} ({place.filename}, line {place.lineno})"
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        sys.argv = before
    return f"{' '.join(arguments)[:200]}: {problem}" if problem else ""


def _problem(code: Any, errors: str, written: str) -> str:
    """The failure that an exit code and the written text show; empty if they show none."""
    lines = [line for line in errors.splitlines() if not line.startswith("taichisoft: TAICHISOFT_DISABLE")]
    if code not in EXIT_CODES:
        return f"exit code {code}"
    if "Traceback" in errors and "plug-in" not in lines[0]:
        return f"a traceback: {lines[-1][:200]}"
    shows_help = not lines and "Usage:" in written  # of a command that needs a subcommand
    if code == 2 and len(lines) != 1 and not shows_help:
        return f"{len(lines)} lines of errors: {lines[:2]}"
    if any(len(line) > LONGEST_LINE for line in lines):
        return f"an error of {max(map(len, lines))} characters: {lines[0][:100]}"
    return ""


def _raise_too_long(_number: int, _frame: Any) -> None:
    raise _TooLong


def run_batch(kind: str, first: int, count: int) -> list[str]:
    """Make tries in this process, in a folder of its own; returns a line for each failure."""
    write_files, attempt = KINDS[kind]
    failures = []
    folder, before = tempfile.mkdtemp(prefix="tries-"), Path.cwd()
    os.chdir(folder)
    try:
        write_files()
        for number in range(first, first + count):
            print(f"at {number}", file=sys.__stdout__, flush=True)
            if failure := how_it_went(attempt(number)):
                failures.append(f"{number}: {failure}")
    finally:
        os.chdir(before)
        shutil.rmtree(folder, ignore_errors=True)
    return failures


def run_tries(kind: str, count: int) -> list[str]:
    """Make tries in child processes; after a crash the next batch begins behind the try that crashed."""
    failures: list[str] = []
    done = 0
    while done < count:
        size = min(BATCH, count - done)
        child = run_python(["-m", "taichisoft_benchmarks.faults.tries", kind, str(done), str(size)], SECONDS * size)
        lines = child.output.splitlines()
        failures += [json.loads(line) for line in lines if line.startswith('"')]
        if child.problem:
            done = max((int(line.split()[1]) for line in lines if line.startswith("at ")), default=done)
            failures.append(f"{done}: {child.problem}")
            size = 1
        done += size
    return failures


ROWS = {
    "scenes with one to three mistakes": (1000, partial(run_tries, "scenes")),
    "command lines with wrong names, values and files": (1000, partial(run_tries, "command lines")),
    "files of meshes and surfaces with wrong numbers, bytes and lines, or cut off": (
        300,
        partial(run_tries, "mesh files"),
    ),
    "STEP files of the same kinds": (36, partial(run_tries, "STEP files")),
}

if __name__ == "__main__":
    for found in run_batch(sys.argv[1], int(sys.argv[2]), int(sys.argv[3])):
        print(json.dumps(found), file=sys.__stdout__)
