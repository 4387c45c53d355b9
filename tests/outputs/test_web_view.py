"""The page of a recording: played, scrubbed, and followed while its run goes on, which it must not disturb."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import PATIENCE
from panel_viewer import PanelViewer, served
from tiny_run import STEPS, command, tiny_run

from taichisoft_outputs import RecordingError, read_recording

pytest.importorskip("viser", reason="needs the extra 'web'")


def cube(viewer: PanelViewer) -> np.ndarray:
    """Its centre [mm], as drawn."""
    return 100.0 * viewer.vertices["/cube"].mean(axis=0)


def test_a_recording_is_played_to_its_end_and_scrubbed(tmp_path: Path) -> None:
    tiny_run(tmp_path)
    with (
        read_recording(tmp_path / "recording.h5") as recording,
        served(tmp_path / "recording.h5") as (page, viewer, until),
    ):
        places = recording.column("rigid_position")[:, 0]
        time_step = recording.step_size
        viewer.find("time [s]")
        until(lambda: viewer.value("time [s]") == pytest.approx(STEPS * time_step))
        until(lambda: np.allclose(cube(viewer), places[STEPS], atol=1e-3))
        viewer.set("time [s]", 5 * time_step)
        until(lambda: np.allclose(cube(viewer), places[5], atol=1e-3))
        until(lambda: page.playback.position == 5 * time_step and not page.playback.playing)
        viewer.set("speed [x real time]", 0.5)
        viewer.press("space")
        until(lambda: viewer.value("time [s]") > 10 * time_step)


def test_a_section_cuts_bodies_open_until_it_is_taken_away(tmp_path: Path) -> None:
    """The pads and the cube are symmetric about y = 0: half of each is left, and closed where it is cut."""
    tiny_run(tmp_path)
    with served(tmp_path / "recording.h5") as (_, viewer, until):
        viewer.find("section")
        whole = {name: viewer.vertices[name].shape for name in ("/cube", "/left", "/left.cavity")}

        def ends(name: str) -> list[float]:
            return [100.0 * float(viewer.vertices[name][:, 1].min()), 100.0 * float(viewer.vertices[name][:, 1].max())]

        viewer.set("section", "y<0")
        until(lambda: ends("/cube") == pytest.approx([-5.0, 0.0], abs=1e-3))
        until(lambda: ends("/left.cavity")[1] == pytest.approx(0.0, abs=1e-3) == ends("/left")[1])
        corners = 100.0 * viewer.vertices["/cube"].reshape(-1, 3, 3)
        volume = np.linalg.det(corners - corners.mean(axis=(0, 1))).sum() / 6.0
        assert volume == pytest.approx(500.0, rel=1e-3)
        viewer.set("section", "y<")
        until(lambda: any("must be a plane" in str(element.get("_markdown")) for element in viewer.elements.values()))
        viewer.set("section", "")
        until(lambda: {name: viewer.vertices[name].shape for name in whole} == whole)


GOING_ON = """
import sys
from pathlib import Path
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft.running.scene_files import load_scene
from taichisoft.running.simulation import Simulation
from taichisoft_outputs.recording.recording_output import RecordingOutput

simulation = Simulation(load_scene(TINY_GRIPPER))
recording = RecordingOutput(Path(sys.argv[1]))
recording.begin(simulation.model, simulation.state)
for _ in range(2):
    for _ in range(60):
        report = simulation.step()
        recording.record(simulation.state, report)
    print("60 steps", flush=True)
    sys.stdin.readline()
recording.end("completed")
"""


def test_a_page_follows_a_running_simulation(tmp_path: Path) -> None:
    """The lock of a reader would keep the run from closing its file."""
    command = [sys.executable, "-c", GOING_ON, str(tmp_path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1) as run:
        assert run.stdin is not None and run.stdout is not None
        assert run.stdout.readline() == "60 steps\n"
        with served(tmp_path / "recording.h5") as (_, viewer, until):
            viewer.find("time [s]")
            run.stdin.write("\n\n")
            until(lambda: viewer.value("time [s]") == pytest.approx(1.2))
            until(lambda: any("completed" in str(element.get("_markdown")) for element in viewer.elements.values()))
        assert run.wait(PATIENCE) == 0
    with read_recording(tmp_path / "recording.h5") as read:
        assert (read.outcome, read.instant_count) == ("completed", 121)


def test_what_cannot_be_viewed_is_one_line(tmp_path: Path) -> None:
    result = command("view", str(tmp_path / "none.h5"))
    assert isinstance(result.exception, RecordingError)
    result = command("view", str(tmp_path / "none.h5"), "--address", "8080")
    assert "must look like 127.0.0.1:8080" in str(result.exception)
    result = command("view", str(tmp_path / "none.h5"), "--section", "y")
    assert "section 'y' must be a plane in mm" in str(result.exception)
