"""A run that is steered from a real terminal: keys lift the cube, and the terminal is as before after every end."""

import json
import os
import signal
import sys
from pathlib import Path

import pytest
from terminal import Terminal, terminal

# The shell says which process becomes the run.
COMMAND = (
    *("sh", "-c", 'echo "process $$"; exec "$@"', "sh"),
    *(sys.executable, "-c", "from taichisoft.command_line import main; main()"),
    *("run", "--controller", "keyboard", "--output", "results"),
)
INTERRUPTED = 130


def started(screen: Terminal) -> int:
    """Wait for the first steps; returns the process number."""
    number = int(screen.wait_for(r"process (\d+)")[1])
    wait_for_time(screen, 0.05)
    assert screen.is_for_keys
    return number


def wait_for_time(screen: Terminal, time: float) -> None:
    """Wait until the live status shows a simulated time [s]."""
    while float(screen.wait_for(r"(\d+\.\d\d) s")[1]) < time:
        pass


def test_the_cube_is_lifted_by_keys_and_ctrl_and_c_ends_the_run(tmp_path: Path) -> None:
    """50 kPa and 30 mm, as in the scripted grasp: the base rises by ten presses of the arrow, and the cube with it."""
    with terminal(*COMMAND, "gripper", folder=tmp_path) as screen:
        started(screen)
        screen.type(50 * "+")
        screen.wait_for(r"50\.0 kPa")
        wait_for_time(screen, 1.5)
        for _ in range(10):
            screen.type("\x1b[A")
        screen.wait_for(r"lifted by (2[5-9]|30)\.\d mm")
        wait_for_time(screen, float(screen.wait_for(r"(\d+\.\d\d) s")[1]) + 0.3)  # until the base has arrived
        screen.type("\x03")
        screen.wait_for(f"shell: exit code {INTERRUPTED}")
        assert screen.is_as_before
    metrics = json.loads((tmp_path / "results" / "metrics.json").read_text())
    assert metrics["outcome"] == "interrupted"
    assert metrics["base_lift_mm"] == pytest.approx(30.0)
    assert metrics["object_lift_mm"] > 25.0
    keys = [json.loads(line) for line in (tmp_path / "results" / "keys.jsonl").read_text().splitlines()]
    assert [line.get("key") for line in keys] == [*50 * ["+"], *10 * ["up"], None]


FAILING_PLUGIN = """
from taichisoft.running.hookspecs import hookimpl

@hookimpl
def taichisoft_step_done(report):
    if report.step == 20:
        raise ValueError("a mistake in a plug-in")
"""


def test_after_an_exception_the_terminal_is_as_before(falling_cube: Path, tmp_path: Path) -> None:
    (tmp_path / "failing.py").write_text(FAILING_PLUGIN)
    with terminal(*COMMAND, str(falling_cube), "--plugin", "failing.py", folder=tmp_path) as screen:
        started(screen)
        screen.wait_for("a mistake in a plug-in")
        screen.wait_for("shell: exit code 1")
        assert screen.is_as_before
    assert json.loads((tmp_path / "results" / "metrics.json").read_text())["steps"] == 21


def test_killed_run_is_whole_and_restores_the_terminal(falling_cube: Path, tmp_path: Path) -> None:
    """What no program can handle is tested in test_terminal_keys.py, with a program that starts faster."""
    with terminal(*COMMAND, str(falling_cube), folder=tmp_path) as screen:
        os.kill(started(screen), signal.SIGTERM)
        screen.wait_for(f"shell: exit code {INTERRUPTED}")
        assert screen.is_as_before
    assert json.loads((tmp_path / "results" / "metrics.json").read_text())["outcome"] == "interrupted"
