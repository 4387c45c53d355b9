"""Recordings whose process is killed, and recordings that are damaged."""

import os
import random
import signal
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

STEPS = 150
"""Of the run that is recorded: one whole bundle of frames, and half of one."""
LIMIT = 5.0
"""Time within which a damaged recording must be told of [s]."""

Run = tuple[Any, Any, Sequence[tuple[Any, Any]]]
"""Model, first state, and the state and the report of every step."""


def tiny_run(steps: int) -> Run:
    """The fixture's tiny gripper, which closes on its cube."""
    from taichisoft.building.scene_files import load_scene
    from taichisoft.building.simulation import Simulation
    from taichisoft.control.control import Control
    from taichisoft.pytest_fixtures import TINY_GRIPPER

    simulation = Simulation(load_scene(TINY_GRIPPER))
    first, made = simulation.state, []
    for step in range(steps):
        names = simulation.model.cavities.names
        report = simulation.step(Control(pressure=dict.fromkeys(names, min(0.1 * step, 9.0))))
        _ = report.observation  # now, since a forked process must not start kernels
        made.append((simulation.state, report))
    return simulation.model, first, made


def record(run: Run, folder: Path) -> None:
    """Record a run."""
    from taichisoft_plugins.recording.output import RecordingOutput

    model, first, steps = run
    output = RecordingOutput(folder)
    output.begin(model, first)
    for state, report in steps:
        output.record(state, report)
    output.end("completed")


def readable(path: Path) -> bool:
    """Whether every frame of a recording can be read, and is what was written."""
    from taichisoft_plugins.recording.layout import RecordingError
    from taichisoft_plugins.recording.reader import read_recording

    try:
        with read_recording(path) as recording:
            recording.rows_of_frames(0, recording.frame_count)
            return bool(recording.soft_bodies)
    except RecordingError:
        return False


def kills(run: Run, folder: Path, tries: int) -> int:
    """Kill a process that records again and again into one folder, at random moments; how often was something lost?

    To begin and to close take most of the time of so short a run, so that most kills fall into these windows.
    """
    record(run, folder)
    lost = 0
    chance = random.Random(1)
    for _ in range(tries):
        child = os.fork()
        if child == 0:
            while True:
                record(run, folder)
        time.sleep(chance.uniform(0.0, 0.3))
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        lost += not readable(folder / "recording.h5")
    return lost


def damaged(run: Run, folder: Path, tries: int) -> tuple[int, int, float]:
    """Damage a recording in four ways, and read all of it.

    Returns:
        How many damages were neither told of in one line nor without effect on any number, how many were told of, and
        the longest time that it took [s].
    """
    from taichisoft_plugins.recording.layout import RecordingError
    from taichisoft_plugins.recording.reader import read_recording

    record(run, folder)
    content = (folder / "recording.h5").read_bytes()
    with read_recording(folder / "recording.h5") as recording:
        whole = recording.rows_of_frames(0, recording.frame_count)
    failed, told, longest = 0, 0, 0.0
    for number in range(tries):
        broken = folder / "broken.h5"
        broken.write_bytes(DAMAGES[number % len(DAMAGES)](bytearray(content), random.Random(number)))
        started = time.monotonic()
        try:
            with read_recording(broken) as recording:
                rows = recording.rows_of_frames(0, recording.frame_count)
                failed += any(rows[path].tobytes() != whole[path].tobytes() for path in whole)
        except RecordingError as error:
            told += 1
            failed += "\n" in str(error)
        except Exception:
            failed += 1
        longest = max(longest, time.monotonic() - started)
    return failed, told, longest


def cut_off(content: bytearray, chance: random.Random) -> bytearray:
    """The end is missing."""
    return content[: chance.randrange(len(content))]


def flip_bit(content: bytearray, chance: random.Random) -> bytearray:
    """One bit is wrong."""
    content[chance.randrange(len(content))] ^= 1 << chance.randrange(8)
    return content


def zero_page(content: bytearray, chance: random.Random) -> bytearray:
    """A page of a disk reads as zeros."""
    start = chance.randrange(len(content)) // 4096 * 4096
    end = min(start + 4096, len(content))
    content[start:end] = bytes(end - start)
    return content


def foreign_bytes(content: bytearray, chance: random.Random) -> bytearray:
    """Something else was written into it."""
    start = chance.randrange(len(content))
    end = min(start + 500, len(content))
    content[start:end] = chance.randbytes(end - start)
    return content


DAMAGES: tuple[Callable[[bytearray, random.Random], bytearray], ...] = (cut_off, flip_bit, zero_page, foreign_bytes)
