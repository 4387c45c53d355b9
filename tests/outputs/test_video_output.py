"""The output "video" of a run: what it refuses before the run, and what it does at the end."""

import re
from pathlib import Path

import fake_run
import fake_worker
import pytest
from PIL import Image

from taichisoft.errors import TaichisoftError
from taichisoft_outputs.drawing.style import StyleError
from taichisoft_outputs.recording.recording_output import RecordingOutput
from taichisoft_outputs.rendering import drawn_outputs
from taichisoft_outputs.rendering.drawn_outputs import VideoOutput
from taichisoft_outputs.rendering.video import RenderError


@pytest.fixture
def worker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Draws frames of one colour, their index; or misbehaves."""

    def begin(what: str = "nothing", at: int = 0, times: int = 0) -> None:
        fake_worker.stand_in(monkeypatch, tmp_path / "started", what, at, times)

    return begin


def test_a_run_ends_with_its_video(tmp_path, worker, capsys) -> None:
    worker()
    video = VideoOutput(tmp_path / "run", tmp_path / "film.gif", fps=50.0, size="32x16", slow_motion=2.0)
    fake_run.fake_run([RecordingOutput(tmp_path / "run"), video], steps=10)
    with Image.open(tmp_path / "film.gif") as film:
        assert film.n_frames == 11 and film.size == (32, 16)
    assert "film.gif" in capsys.readouterr().out, "a progress bar"
    assert video.summary() == {"video": f"{tmp_path / 'film.gif'}, 11 frames, 0.2 s"}


def test_without_a_name_it_is_beside_the_recording(tmp_path, worker) -> None:
    worker()
    fake_run.fake_run([RecordingOutput(tmp_path), VideoOutput(tmp_path, size="32x16")], steps=3)
    assert (tmp_path / "video.mp4").stat().st_size > 0


@pytest.mark.parametrize(
    ("settings", "problem"),
    [
        ({"file": Path("film.mov")}, "film.mov: a video ends with"),
        ({"fps": -1.0}, "-1 frames per second"),
        ({"size": "0x0"}, "width and height must be whole numbers from 16"),
        ({"slow_motion": 0.0}, "slow motion 0: must be positive"),
        ({"view": "nowhere"}, "no view is called 'nowhere'"),
    ],
)
def test_what_is_impossible_is_said_before_the_run(tmp_path, settings, problem) -> None:
    with pytest.raises(TaichisoftError, match=re.escape(problem)):
        VideoOutput(tmp_path, **settings)


def test_a_body_to_follow_that_is_not_there_is_said_before_the_first_step(tmp_path) -> None:
    outputs = [RecordingOutput(tmp_path), VideoOutput(tmp_path, view="follow:ball")]
    with pytest.raises(StyleError, match="no body is called 'ball'; there are: finger, cube"):
        for output in outputs:
            output.begin(fake_run.fake_model(), fake_run.fake_state(0))
    outputs[0].end("failed")


@pytest.mark.filterwarnings("ignore:drawing stopped")
def test_where_nothing_can_be_drawn_the_recording_is_whole_and_the_error_says_what_to_install(tmp_path, worker) -> None:
    worker("fail", at=0, times=9)
    video = VideoOutput(tmp_path, size="32x16")
    with pytest.raises(RenderError, match="apt-get install"):
        fake_run.fake_run([RecordingOutput(tmp_path), video], steps=3)
    assert {path.name for path in tmp_path.iterdir()} == {"recording.h5", "started"}
    assert video.summary() == {}


def test_whoever_stops_the_drawing_still_has_the_run(tmp_path, monkeypatch) -> None:
    def stop(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(drawn_outputs, "render_video", stop)
    with pytest.raises(RenderError, match=r"no video: interrupted; `taichisoft render .*recording\.h5` draws"):
        fake_run.fake_run([RecordingOutput(tmp_path), VideoOutput(tmp_path)], steps=2)
