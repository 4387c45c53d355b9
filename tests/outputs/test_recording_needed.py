"""Outputs that are made of the recording: a run without one does not begin."""

from pathlib import Path

import fake_run
import pytest

from taichisoft import Controller, Simulation, run
from taichisoft_outputs.recording.recording_output import NeededRecording, RecordingNeeded, RecordingOutput
from taichisoft_outputs.rendering.drawn_outputs import PicturesOutput, VideoOutput


class Still(Controller):
    def control(self, observation):
        pytest.fail("a step was made")


@pytest.mark.parametrize(("output", "name"), [(PicturesOutput, "pictures"), (VideoOutput, "video")])
def test_the_run_ends_before_its_first_step_without_a_recording_before_the_output(
    tmp_path: Path, taichisoft_scene, output, name
) -> None:
    for outputs in ([output(tmp_path)], [output(tmp_path), RecordingOutput(tmp_path)]):
        with pytest.raises(RecordingNeeded, match=f"output '{name}' needs .*'recording' before it: recording,{name}"):
            run(Simulation(taichisoft_scene), Still(), outputs, duration=0.1)
    assert not [path for path in tmp_path.iterdir() if path.name != "recording.h5"]


def test_the_recording_of_another_run_will_not_do(tmp_path: Path) -> None:
    fake_run.fake_run([RecordingOutput(tmp_path)], steps=3)
    with pytest.raises(RecordingNeeded):
        fake_run.fake_run([PicturesOutput(tmp_path)], steps=3)
    recording, needed = RecordingOutput(tmp_path), NeededRecording(tmp_path)
    recording.begin(fake_run.fake_model(), fake_run.fake_state(0))
    needed.require("pictures")
    recording.end("completed")
