"""Taichi's start: the number of threads comes from outside and is checked before Taichi sees it."""

import os
import subprocess
import sys

import pytest

COMMAND = "import sys; from taichisoft.command_line import main; sys.argv = ['taichisoft', 'run', 'gripper']; main()"


@pytest.mark.parametrize("threads", ["abc", "-3", "0.5"])
def test_a_number_of_threads_that_is_none_is_refused_in_one_line(threads: str) -> None:
    shown = subprocess.run(
        [sys.executable, "-c", COMMAND],
        env={**os.environ, "TAICHISOFT_THREADS": threads},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert shown.returncode == 2
    assert shown.stderr == (
        f"taichisoft: TAICHISOFT_THREADS = '{threads}': must be a whole number of threads, 1 or more, "
        "or 0 for all cores\n"
    )


@pytest.mark.parametrize(("setting", "count"), [("3", 3), (" 2 ", 2), ("0", os.cpu_count())])
def test_a_number_of_threads_is_taken(setting: str, count: int) -> None:
    from taichisoft.kernels.runtime import thread_count

    assert thread_count(setting) == count
