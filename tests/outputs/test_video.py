"""Videos, decoded again: length, rate, size and what they show; and that half a video is none."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import fake_run
import fake_worker
import numpy as np
import pytest
from PIL import Image

from taichisoft_outputs import Style, read_recording, render_pictures, render_video
from taichisoft_outputs.recording.recording_output import RecordingOutput
from taichisoft_outputs.rendering import video
from taichisoft_outputs.rendering.video import RenderError, video_frames

STYLE = Style(size=(32, 16))


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of 0.2 s: 21 frames, 0.01 s apart."""
    folder = tmp_path_factory.mktemp("run")
    fake_run.fake_run([RecordingOutput(folder)], steps=20)
    return folder / "recording.h5"


@pytest.fixture
def worker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Draws frames of one colour, their index; or misbehaves."""

    def begin(what: str = "nothing", at: int = 0, times: int = 0) -> None:
        fake_worker.stand_in(monkeypatch, tmp_path / "started", what, at, times)

    return begin


def decode(path: Path) -> tuple[np.ndarray, dict]:
    """Frames, shape (count, height, width, 3), and what the file says about itself."""
    from imageio_ffmpeg import read_frames

    frames = read_frames(path)
    about = next(frames)
    width, height = about["size"]
    return np.array([np.frombuffer(frame, np.uint8).reshape(height, width, 3) for frame in frames]), about


def test_a_drawn_video_begins_and_ends_like_the_stills(run, tmp_path) -> None:
    """With Open3D. Nothing reaches further than it does at the beginning or at the end, so one camera suits both."""
    style = Style(size=(160, 90))
    told = []
    written = render_video(run, tmp_path / "run.mp4", style, fps=30.0, on_frame=lambda *frames: told.append(frames))
    frames, about = decode(tmp_path / "run.mp4")
    assert written == len(frames) == 7, "0.2 s at 30 frames per second, the first and the last included"
    assert told == [(count, 7) for count in range(1, 8)]
    assert about["fps"] == 30.0 and about["size"] == (160, 90) and about["codec"] == "h264"
    assert about["pix_fmt"].startswith("yuv420p")
    paths = render_pictures(run, {"first": 0.0, "last": 0.2}, tmp_path, style)
    stills = [np.asarray(Image.open(path)).astype(int) for path in paths]
    for frame, still, other in zip(frames[[0, -1]].astype(int), stills, stills[::-1], strict=True):
        assert np.abs(frame - still).mean() < 3.0, "H.264 is not exact, but its colours are"
        assert np.abs(frame - other).mean() > 2 * np.abs(frame - still).mean()


def test_mp4_has_its_index_in_front_and_even_sides_and_the_right_colours(run, tmp_path, worker) -> None:
    worker()
    render_video(run, tmp_path / "run.mp4", Style(size=(33, 17)), fps=100.0)
    content = (tmp_path / "run.mp4").read_bytes()
    assert 0 < content.index(b"moov") < content.index(b"mdat"), "browsers begin before they have all of it"
    frames, about = decode(tmp_path / "run.mp4")
    assert about["size"] == (34, 18)
    assert about["pix_fmt"].startswith("yuv420p(tv, bt709, "), "matrix, primaries and transfer"
    assert frames.shape[0] == 21
    np.testing.assert_allclose(frames.mean(axis=(1, 2, 3)), np.arange(21), atol=2.0)
    assert np.ptp(frames[10].astype(int)) <= 2, "the row and the column that were added are like their neighbours"


def test_gif_has_every_frame_at_the_right_time_and_size(run, tmp_path, worker) -> None:
    worker()
    render_video(run, tmp_path / "run.gif", Style(size=(33, 17)), fps=25.0, slow_motion=4.0)
    with Image.open(tmp_path / "run.gif") as gif:
        assert gif.size == (33, 17)
        assert gif.n_frames == 21
        durations, colours = [], []
        for number in range(gif.n_frames):
            gif.seek(number)
            durations.append(gif.info["duration"])
            colours.append(np.asarray(gif.convert("RGB")).mean())
    assert durations[:-1] == [40] * 20
    np.testing.assert_allclose(colours, np.arange(21), atol=1.0)


def test_a_folder_gets_a_file_for_each_frame_in_place_of_an_earlier_video(run, tmp_path, worker) -> None:
    worker()
    folder = tmp_path / "new" / "frames"
    assert render_video(run, folder, STYLE, fps=100.0) == 21
    assert render_video(run, folder, STYLE, fps=10.0) == 3
    assert sorted(path.name for path in folder.iterdir()) == [f"frame_0000{number}.png" for number in range(3)]
    assert np.asarray(Image.open(folder / "frame_00002.png")).tolist() == [[[20, 20, 20]] * 32] * 16
    (folder / "notes.txt").write_text("mine")
    with pytest.raises(RenderError, match=r"frames: has 'notes\.txt', which is not a frame of a video"):
        render_video(run, folder, STYLE, fps=10.0)
    assert (folder / "notes.txt").read_text() == "mine"
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["frames"]


def test_what_is_put_into_the_folder_meanwhile_is_not_lost(run, tmp_path, worker) -> None:
    worker()
    render_video(run, tmp_path / "frames", STYLE, fps=10.0)
    notes = tmp_path / "frames" / "notes.txt"
    with pytest.raises(RenderError, match=r"frames: has 'notes\.txt'"):
        render_video(run, tmp_path / "frames", STYLE, on_frame=lambda *_: notes.write_text("mine"))
    assert notes.read_text() == "mine"


def test_in_slow_motion_a_recorded_frame_is_drawn_once_and_shown_several_times(run, tmp_path, worker) -> None:
    worker()
    told: list[int] = []
    written = render_video(run, tmp_path / "frames", STYLE, 50.0, 4.0, lambda done, total: told.append(done))
    colours = [np.asarray(Image.open(path)).mean() for path in sorted((tmp_path / "frames").iterdir())]
    assert written == len(colours) == 41
    assert colours == [(index // 2) for index in range(40)] + [20]
    assert len(told) == 21 and told[-1] == 41


def recording_of(times: list[float], first: int = 0) -> SimpleNamespace:
    return SimpleNamespace(times=np.array(times), last_start=first, path="run.h5")


@pytest.mark.parametrize(
    ("times", "first", "rate", "frames"),
    [
        ([0.0, 0.01, 0.02, 0.03], 0, 100.0, [0, 1, 2, 3]),
        ([0.0, 0.01, 0.02, 0.03], 0, 300.0, [0, 0, 1, 1, 1, 2, 2, 2, 3, 3]),  # a third of a step apart
        ([0.0, 0.01, 0.02, 0.03, 0.04], 0, 30.0, [0, 3, 4]),  # the end is always shown
        ([0.0, 0.1, 0.2, 0.0, 0.1, 0.2, 0.3], 3, 10.0, [3, 4, 5, 6]),  # of two starts the last
        ([0.0, 0.05, 0.2], 0, 20.0, [0, 1, 1, 2, 2]),  # recorded frames need not be evenly apart
        ([0.5], 0, 30.0, [0]),
    ],
)
def test_a_video_shows_the_recorded_frames_nearest_to_its_own(times, first, rate, frames) -> None:
    assert video_frames(recording_of(times, first), rate).tolist() == frames


def test_a_run_that_was_started_anew_is_shown_from_its_last_start(tmp_path, worker) -> None:
    worker()
    recording = RecordingOutput(tmp_path)
    recording.begin(fake_run.fake_model(), fake_run.fake_state(0))
    for step in range(1, 6):
        recording.record(fake_run.fake_state(step), fake_run.fake_report(step))
    recording.restart(fake_run.fake_state(0))
    recording.record(fake_run.fake_state(1), fake_run.fake_report(1))
    recording.end("completed")
    with read_recording(recording.path) as opened:
        assert video_frames(opened, 100.0).tolist() == [6, 7]


@pytest.mark.parametrize(
    ("name", "fps", "slow_motion", "problem"),
    [
        ("run.avi", 30.0, 1.0, r"run\.avi: a video ends with \.mp4 or \.gif, or is a folder"),
        ("run.mp4", 0.0, 1.0, "0 frames per second; must be above 0"),
        ("run.mp4", float("nan"), 1.0, "nan frames per second"),
        ("run.gif", 60.0, 1.0, "60 frames per second; must be above 0 and at most 50"),
        ("run.mp4", 30.0, 0.0, "slow motion 0: must be positive"),
        ("run.mp4", 30.0, float("inf"), "slow motion inf"),
    ],
)
def test_what_is_impossible_is_said_before_anything_is_drawn(run, tmp_path, name, fps, slow_motion, problem) -> None:
    with pytest.raises(RenderError, match=problem):
        render_video(run, tmp_path / name, STYLE, fps, slow_motion)
    assert not list(tmp_path.iterdir())


@pytest.mark.filterwarnings("ignore:drawing stopped")
@pytest.mark.parametrize("name", ["run.mp4", "run.gif", "frames"])
def test_when_drawing_fails_the_video_of_before_stays_and_nothing_else(run, tmp_path, worker, name) -> None:
    folder = tmp_path / "videos"
    worker()
    render_video(run, folder / name, STYLE)
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    worker("crash", at=3, times=9)
    with pytest.raises(RenderError, match="SIGSEGV"):
        render_video(run, folder / name, STYLE)
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before


@pytest.mark.filterwarnings("ignore:drawing stopped")
def test_a_video_goes_on_after_a_crash(run, tmp_path, worker) -> None:
    worker("crash", at=11, times=1)
    assert render_video(run, tmp_path / "run.mp4", STYLE, fps=100.0) == 21
    frames, _ = decode(tmp_path / "run.mp4")
    np.testing.assert_allclose(frames.mean(axis=(1, 2, 3)), np.arange(21), atol=2.0)


def test_without_ffmpeg_it_says_how_to_get_it(run, tmp_path, worker, monkeypatch) -> None:
    worker()
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", str(tmp_path / "none"))
    with pytest.raises(RenderError, match="none: ffmpeg cannot be started: No such file"):
        render_video(run, tmp_path / "run.mp4", STYLE)
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(RenderError, match=r"no ffmpeg.*pip install imageio-ffmpeg.*IMAGEIO_FFMPEG_EXE"):
        render_video(run, tmp_path / "run.mp4", STYLE)
    assert not list(tmp_path.glob("*run*"))


def test_what_ffmpeg_complains_about_is_passed_on(run, tmp_path, worker, monkeypatch) -> None:
    worker()
    monkeypatch.setitem(video.OPTIONS, ".mp4", "-c:v no_such_codec -f mp4")
    with pytest.raises(RenderError, match=r"run\.mp4: ffmpeg failed: \w"):
        render_video(run, tmp_path / "run.mp4", Style(size=(640, 360)))
    assert not list(tmp_path.glob("*run*"))


@pytest.mark.skipif(sys.platform == "win32", reason="sends a signal")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, getattr(signal, "SIGHUP", None)])
def test_ctrl_c_ends_everything_and_leaves_nothing(run, tmp_path, number, monkeypatch) -> None:
    log = tmp_path / "started"
    fake_worker.stand_in(monkeypatch, log, "hang", 5, 9)
    program = f"""
from pathlib import Path
from taichisoft_outputs.drawing.style import Style
from taichisoft_outputs.rendering import video
from taichisoft_outputs.rendering.video import render_video
video.WORKER = {fake_worker.FUNCTION!r}
show = lambda done, total: print(done, flush=True)
render_video(Path({str(run)!r}), Path({str(tmp_path / "new" / "run.mp4")!r}), Style(size=(32, 16)), on_frame=show)
"""
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as parent:
        assert parent.stdout is not None and parent.stderr is not None
        try:
            for expected in range(1, 6):
                assert int(parent.stdout.readline()) == expected
            assert becomes_true(lambda: any((tmp_path / "new").iterdir())), "ffmpeg is writing"
            parent.send_signal(number)
            assert b"KeyboardInterrupt" in parent.stderr.read()
        finally:
            parent.kill()
    assert not list((tmp_path / "new").iterdir())
    drawing = int(log.read_text().split()[1])
    assert becomes_true(lambda: not is_running(drawing))


def becomes_true(condition: Callable[[], bool]) -> bool:
    """Whether it is true within ten seconds."""
    latest = time.monotonic() + 10.0
    while not (answer := condition()) and time.monotonic() < latest:
        time.sleep(0.05)
    return answer


def is_running(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return True
