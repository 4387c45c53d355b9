"""A sweep whose workers are killed at random, and then the whole command, which is started again.

It needs Linux and the extra `studies`.
"""

import os
import random
import signal
import subprocess
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from taichisoft.base import PYTHON
from taichisoft.pytest_fixtures import TINY_GRIPPER

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


PRESSURES = "controller.settings.pressure=1:8"


@dataclass(frozen=True)
class DisturbedSweep:
    """Outcome of a sweep that was disturbed.

    Attributes:
        complete: whether every run has completed.
        redone: runs that had ended before the command was killed, and were made once more.
        kills: workers that were killed.
        ended_before: runs that had ended when the command was killed.
    """

    complete: bool
    redone: int
    kills: int
    ended_before: int


def interrupted_sweep(
    folder: Path,
    runs: int,
    kills: int,
    seed: int,
    workers: int = 2,
    scene: Path = TINY_GRIPPER,
    values: str = PRESSURES,
    pause: float = 0.0,
) -> DisturbedSweep:
    """Make a sweep, kill workers and the command, and start it again.

    Args:
        folder: a new folder for it; the sweep's own is "disturbed" in it.
        runs: number of runs.
        kills: workers that are killed, half of them before the command is.
        seed: of the choice and the moments of the kills.
        workers: workers at a time.
        scene: scene that is run.
        values: what varies, as a key and the two ends of its range.
        pause: how long a run sleeps at every step, so that one of few steps does not end before it is killed [s].
    """
    folder.mkdir(parents=True, exist_ok=True)
    plugin = folder / "squeeze.py"
    plugin.write_text(PLUGIN)
    chance = random.Random(seed)
    disturbed = folder / "disturbed"
    values = f"{values}:{runs}"
    process = _start(plugin, disturbed, scene, values, workers, pause)
    done = _kill_workers(process, disturbed, kills // 2, 0, runs // 2, chance)
    _wait_for(process, disturbed, runs // 2)
    process.kill()
    process.wait()
    ended = _ended(disturbed)
    process = _start(plugin, disturbed, scene, values, workers, pause)
    done += _kill_workers(process, disturbed, kills - kills // 2, len(ended), runs, chance)
    complete = process.wait() == 0
    redone = sum(ended[name] != stamp for name, stamp in _ended(disturbed).items() if name in ended)
    return DisturbedSweep(complete and len(_ended(disturbed)) == runs, redone, done, len(ended))


def _start(
    plugin: Path, output: Path, scene: Path, values: str, workers: int, pause: float = 0.0
) -> "subprocess.Popen[bytes]":
    arguments = [scene, "--plugin", plugin, "--controller", "squeeze", "--duration", "0.2", "-j", workers]
    keys = ["--vary", values, "--set", f"controller.settings.pause={pause}"]
    command = [*PYTHON, "-m", "taichisoft", "study", "sweep", *arguments, *keys, "-o", output]
    with (plugin.parent / f"{output.name}.log").open("ab") as log:
        return subprocess.Popen([*map(str, command)], stdout=log, stderr=log, start_new_session=True)


def _kill_workers(
    process: "subprocess.Popen[bytes]",
    output: Path,
    kills: int,
    first: int,
    last: int,
    chance: random.Random,
) -> int:
    """Kill a random worker whenever the next share of the runs has ended."""
    done = 0
    for number in range(kills):
        _wait_for(process, output, first + (last - first) * number // max(kills, 1) + 1)
        time.sleep(chance.uniform(0.0, 0.5))
        victims = _workers_of(process.pid)
        if victims:
            os.kill(chance.choice(victims), signal.SIGKILL)
            done += 1
    return done


def _wait_for(process: "subprocess.Popen[bytes]", output: Path, count: int) -> None:
    while len(_ended(output)) < count and process.poll() is None:
        time.sleep(0.05)


def _ended(output: Path) -> dict[str, int]:
    """When the record of each run was written [ns], by its name."""
    return {path.parent.name: path.stat().st_mtime_ns for path in (output / "runs").glob("[!.]*/run.json")}


def _workers_of(pid: int) -> Sequence[int]:
    """Processes of a pool below a process."""
    import psutil

    found = []
    for child in psutil.Process(pid).children(recursive=True):
        try:
            words = " ".join(child.cmdline())
        except psutil.Error:  # it has just ended
            continue
        if "taichisoft.base.worker:_do_jobs" in words:
            found.append(child.pid)
    return sorted(found)
