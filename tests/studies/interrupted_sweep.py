"""A sweep whose command is killed half-way, and then a worker of it when it was started again.

It needs Linux and the extra `studies`.
"""

import os
import signal
import subprocess
import time
from pathlib import Path

import psutil

from taichisoft.base import PYTHON

PLUGIN = """
import time

from taichisoft import Control, Controller, hookimpl

class Squeeze(Controller):
    def __init__(self, pressure: float = 7.0, pause: float = 0.0):
        self.pressure, self.pause = pressure, pause
    def control(self, observation):
        time.sleep(self.pause)
        return Control(pressure=dict.fromkeys(observation.pressures, self.pressure))

@hookimpl
def taichisoft_controllers():
    return {"squeeze": Squeeze}
"""


def interrupted_sweep(folder: Path, scene: Path, values: str, runs: int, pause: float) -> tuple[bool, int, int]:
    """Make a sweep in the folder "disturbed".

    Args:
        folder: where it goes.
        scene: scene that is run.
        values: what varies, as a key and the two ends of its range.
        runs: number of runs.
        pause: how long a run sleeps at every step, so that one of few steps does not end before it is killed [s].

    Returns:
        Whether every run has completed, how many had ended when the command was killed, and how many of these were made
        once more.
    """
    plugin, output = folder / "squeeze.py", folder / "disturbed"
    plugin.write_text(PLUGIN)
    words = [scene, "--plugin", plugin, "--controller", "squeeze", "--duration", "0.2", "--jobs", 1, "-o", output]
    keys = ["--vary", f"{values}:{runs}", "--set", f"controller.settings.pause={pause}"]
    command = [*map(str, (*PYTHON, "-m", "taichisoft", "study", "sweep", *words, *keys))]
    with (folder / "log.txt").open("ab") as log:
        process = subprocess.Popen(command, stdout=log, stderr=log, start_new_session=True)
        _wait_for(process, output, runs // 2)
        process.kill()
        process.wait()
        before = _ended(output)
        process = subprocess.Popen(command, stdout=log, stderr=log, start_new_session=True)
        _wait_for(process, output, len(before) + 1)
        os.kill(_worker_of(process.pid), signal.SIGKILL)
        complete = process.wait() == 0
    after = _ended(output)
    redone = sum(after[name] != stamp for name, stamp in before.items())
    return complete and len(after) == runs, len(before), redone


def _wait_for(process: "subprocess.Popen[bytes]", output: Path, count: int) -> None:
    while len(_ended(output)) < count and process.poll() is None:
        time.sleep(0.05)


def _ended(output: Path) -> dict[str, int]:
    """When the record of each run was written [ns], by its name."""
    return {path.parent.name: path.stat().st_mtime_ns for path in (output / "runs").glob("[!.]*/run.json")}


def _worker_of(pid: int) -> int:
    """The process of the pool below a process."""
    (worker,) = (
        child.pid
        for child in psutil.Process(pid).children(recursive=True)
        if "taichisoft.base.worker:_do_jobs" in " ".join(child.cmdline())
    )
    return worker
