"""Where no kernels have been left yet, one process compiles them; others wait, and go on while it does."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from conftest import PATIENCE

pytestmark = pytest.mark.skipif(os.name != "posix", reason="locks of files that end with their process")

PROGRAM = """
import sys, time
from pathlib import Path
import numpy as np
{before}
from taichisoft.runtime.launch import kernel
from taichisoft.runtime.language import Scalars, ti
@kernel
def fill(value: ti.f64, values: Scalars):
    for i in values:
        values[i] = value
values = np.zeros(3)
launches = 0
def launch():
    global launches
    launches += 1
    fill(float(launches), values)
    assert (values == launches).all()
launch()
print("launched", flush=True)
{after}
"""
UNTIL_STOPPED = """
while not Path('stop').exists():
    launch()
    time.sleep(0.01)  # about as a step's launches: it stays first for some 20 s
"""
FOR_EVER = "time.sleep(600)"
NO_LOCKS = """
import errno, fcntl
def flock(*arguments):
    raise OSError(errno.ENOLCK, "No locks available")
fcntl.flock = flock
"""
WAITS = "taichisoft: waits for another process, which compiles its kernels\n"

Start = Callable[..., "subprocess.Popen[str]"]


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Start]:
    """Starts a program in an empty folder of kernels, the same for all; they end with the test."""
    started = []

    def one(after: str = "", before: str = "") -> "subprocess.Popen[str]":
        file = tmp_path / f"program{len(started)}.py"
        file.write_text(PROGRAM.format(before=before, after=after))
        environment = {**os.environ, "TI_OFFLINE_CACHE_FILE_PATH": str(tmp_path / "kernels")}
        command = [sys.executable, str(file)]
        pipe = subprocess.PIPE
        started.append(subprocess.Popen(command, cwd=tmp_path, env=environment, stdout=pipe, stderr=pipe, text=True))
        return started[-1]

    yield one
    for process in started:
        process.kill()
        process.communicate()


def has_launched(process: "subprocess.Popen[str]") -> bool:
    return process.stdout.readline() == "launched\n"


def test_others_get_the_kernels_of_the_first_while_it_runs(start: Start, tmp_path: Path) -> None:
    first = start(UNTIL_STOPPED)
    assert has_launched(first)
    others = [start(), start()]
    for other in others:
        _, said = other.communicate(timeout=PATIENCE)
        assert (other.returncode, said) == (0, WAITS)  # nothing of a compilation
    assert first.poll() is None
    assert len(list((tmp_path / "kernels").glob("*.tic"))) == 1
    (tmp_path / "stop").touch()
    _, said = first.communicate(timeout=PATIENCE)
    assert first.returncode == 0, said


def test_when_the_first_is_killed_another_is_first(start: Start) -> None:
    first = start(FOR_EVER)
    assert has_launched(first)
    other = start()
    assert other.stderr.readline() == WAITS
    first.kill()
    _, said = other.communicate(timeout=PATIENCE)
    assert (other.returncode, said.count("\n")) == (0, 1)
    assert "compiles its kernels: 15 seconds or more" in said


def test_nobody_waits_for_a_first_that_compiles_nothing(start: Start) -> None:
    short = "from taichisoft.runtime import first_process\nfirst_process.IDLE = 0.5"
    first = start(FOR_EVER, short)
    assert has_launched(first)
    other = start(before=short)
    _, said = other.communicate(timeout=PATIENCE)
    assert other.returncode == 0
    assert said.startswith(f"{WAITS}taichisoft: the other process compiles nothing; this one compiles")
    assert first.poll() is None


def test_where_files_cannot_be_locked_everybody_compiles_and_says_so(start: Start, tmp_path: Path) -> None:
    process = start(before=NO_LOCKS)
    _, said = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0
    line = f"taichisoft: {tmp_path / 'kernels'} cannot be locked (No locks available): processes that start at once"
    assert said.startswith(line)
    assert len(list((tmp_path / "kernels").glob("*.tic"))) == 1
