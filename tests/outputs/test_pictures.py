"""Pictures show the whole scene, at the right moments; what prevents them is said clearly."""

import fake_run
import numpy as np
import pytest
from PIL import Image

from taichisoft.base import run_python
from taichisoft.base.processes import ChildResult
from taichisoft_outputs import Style, read_recording, render_pictures
from taichisoft_outputs.recording.recording_output import RecordingOutput
from taichisoft_outputs.rendering import drawn_outputs
from taichisoft_outputs.rendering.drawn_outputs import PicturesOutput
from taichisoft_outputs.rendering.video import RenderError, key_moments


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pictures")
    fake_run.fake_run([RecordingOutput(folder), PicturesOutput(folder)], steps=20)
    return folder


@pytest.fixture(scope="module")
def without_signs(folder, tmp_path_factory):
    """The same pictures with nothing written or painted over the scene."""
    target = tmp_path_factory.mktemp("without signs")
    recording = folder / "recording.h5"
    with read_recording(recording) as opened:
        moments = key_moments(opened)
    signs = {"arrows": False, "axes": False, "caption": False, "cavity_pressure": False}
    render_pictures(recording, moments, target, Style(**signs))
    return target


def read_picture(path):
    """Shape (height, width, 3), uint8."""
    return np.asarray(Image.open(path))


def bodies(picture):
    """Rows and columns of what differs from the background in the middle of a picture, where nothing is written."""
    middle = picture[100:, 200:1080].astype(int)
    rows, columns = np.nonzero(np.abs(middle - picture[0, 0]).max(axis=2) > 12)
    return rows + 100, columns + 200


def test_a_run_gives_three_pictures_with_everything_inside_the_frame(folder, without_signs):
    extents = {}
    for name in ("before", "grasped", "lifted"):
        assert read_picture(folder / f"{name}.png").shape == (720, 1280, 3)
        picture = read_picture(without_signs / f"{name}.png")
        assert picture[0, 0].min() > 150, "the background is light"
        rows, columns = bodies(picture)
        extents[name] = (rows.min(), rows.max())
        assert rows.max() < 700
        assert columns.min() > 220 and columns.max() < 1060
    # The camera stands where all three fit: it stays there, so the lift is seen and the picture is filled.
    assert extents["before"] == extents["grasped"]
    assert extents["lifted"][0] < extents["before"][0] - 50
    assert extents["before"][1] - extents["lifted"][0] > 0.5 * 720


def test_the_cube_is_blue_and_not_black_or_inside_out(without_signs):
    picture = read_picture(without_signs / "before.png")[:, 400:900].astype(int)
    red, blue = picture[..., 0], picture[..., 2]
    cube = blue > red + 90  # not where it is seen through silicone
    assert cube.sum() > 2000
    assert blue[cube].max() > 100
    top, bottom = np.percentile(np.nonzero(cube)[0], [5, 95]).astype(int)
    bright = blue[: (top + bottom) // 2][cube[: (top + bottom) // 2]].mean()
    dark = blue[(top + bottom) // 2 :][cube[(top + bottom) // 2 :]].mean()
    assert bright > dark + 10, "the upper face is nearest to the sun"


def test_key_moments(folder):
    with read_recording(folder / "recording.h5") as recording:
        moments = key_moments(recording)
    last_still = fake_run.RISE_AFTER * fake_run.STEP
    assert moments == pytest.approx({"before": 0.0, "grasped": last_still, "lifted": 0.2})


def test_without_a_lift_there_is_only_before_and_after(tmp_path):
    fake_run.fake_run([RecordingOutput(tmp_path)], steps=3)
    with read_recording(tmp_path / "recording.h5") as recording:
        assert key_moments(recording) == pytest.approx({"before": 0.0, "after": 0.03})


def test_an_interrupted_run_or_one_without_a_step_is_not_drawn(tmp_path):
    for steps, outcome in ((2, "interrupted"), (0, "the first step diverged")):
        fake_run.fake_run([RecordingOutput(tmp_path), PicturesOutput(tmp_path)], steps, outcome)
    assert [path.name for path in tmp_path.iterdir()] == ["recording.h5"]


def test_whoever_stops_the_drawing_still_has_the_run(tmp_path, monkeypatch):
    def stop(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(drawn_outputs, "render_pictures", stop)
    with pytest.raises(RenderError, match=r"no pictures: interrupted; `taichisoft render .*recording\.h5` draws later"):
        fake_run.fake_run([RecordingOutput(tmp_path), PicturesOutput(tmp_path)], steps=2)


def test_a_child_process_that_hangs_crashes_or_fails_is_reported():
    assert run_python(["-c", "while True: pass"], 0.5).problem == "no answer within 0.5 s"
    crash = "import os, signal; os.kill(os.getpid(), signal.SIGSEGV)"
    assert "SIGSEGV" in run_python(["-c", crash], 20).problem
    assert run_python(["-c", "raise OSError('no libGL')"], 20).problem == "OSError: no libGL"
    assert run_python(["-c", "print(42)"], 20) == ChildResult("", "42\n")
