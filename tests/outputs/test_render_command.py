"""`taichisoft render`: which files it writes, in which style, and what it refuses."""

from pathlib import Path
from typing import Any

import fake_run
import fake_worker
import numpy as np
import pytest
import typer
from PIL import Image
from typer.testing import CliRunner

import taichisoft_outputs
from taichisoft.errors import TaichisoftError
from taichisoft_outputs.recording.recording_output import RecordingOutput
from taichisoft_outputs.rendering import video as rendering
from taichisoft_outputs.rendering.video import RenderError


@pytest.fixture
def run(tmp_path: Path) -> Path:
    fake_run.fake_run([RecordingOutput(tmp_path)], steps=10, floor=True)
    return tmp_path / "recording.h5"


@pytest.fixture
def fake(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Frames of one colour, their index."""
    fake_worker.stand_in(monkeypatch, tmp_path / "started")


def render(*arguments: Any) -> Any:
    application = typer.Typer()
    taichisoft_outputs.taichisoft_commands(application)
    return CliRunner().invoke(application, ["render", *map(str, arguments)])


def test_it_draws_a_moment_with_a_floor_in_the_size_asked_for(run: Path, tmp_path: Path) -> None:
    """With Open3D."""
    answer = render(run, "--time", 0.03, "--size", "320x180", "--view", "front", "--output", tmp_path / "new")
    assert answer.exit_code == 0, answer.output
    picture = np.asarray(Image.open(tmp_path / "new" / "at_0.03s.png")).astype(int)
    assert picture.shape == (180, 320, 3)
    assert np.ptp(picture) > 100


@pytest.mark.usefixtures("fake")
def test_pictures_are_those_of_the_key_moments_beside_the_recording(run: Path, tmp_path: Path) -> None:
    answer = render(run, "--size", "32x16")
    assert answer.output.split() == [str(tmp_path / f"{name}.png") for name in ("before", "grasped", "lifted")]
    assert [np.asarray(Image.open(path)).mean() for path in answer.output.split()] == [0, 5, 10]


@pytest.mark.usefixtures("fake")
def test_a_video_alone_or_with_pictures(run: Path, tmp_path: Path) -> None:
    answer = render(run, "--size", "32x16", "--video", tmp_path / "new" / "run.gif", "--fps", 10, "--slow-motion", 2)
    assert answer.exit_code == 0, answer.output
    assert not list(tmp_path.glob("*.png"))
    with Image.open(tmp_path / "new" / "run.gif") as video:
        assert video.n_frames == 3
    assert "3/3 frames" in answer.output
    assert render(run, "--size", "32x16", "--video", tmp_path / "run.gif", "--image").exit_code == 0
    assert len(list(tmp_path.glob("*.png"))) == 3


@pytest.mark.usefixtures("fake")
def test_each_of_several_views_has_its_own_files(run: Path, tmp_path: Path) -> None:
    views = ["--view", "iso", "--view", "follow:cube"]
    answer = render(run, *views, "--time", 0.1, "--size", "32x16", "--video", tmp_path / "run.gif")
    assert answer.exit_code == 0, answer.output
    names = {path.name for path in tmp_path.iterdir()} - {"recording.h5", "started"}
    stems = ("at_0.10s_iso.png", "at_0.10s_follow_cube.png", "run_iso.gif", "run_follow_cube.gif")
    assert names == set(stems)


def test_every_choice_of_a_style_has_an_option(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn = []
    monkeypatch.setattr(rendering, "render_pictures", lambda *arguments: drawn.append(arguments[3]) or [])
    options = {
        "size": ("--size", "64x32"),
        "eye": ("--eye", "300,-200,150.5"),
        "target": ("--target", "0,1,2"),
        "opacity": ("--opacity", "0.5"),
        "background": ("--background", "#000000"),
        "colour_by": ("--colour-by", "stress"),
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
    answer = render(run, *[part for option in options.values() for part in option])
    assert answer.exit_code == 0, answer.output
    assert render(run, "--view", "top").exit_code == 0
    assert render(run).exit_code == 0
    chosen, from_above, default = drawn
    changed = {name for name in vars(default) if getattr(chosen, name) != getattr(default, name)}
    of_several = {"name", "ranges", "bars", "force_length"}  # what recordings side by side have
    assert changed | {"view"} | of_several == set(vars(default))
    assert chosen.eye == (300.0, -200.0, 150.5) and chosen.background == (0.0, 0.0, 0.0)
    assert from_above.view == "top"


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
def test_what_is_impossible_is_said_before_anything_is_drawn(run: Path, monkeypatch, options, problem) -> None:
    monkeypatch.setattr("taichisoft_outputs.rendering.video.Worker", lambda *_: pytest.fail("a process was started"))
    answer = render(run, *options)
    assert isinstance(answer.exception, TaichisoftError)
    assert problem in str(answer.exception)


def test_a_second_attempt_is_told_and_a_second_failure_is_an_error(run: Path, tmp_path: Path, monkeypatch) -> None:
    for times, code in ((1, 0), (9, 1)):
        log = tmp_path / f"started{times}"
        fake_worker.stand_in(monkeypatch, log, "crash", 1, times)
        answer = render(run, "--size", "32x16", "--video", tmp_path / "run.gif")
        assert "warning: drawing stopped after 1 of 4 frames" in answer.output
        assert answer.exit_code == code
    assert isinstance(answer.exception, RenderError)
    assert "apt-get install" in str(answer.exception)
