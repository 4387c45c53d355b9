"""The picture key: what is drawn, that the run does not wait for it, and that failures stay small."""

import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import fake_run
import fake_worker
import numpy as np
import pytest
from PIL import Image

import taichisoft_outputs
from taichisoft_outputs import read_recording
from taichisoft_outputs.rendering import drawn_outputs
from taichisoft_outputs.rendering.drawn_outputs import finish_pictures, take_picture
from taichisoft_outputs.rendering.video import RenderError


def session(folder: Path | None, step: int = 0) -> Any:
    model = fake_run.fake_model()
    model.body_names = ("finger", "cube")  # a state that was reached otherwise than by a step has contacts between them
    simulation = SimpleNamespace(model=model, state=fake_run.fake_state(step))
    return SimpleNamespace(simulation=simulation, folder=folder)


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> dict[str, np.ndarray]:
    """Instead of drawing: which nodes were to be drawn, by name of the picture."""
    pictures: dict[str, np.ndarray] = {}

    def render(path: Path, times: dict[str, float], folder: Path) -> None:
        with read_recording(path) as recording:
            for name, time in times.items():
                pictures[name] = recording.row("position", recording.frame_at(time))

    monkeypatch.setattr(drawn_outputs, "render_pictures", render)
    return pictures


def test_the_hooks_draw_a_picture_of_the_present_state(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing but the picture is left. What a picture shows is tested elsewhere."""
    fake_worker.stand_in(monkeypatch, tmp_path_factory.mktemp("log") / "started")
    run = session(tmp_path, step=10)
    taichisoft_outputs.taichisoft_picture_wanted(run)
    taichisoft_outputs.taichisoft_run_ends(run)
    assert [path.name for path in tmp_path.iterdir()] == ["picture_1_at_0.10s.png"]
    with Image.open(tmp_path / "picture_1_at_0.10s.png") as picture:
        assert picture.size == (1280, 720)


def test_each_picture_shows_the_moment_at_which_it_was_asked_for(tmp_path: Path, drawn: dict[str, np.ndarray]) -> None:
    run = session(tmp_path)
    for step in (7, 9, 3):  # the run was started anew before the last one
        run.simulation.state = fake_run.fake_state(step)
        take_picture(run)
    finish_pictures(run)
    assert list(drawn) == ["picture_1_at_0.07s", "picture_2_at_0.09s", "picture_3_at_0.03s"]
    for position, step in zip(drawn.values(), (7, 9, 3), strict=True):
        np.testing.assert_array_equal(position, fake_run.fake_state(step).position)


def test_the_run_does_not_wait_but_its_end_does(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    may_draw, done = threading.Event(), []
    monkeypatch.setattr(drawn_outputs, "render_pictures", lambda *_: done.append(may_draw.wait(60)))
    run = session(tmp_path)
    take_picture(run)
    take_picture(run)
    assert done == []
    may_draw.set()
    finish_pictures(run)
    assert done == [True, True]


def test_a_held_key_does_not_draw_for_ever(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    may_draw, done = threading.Event(), []
    monkeypatch.setattr(drawn_outputs, "render_pictures", lambda *_: done.append(may_draw.wait(60)))
    run = session(tmp_path)
    with pytest.warns(UserWarning, match=r"no picture at 0\.00 s: 8 others are not drawn yet"):
        for _ in range(30):
            take_picture(run)
    may_draw.set()
    finish_pictures(run)
    assert 8 <= len(done) <= 9, "those that waited, and one that was being drawn"


@pytest.mark.parametrize("problem", [RenderError("no driver"), ValueError("a mistake")])
def test_a_picture_that_cannot_be_drawn_is_a_warning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, drawn: dict[str, np.ndarray], problem: Exception
) -> None:
    """The next one is tried all the same."""
    render = drawn_outputs.render_pictures

    def fail_at_first(path: Path, times: dict[str, float], folder: Path) -> None:
        monkeypatch.setattr(drawn_outputs, "render_pictures", render)
        raise problem

    monkeypatch.setattr(drawn_outputs, "render_pictures", fail_at_first)
    run = session(tmp_path)
    with pytest.warns(UserWarning, match=rf"no picture .*picture_1_at_0\.00s\.png: {problem}"):
        take_picture(run)
        take_picture(run)
        finish_pictures(run)
    assert list(drawn) == ["picture_2_at_0.00s"]


def test_without_a_folder_it_says_so() -> None:
    run = session(None)
    with pytest.warns(UserWarning, match="no picture: this run has no folder"):
        take_picture(run)
    finish_pictures(run)
