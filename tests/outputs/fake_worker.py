"""Stands in for the function that draws frames: it misbehaves as Open3D and its drivers were seen to do.

A frame is of one colour, its index.
"""

import os
import signal
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from taichisoft.base import Link
from taichisoft.errors import TaichisoftError

if TYPE_CHECKING:  # a process that starts later than its time limit tests something else
    import pytest

FUNCTION = "fake_worker:draw_frames"
ORDERS = "FAKE_WORKER"


def stand_in(monkeypatch: "pytest.MonkeyPatch", log: Path, what: str = "nothing", at: int = 0, times: int = 0) -> None:
    """Do `what` before drawing frame `at` of all, the first `times` times that a process is started.

    These are counted by the lines in the log: the number of the frame that a process begins with, and its own.
    """
    monkeypatch.setattr("taichisoft_outputs.rendering.video.WORKER", FUNCTION)
    monkeypatch.setenv(ORDERS, f"{what} {at} {times} {log}")
    path = os.environ.get("PYTHONPATH", "")
    monkeypatch.setenv("PYTHONPATH", f"{Path(__file__).parent}{os.pathsep}{path}")


def draw_frames(link: Link) -> None:
    """Answer with the frames that are asked for."""
    what, at, times, log = os.environ[ORDERS].split(" ", 3)
    _, style, frames = link.receive()
    number = frames.index(link.receive())
    with Path(log).open("a") as lines:
        lines.write(f"{number} {os.getpid()}\n")
    misbehaves = len(Path(log).read_text().splitlines()) <= int(times)
    while True:
        if misbehaves and number == int(at):
            misbehave(what)
        link.send(np.full((style.size[1], style.size[0], 3), frames[number] % 256, np.uint8))
        number = frames.index(link.receive())


def misbehave(what: str) -> None:
    """What happens instead of drawing."""
    if what == "hang":
        time.sleep(600)
    elif what == "crash":
        os.kill(os.getpid(), signal.SIGSEGV)
    elif what == "fail":
        raise ImportError("libEGL.so.1: cannot open shared object file")
    elif what == "refuse":
        raise TaichisoftError("there is no body 'ball'")
    elif what == "stop":
        sys.exit(0)
