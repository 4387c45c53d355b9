"""A video of any length needs no more than so much memory: a process draws a number of frames, and another goes on."""

from pathlib import Path

import numpy as np
import pytest
from bent_gripper import record_gripper
from conftest import PATIENCE

import taichisoft
from taichisoft.base import Worker, run_python
from taichisoft_outputs import Style
from taichisoft_outputs.rendering import live_renderer, video

LARGEST_GROWTH = 800.0 / video.FRAMES_PER_PROCESS
"""[MB] a frame: the frames of a process may cost 800 MB."""

SCRIPT = """
import resource, sys
from pathlib import Path
from taichisoft_outputs.drawing.drawer import Drawer
from taichisoft_outputs.recording.reader import read_recording
from taichisoft_outputs.drawing.style import Style

def peak():  # [MB]
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024

with read_recording(sys.argv[1]) as recording:
    drawer = Drawer(recording, Style(size=(320, 180), view="orbit", colour_by="stress"), [0, 1, 2])
    for number in range(60):
        drawer.image(number % 3)
        if number == 19:
            before = peak()
Path(sys.argv[2]).write_text(str((peak() - before) / 40))
"""


def test_memory_does_not_grow_with_the_frames(tmp_path: Path) -> None:
    growth = tmp_path / "growth"  # a file, because the renderer writes to standard output
    child = run_python(["-c", SCRIPT, str(record_gripper(tmp_path)), str(growth)], PATIENCE)
    assert not child.problem, child.problem
    assert float(growth.read_text()) < LARGEST_GROWTH


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The functions of all worker processes, of which each draws two frames."""
    functions: list[str] = []

    def start(function: str) -> Worker:
        functions.append(function)
        return Worker(function)

    for module in (video, live_renderer):
        monkeypatch.setattr(module, "FRAMES_PER_PROCESS", 2)
        monkeypatch.setattr(module, "Worker", start)
    return functions


def test_the_next_process_goes_on_with_the_frames(tmp_path: Path, started: list[str]) -> None:
    """In the same camera, which sees all frames."""
    recording, style = record_gripper(tmp_path), Style(size=(96, 54))
    images: list[np.ndarray] = []
    video.draw_frames(recording, style, [2, 0, 1], images.append, lambda: None)
    assert started == [video.WORKER] * 2
    whole: list[np.ndarray] = []
    video.FRAMES_PER_PROCESS = 3
    video.draw_frames(recording, style, [2, 0, 1], whole.append, lambda: None)
    assert started == [video.WORKER] * 3
    assert np.array_equal(images, whole)
    assert not np.array_equal(images[0], images[1])


def test_the_next_process_goes_on_with_the_pictures(started: list[str]) -> None:
    simulation = taichisoft.Simulation(taichisoft.load_scene("finger-inflated"))
    pictures = [simulation.render(size=(96, 54)) for _ in range(3)]
    assert started == [live_renderer.WORKER] * 2
    assert np.array_equal(pictures[0], pictures[2])
