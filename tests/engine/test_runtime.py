"""Taichi's start: the number of threads comes from outside and is checked before Taichi sees it."""

import os
import subprocess
import sys
from pathlib import Path

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


KERNEL = """
import numpy as np
from taichisoft.runtime.launch import kernel
from taichisoft.runtime.language import Scalars
@kernel
def fill(values: Scalars):
    for i in values:
        values[i] = {value}
values = np.zeros(3)
fill(values)
assert values[0] == {value}
"""


def test_processes_that_start_at_once_all_keep_their_kernels_and_say_nothing(tmp_path: Path) -> None:
    """So they do where one was killed while it had the list of kernels: Taichi's own lock has been left there."""
    folder = tmp_path / "kernels"
    folder.mkdir()
    (folder / "ticache.lock").touch()
    environment = {**os.environ, "TI_OFFLINE_CACHE_FILE_PATH": str(folder)}
    started = []
    for value in range(4):
        file = tmp_path / f"{value}.py"  # Taichi reads the source of a kernel from its file
        file.write_text(KERNEL.format(value=value))
        command = [sys.executable, str(file)]
        started.append(subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT))
    said = [process.communicate(timeout=PATIENCE)[0] for process in started]
    assert [process.returncode for process in started] == [0] * 4, said
    assert [one for one in said if one and b"compiles its kernels" not in one] == []
    assert len(list(folder.glob("*.tic"))) == 4
    assert not (folder / "ticache.lock").exists()


def test_without_a_place_for_kernels_a_run_is_slow_to_start_and_says_so(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "program.py").write_text(KERNEL.format(value=1))
    folder = tmp_path / "file" / "kernels"
    environment = {**os.environ, "TI_OFFLINE_CACHE_FILE_PATH": str(folder), "TMPDIR": str(tmp_path)}
    command = [sys.executable, str(tmp_path / "program.py")]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=PATIENCE)
    assert (done.returncode, done.stdout) == (0, "")
    assert f"compiled kernels cannot be kept in {folder} (Not a directory) and every start takes" in done.stderr
    assert "ticache.lock" not in done.stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "program.py"]


def test_at_the_end_no_file_is_left_open(tmp_path: Path) -> None:
    environment = {**os.environ, "TI_OFFLINE_CACHE_FILE_PATH": str(tmp_path)}
    command = [sys.executable, "-W", "always::ResourceWarning", "-c", "import taichisoft.runtime.kernel_cache"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=PATIENCE)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
