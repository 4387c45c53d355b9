"""Frames in a run's recording and in its CSV file: there, and carried on by a run that is resumed."""

import csv
from pathlib import Path

import numpy as np
import pytest
from tiny_run import make_run

from taichisoft import Control, Simulation
from taichisoft.scene import scene_from_dict
from taichisoft_outputs import read_recording
from taichisoft_outputs.csv_output import CsvOutput
from taichisoft_outputs.plots import PANELS, RunCurves
from taichisoft_outputs.recording.recording_output import RecordingOutput
from taichisoft_outputs.recording.resume import ResumeError, recorded_scene, resumed_simulation, state_at

STEPS = 25
SCENE = {
    "frames": {
        "jaw": {"follows": "base", "speed": 30.0},
        "lid": {"follows": "jaw", "hinge": {"axis": [0.0, 1.0, 0.0]}, "turning_speed": 90.0},
        "belt": {"path": {"times": [0.05, 0.2], "translations": [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0]]}},
    },
    "rigid_bodies": {
        "belt": {"box": [80.0, 80.0, 10.0], "position": [0.0, 0.0, -5.0], "follows": "belt"},
        "mark": {"box": [4.0, 4.0, 4.0], "position": [0.0, 0.0, 50.0], "follows": "lid"},
        "cube": {"box": [20.0, 20.0, 20.0], "mass": 0.05, "position": [0.0, 0.0, 11.0]},
    },
}


def control(step: int) -> Control:
    motion = {"frame_translation": {"jaw": np.array([0.0, 9.0, 0.0])}} if step == 3 else {}
    return Control(base_velocity=np.array([0.0, 0.0, 1.0]), frame_angle={"lid": 0.1 * step}, **motion)  # type: ignore[arg-type]


def test_frames_are_recorded_and_go_on_from_every_frame(tmp_path: Path) -> None:
    simulation = Simulation(scene_from_dict(SCENE))
    states = make_run(simulation, [RecordingOutput(tmp_path, every=4), CsvOutput(tmp_path)], map(control, range(STEPS)))
    with (tmp_path / "run.csv").open(encoding="utf-8") as file:
        last = list(csv.DictReader(file))[-1]
    seen = simulation.observe()
    assert float(last["frame_translation jaw y [mm]"]) == pytest.approx(30.0 * 0.01 * (STEPS - 3))
    assert float(last["frame_rotation lid y [degrees]"]) == pytest.approx(np.degrees(seen.frame_angles["lid"]))
    assert float(last["frame_force belt z [mN]"]) == pytest.approx(-0.05 * 9810.0, rel=1e-3)
    assert last["clipped"] == "jaw_translation|lid_rotation"
    with read_recording(tmp_path / "recording.h5") as recording:
        assert recording.frames.names == ("base", "jaw", "belt", "lid")
        assert recording.row("frame_pose", -1).tolist() == states[-1].frame_pose.tolist()
        panel = PANELS["frame-force"](RunCurves(recording))
        belt = next(curve for curve in panel.curves if curve.label == "belt")
        assert belt.y[-1] == pytest.approx(0.05 * 9810.0, rel=1e-3)
        frame = recording.instant_at(0.08)
        assert not recording.has_state(frame)
        assert state_at(recording, frame) == states[8]
        resumed = resumed_simulation(recording, frame, recorded_scene(recording, (), None))
        for step in range(8, STEPS):
            resumed.step(control(step))
        assert resumed.state == states[-1]
        fewer = recorded_scene(recording, ['rigid_bodies.mark.follows="jaw"', "frames.lid.pivot=[1.0,0.0,0.0]"], None)
        with pytest.raises(ResumeError, match="'lid' is not as it was recorded: its pivots differ by up to 1 mm"):
            resumed_simulation(recording, frame, fewer)
