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


@pytest.mark.parametrize(("setting", "count"), [("3", 3), (" 2 ", 2)])
def test_a_number_of_threads_is_taken(setting: str, count: int) -> None:
    from taichisoft.kernels.runtime import thread_count

    assert thread_count(setting) == count


@pytest.mark.skipif(not hasattr(os, "sched_getaffinity"), reason="this system does not bind processes to cores")
def test_all_cores_are_those_that_the_process_may_use() -> None:
    code = (
        "import os; os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})\n"
        "from taichisoft.kernels.runtime import THREADS; print(THREADS)"
    )
    environment = {name: value for name, value in os.environ.items() if name != "TAICHISOFT_THREADS"}
    shown = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert shown.stdout.strip() == "1"
