"""Videos, decoded again: length, rate, size and what they show; side by side; and that half a video is none."""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bent_gripper
import fake_run
import fake_worker
import numpy as np
import pytest
import typer
from PIL import Image
from typer.testing import CliRunner

import taichisoft_outputs
from taichisoft.errors import TaichisoftError
from taichisoft.running import run_command
from taichisoft_outputs import RecordingError, Style, read_recording, render_pictures, render_video
from taichisoft_outputs.drawing.camera import followed_part
from taichisoft_outputs.drawing.style import StyleError
from taichisoft_outputs.recording.reader import recorded_fingertips, tip_state
from taichisoft_outputs.recording.recording_output import RecordingOutput
from taichisoft_outputs.rendering import drawn_outputs, side_by_side, video
from taichisoft_outputs.rendering import video as rendering
from taichisoft_outputs.rendering.drawn_outputs import PicturesOutput, VideoOutput
from taichisoft_outputs.rendering.side_by_side import pictures_side_by_side, video_side_by_side
from taichisoft_outputs.rendering.video import RenderError, shown_instants

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
    written = render_video(run, tmp_path / "run.mp4", style, fps=30.0, on_picture=lambda *frames: told.append(frames))
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


def test_mp4_has_index_first_even_sides_and_colours(run, tmp_path, worker) -> None:
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


def test_a_folder_gets_a_file_for_each_picture(run, tmp_path, worker) -> None:
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
        render_video(run, tmp_path / "frames", STYLE, on_picture=lambda *_: notes.write_text("mine"))
    assert notes.read_text() == "mine"


def test_slow_motion_draws_each_instant_once(run, tmp_path, worker) -> None:
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
    assert shown_instants(recording_of(times, first), rate).tolist() == frames


def test_a_video_begins_at_the_last_start(tmp_path, worker) -> None:
    worker()
    recording = fake_run.begun(RecordingOutput(tmp_path), range(1, 6))
    recording.restart(fake_run.fake_state(0))
    fake_run.make_steps(recording, [1]).end("completed")
    with read_recording(recording.path) as opened:
        assert shown_instants(opened, 100.0).tolist() == [6, 7]


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
def test_failed_drawing_leaves_the_earlier_video(run, tmp_path, worker, name) -> None:
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
render_video(Path({str(run)!r}), Path({str(tmp_path / "new" / "run.mp4")!r}), Style(size=(32, 16)), on_picture=show)
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


# The output video of a run.


def test_a_run_ends_with_its_video(tmp_path, worker, capsys, monkeypatch) -> None:
    worker()
    monkeypatch.setattr(run_command, "SECONDS_BETWEEN_LINES", 0.001)
    video = VideoOutput(tmp_path / "run", tmp_path / "film.gif", fps=50.0, size="32x16", slow_motion=2.0)
    fake_run.fake_run([RecordingOutput(tmp_path / "run"), video], steps=10)
    with Image.open(tmp_path / "film.gif") as film:
        assert film.n_frames == 11 and film.size == (32, 16)
    assert re.search(r"film.gif: \d+ of 11 pictures, after 0:00:\d\d", capsys.readouterr().out)
    assert video.summary() == {"video": f"{tmp_path / 'film.gif'}, 11 pictures, 0.2 s"}


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


def test_video_output_refuses_an_unknown_body_at_once(tmp_path) -> None:
    outputs = [RecordingOutput(tmp_path), VideoOutput(tmp_path, view="follow:ball")]
    with pytest.raises(StyleError, match="no body is called 'ball'; there are: finger, cube"):
        for output in outputs:
            output.begin(fake_run.fake_model(), fake_run.fake_state(0))
    outputs[0].end("failed")


