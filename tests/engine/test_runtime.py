"""The number of threads comes from outside and is checked."""

import os
import subprocess
import sys

import pytest
from conftest import PATIENCE

from taichisoft.errors import TaichisoftError

COMMAND = "import sys; from taichisoft.command_line import main; sys.argv = ['taichisoft', 'run', 'gripper']; main()"


def test_a_number_of_threads_that_is_none_is_refused_in_one_line() -> None:
    threads = "abc"
    shown = subprocess.run(
        [sys.executable, "-c", COMMAND],
        env={**os.environ, "TAICHISOFT_THREADS": threads},
        capture_output=True,
        text=True,
        timeout=PATIENCE,
    )
    assert shown.returncode == 2
    assert shown.stderr == (
        f"taichisoft: TAICHISOFT_THREADS = '{threads}': must be a whole number of threads, 1 or more, "
        "or 0 for all cores\n"
    )


@pytest.mark.parametrize("threads", ["-3", "0.5"])
def test_neither_a_negative_number_nor_a_fraction_is_a_number_of_threads(threads: str) -> None:
    from taichisoft.runtime.language import thread_count

    with pytest.raises(TaichisoftError, match=f"^TAICHISOFT_THREADS = '{threads}': must be a whole number"):
        thread_count(threads)


@pytest.mark.parametrize(("setting", "count"), [("3", 3), (" 2 ", 2)])
def test_a_number_of_threads_is_taken(setting: str, count: int) -> None:
    from taichisoft.runtime.language import thread_count

    assert thread_count(setting) == count


@pytest.mark.skipif(not hasattr(os, "sched_getaffinity"), reason="this system does not bind processes to cores")
def test_all_cores_are_those_that_the_process_may_use() -> None:
    code = (
        "import os; os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})\n"
        "from taichisoft.runtime.language import THREADS; print(THREADS)"
    )
    environment = {name: value for name, value in os.environ.items() if name != "TAICHISOFT_THREADS"}
    shown = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert shown.stdout.strip() == "1"
