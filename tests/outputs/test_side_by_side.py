"""Recordings side by side are seen alike, and a close-up stays with what it follows."""

from pathlib import Path

import bent_gripper
import numpy as np
import pytest
from PIL import Image

from taichisoft_outputs import RecordingError, Style, read_recording
from taichisoft_outputs.drawing.camera import followed_part
from taichisoft_outputs.drawing.style import StyleError
from taichisoft_outputs.recording.reader import recorded_fingertips, tip_state
from taichisoft_outputs.rendering import side_by_side, video
from taichisoft_outputs.rendering.side_by_side import pictures_side_by_side, video_side_by_side


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """The same run in two folders."""
    return [bent_gripper.record_gripper(tmp_path_factory.mktemp(name)) for name in ("soft", "stiff")]


@pytest.fixture
def styles(monkeypatch: pytest.MonkeyPatch) -> list[Style]:
    """The styles in which recordings were drawn, each in a grey of its own."""
    drawn: list[Style] = []

    def draw(recording, style, frames, take, stop):
        drawn.append(style)
        for _ in frames:
            take(np.full((style.size[1], style.size[0], 3), 50 * len(drawn), dtype=np.uint8))

    monkeypatch.setattr(video, "draw_frames", draw)
    return drawn


def test_bars_and_cameras_are_those_of_all_and_each_part_has_its_name(recordings, styles, tmp_path, monkeypatch):
    style = Style(size=(321, 90), colour_by="displacement", view="front")
    monkeypatch.setattr(side_by_side, "colour_bars_width", lambda scales, letters: 60.5 * len(scales))
    times = {"start": 0.0, "late": 0.02}
    paths = pictures_side_by_side(recordings, times, tmp_path / "new", style)
    first, second = styles
    assert first.size == second.size == (130, 90), "61 pixels are those of the one bar"
    assert not first.bars and first.force_length == second.force_length
    assert first.ranges == second.ranges and first.ranges["displacement [mm]"][1] > 10.0
    assert first.eye == second.eye and first.target == second.target
    assert first.name != second.name and first.name in str(recordings[0])
    assert [path.name for path in paths] == ["start.png", "late.png"]
    pixels = np.asarray(Image.open(paths[1]))
    assert pixels.shape == (90, 321, 3)
    assert np.unique(pixels[:, :130]).tolist() == [50] and np.unique(pixels[:, 130:260]).tolist() == [100]
    assert len(np.unique(pixels[:, 260:].reshape(-1, 3), axis=0)) > 20, "the colours of the bar"
    with pytest.raises(RecordingError, match="nothing at 9 s"):
        pictures_side_by_side(recordings, {"late": 9.0}, tmp_path, style)
    with pytest.raises(StyleError, match="too narrow for 2 recordings"):
        pictures_side_by_side(recordings, times, tmp_path, Style(size=(30, 30)))


def test_a_video_has_both(recordings, styles, tmp_path):
    style = Style(size=(64, 36), cavity_pressure=False)
    count = video_side_by_side(recordings, tmp_path / "both", style, 100.0, 1.0, lambda *_: None)
    files = sorted((tmp_path / "both").iterdir())
    assert len(files) == count == 3
    assert Image.open(files[-1]).size == (64, 36)


def test_a_close_up_of_a_tip_looks_at_its_mean(recordings):
    with read_recording(recordings[0]) as recording:
        middle, radius = followed_part(recording, recording.surfaces, "finger2.tip")
        observer = recorded_fingertips(recording, recording.soft_bodies)
        for frame in range(3):
            positions, _, _ = observer.observe(tip_state(recording, frame))
            assert middle(frame) == pytest.approx(positions[1], abs=1e-3)
        assert 10.0 < radius < 80.0