@pytest.mark.filterwarnings("ignore:drawing stopped")
def test_video_output_that_cannot_draw_keeps_the_recording(tmp_path, worker) -> None:
    worker("fail", at=0, times=9)
    video = VideoOutput(tmp_path, size="32x16")
    with pytest.raises(RenderError, match="apt-get install"):
        fake_run.fake_run([RecordingOutput(tmp_path), video], steps=3)
    assert {path.name for path in tmp_path.iterdir()} == {"recording.h5", "started"}
    assert video.summary() == {}


@pytest.mark.parametrize(("output", "name"), [(VideoOutput, "video"), (PicturesOutput, "pictures")])
def test_an_interrupted_drawing_leaves_the_run(tmp_path, monkeypatch, output, name) -> None:
    def stop(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(drawn_outputs, f"render_{name}", stop)
    with pytest.raises(RenderError, match=rf"no {name}: interrupted; `taichisoft render .*recording\.h5` draws later"):
        fake_run.fake_run([RecordingOutput(tmp_path), output(tmp_path)], steps=2)


# The command render.


@pytest.fixture
def short_run(tmp_path: Path) -> Path:
    fake_run.fake_run([RecordingOutput(tmp_path)], steps=10, floor=True)
    return tmp_path / "recording.h5"


def render(*arguments: Any) -> Any:
    application = typer.Typer()
    taichisoft_outputs.taichisoft_commands(application)
    return CliRunner().invoke(application, ["render", *map(str, arguments)])


def test_it_draws_a_moment_with_a_floor_in_the_size_asked_for(short_run: Path, tmp_path: Path) -> None:
    """With Open3D."""
    answer = render(short_run, "--time", 0.03, "--size", "320x180", "--view", "front", "--output", tmp_path / "new")
    assert answer.exit_code == 0, answer.output
    picture = np.asarray(Image.open(tmp_path / "new" / "at_0.03s.png")).astype(int)
    assert picture.shape == (180, 320, 3)
    assert np.ptp(picture) > 100


def test_render_draws_the_key_moments(short_run: Path, tmp_path: Path, worker) -> None:
    worker()
    answer = render(short_run, "--size", "32x16")
    assert answer.output.split() == [str(tmp_path / f"{name}.png") for name in ("before", "grasped", "lifted")]
    assert [np.asarray(Image.open(path)).mean() for path in answer.output.split()] == [0, 5, 10]


def test_a_video_alone_or_with_pictures(short_run: Path, tmp_path: Path, worker) -> None:
    worker()
    answer = render(
        short_run, "--size", "32x16", "--video", tmp_path / "new" / "run.gif", "--fps", 10, "--slow-motion", 2
    )
    assert answer.exit_code == 0, answer.output
    assert not list(tmp_path.glob("*.png"))
    with Image.open(tmp_path / "new" / "run.gif") as video:
        assert video.n_frames == 3
    assert render(short_run, "--size", "32x16", "--video", tmp_path / "run.gif", "--image").exit_code == 0
    assert len(list(tmp_path.glob("*.png"))) == 3


def test_each_of_several_views_has_its_own_files(short_run: Path, tmp_path: Path, worker) -> None:
    worker()
    views = ["--view", "iso", "--view", "follow:cube"]
    answer = render(short_run, *views, "--time", 0.1, "--size", "32x16", "--video", tmp_path / "run.gif")
    assert answer.exit_code == 0, answer.output
    names = {path.name for path in tmp_path.iterdir()} - {"recording.h5", "started"}
    stems = ("at_0.10s_iso.png", "at_0.10s_follow_cube.png", "run_iso.gif", "run_follow_cube.gif")
    assert names == set(stems)


def test_every_choice_of_a_style_has_an_option(
    short_run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = []
    monkeypatch.setattr(rendering, "render_pictures", lambda *arguments: drawn.append(arguments[3]) or [])
    options = {
        "size": ("--size", "64x32"),
        "eye": ("--eye", "300,-200,150.5"),
        "target": ("--target", "0,1,2"),
        "displacement_arrows": ("--displacement-arrows", "2"),
        "scale_bar": ("--scale-bar",),
        "opacity": ("--opacity", "0.5"),
        "background": ("--background", "#000000"),
        "transparent": ("--transparent",),
        "colour_by": ("--colour-by", "stress"),
        "colour_range": ("--colour-range", "0:120"),
        "colour_map": ("--colour-map", "viridis"),
        "cavity_pressure": ("--no-cavity-pressure",),
        "cable_tension": ("--no-cable-tension",),
        "arrows": ("--no-arrows",),
        "axes": ("--no-axes",),
        "body_axes": ("--no-body-axes",),
        "caption": ("--no-caption",),
        "surface": ("--surface", "finger.stl"),
        "section": ("--section", "y<0"),
        "font_size": ("--font-size", "20"),
    }
    answer = render(short_run, *[part for option in options.values() for part in option])
    assert answer.exit_code == 0, answer.output
    assert render(short_run, "--view", "top").exit_code == 0
    assert render(short_run).exit_code == 0
    keys = tmp_path / "camera.csv"
    keys.write_text("# time, eye, target\n0, 300,-200,150, 0,0,0\n\n1, 200,-200,150, 0,0,10\n")
    assert render(short_run, "--key-frames", keys).exit_code == 0
    chosen, from_above, default, moving = drawn
    changed = {name for name in vars(default) if getattr(chosen, name) != getattr(default, name)}
    of_several = {"name", "ranges", "bars", "force_length"}  # what recordings side by side have
    assert changed | {"view", "key_frames"} | of_several == set(vars(default))
    assert chosen.eye == (300.0, -200.0, 150.5) and chosen.background == (0.0, 0.0, 0.0)
    assert from_above.view == "top"
    assert moving.key_frames == ((0, 300, -200, 150, 0, 0, 0), (1, 200, -200, 150, 0, 0, 10))


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        (["--size", "large"], "size 'large' must be written as width x height in pixels, 1280x720"),
        (["--size", "8x8"], "width and height must be whole numbers from 16"),
        (["--eye", "1,2"], "eye '1,2' must be three numbers in mm, as 300,-200,150"),
        (["--eye", "1,2,3", "--view", "top"], "give either --eye, or --view and --follow"),
        (["--eye", "1,2,3", "--follow", "cube"], "give either --eye, or --view and --follow"),
        (["--view", "behind"], "no view is called 'behind'; there are: iso"),
        (["--video", "run.avi"], "a video ends with .mp4 or .gif"),
        (["--slow-motion", "-1"], "slow motion -1: must be positive"),
        (["--time", "7"], "nothing at 7 s"),
        (["--view", "follow:ball"], "no body is called 'ball'; there are: finger, cube, and NAME.tip"),
        (["--video", "run.mp4", "--view", "follow:ball"], "no body is called 'ball'"),
    ],
)
def test_render_refuses_before_anything_is_drawn(short_run: Path, monkeypatch, options, problem) -> None:
    monkeypatch.setattr("taichisoft_outputs.rendering.video.Worker", lambda *_: pytest.fail("a process was started"))
    answer = render(short_run, *options)
    assert isinstance(answer.exception, TaichisoftError)
    assert problem in str(answer.exception)


def test_render_tells_a_second_attempt_and_failure(short_run: Path, tmp_path: Path, monkeypatch) -> None:
    for times, code in ((1, 0), (9, 1)):
        log = tmp_path / f"started{times}"
        fake_worker.stand_in(monkeypatch, log, "crash", 1, times)
        answer = render(short_run, "--size", "32x16", "--video", tmp_path / "run.gif")
        assert "warning: drawing stopped after 1 of 4 pictures" in answer.output
        assert answer.exit_code == code
    assert isinstance(answer.exception, RenderError)
    assert "apt-get install" in str(answer.exception)


# Recordings side by side.


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


def test_recordings_share_bars_and_camera(recordings, styles, tmp_path, monkeypatch):
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
