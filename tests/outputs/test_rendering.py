"""A drawing process that hangs, crashes or cannot draw: what is drawn again, what is said, and that none is left."""

import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import fake_run
import fake_worker
import numpy as np
import pytest

from taichisoft_outputs import RecordingError, Style, render_pictures
from taichisoft_outputs.recording.recording_output import RecordingOutput
from taichisoft_outputs.rendering import video
from taichisoft_outputs.rendering.video import RenderError, draw_frames

STYLE = Style(size=(32, 16))


@pytest.fixture
def worker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., SimpleNamespace]:
    """Makes the process misbehave; what is returned tells with which frames processes began, and which are alive."""
    log = tmp_path / "started"

    def begin(what: str = "nothing", at: int = 0, times: int = 0) -> SimpleNamespace:
        fake_worker.stand_in(monkeypatch, log, what, at, times)
        return SimpleNamespace(
            starts=lambda: [int(line.split()[0]) for line in log.read_text().splitlines()],
            processes=lambda: [int(line.split()[1]) for line in log.read_text().splitlines()] if log.exists() else [],
        )

    return begin


def draw(frames: list[int], stop_if_asked: Callable[[], None] = lambda: None) -> list[int]:
    """The frames that were drawn, told from their colours."""
    colours = []

    def take(image: np.ndarray) -> None:
        assert image.shape == (16, 32, 3) and image.dtype == np.uint8 and np.ptp(image) == 0
        colours.append(int(image[0, 0, 0]))

    draw_frames(Path("run.h5"), STYLE, frames, take, stop_if_asked)
    return colours


def test_frames_come_in_order_from_one_process(worker) -> None:
    started = worker()
    assert draw([3, 5, 8]) == [3, 5, 8]
    assert started.starts() == [0]


@pytest.mark.parametrize(
    ("what", "problem"), [("crash", "SIGSEGV"), ("stop", "ended without an answer"), ("fail", "libEGL")]
)
def test_after_a_crash_a_new_process_goes_on_with_the_frame_where_the_first_stopped(worker, what, problem) -> None:
    started = worker(what, at=2, times=1)
    with pytest.warns(UserWarning, match=f"stopped after 2 of 4 frames: .*{problem}.*going on in a new process"):
        assert draw([10, 11, 12, 13]) == [10, 11, 12, 13]
    assert started.starts() == [0, 2]


def test_a_process_that_hangs_is_ended_and_replaced(worker, monkeypatch) -> None:
    monkeypatch.setattr(video, "FRAME_LIMIT", 3.0)
    started = worker("hang", at=1, times=1)
    with pytest.warns(UserWarning, match="after 1 of 3 frames: no answer within 3 s"):
        assert draw([7, 8, 9]) == [7, 8, 9]
    assert started.starts() == [0, 1]
    assert not any(is_alive(process) for process in started.processes())


def test_the_start_may_take_longer_than_a_frame_but_not_forever(worker, monkeypatch) -> None:
    monkeypatch.setattr(video, "START_LIMIT", 10.0)
    monkeypatch.setattr(video, "LOOK_LIMIT", 0.5)
    monkeypatch.setattr(video, "FRAME_LIMIT", 3.0)
    worker("hang", at=0, times=1)
    with pytest.warns(UserWarning, match="after 0 of 2 frames: no answer within 14 s"):
        draw([1, 2])


@pytest.mark.filterwarnings("ignore:drawing stopped")
def test_when_it_fails_again_the_error_says_what_to_install(worker) -> None:
    started = worker("fail", at=1, times=9)
    with pytest.raises(
        RenderError, match=r"run.h5: cannot be drawn: ImportError: libEGL.so.1.*apt-get install .*libegl1\)"
    ):
        draw([1, 2])
    assert started.starts() == [0, 1], "one retry"


def test_what_cannot_succeed_is_not_tried_again(worker) -> None:
    started = worker("refuse", at=0, times=9)
    with pytest.raises(RenderError, match=r"^there is no body 'ball'$"):
        draw([1])
    assert started.starts() == [0]


def test_who_wants_to_stop_waits_for_no_frame_and_leaves_no_process(worker) -> None:
    started = worker("hang", at=1, times=9)
    frames: list[int] = []
    asked = time.monotonic()

    def stop_after_a_second() -> None:
        if started.processes() and time.monotonic() > asked + 1.0:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        frames = draw([1, 2], stop_after_a_second)
    assert not frames
    assert len(started.processes()) == 1
    assert not is_alive(started.processes()[0])


def test_a_failure_of_whoever_takes_the_frames_ends_the_process(worker) -> None:
    started = worker()

    def take(image: np.ndarray) -> None:
        raise RenderError("disk full")

    with pytest.raises(RenderError, match="disk full"):
        draw_frames(Path("run.h5"), STYLE, list(range(100)), take, lambda: None)
    assert not is_alive(started.processes()[0])


def test_pictures_of_one_moment_are_drawn_once_and_have_all_their_names(worker, tmp_path) -> None:
    from PIL import Image

    worker()
    fake_run.fake_run([RecordingOutput(tmp_path)], steps=8)
    times = {"late": 0.06, "early": 0.02, "again": 0.06}
    paths = render_pictures(tmp_path / "recording.h5", times, tmp_path / "new", STYLE)
    assert paths == [tmp_path / "new" / f"{name}.png" for name in times]
    assert [np.asarray(Image.open(path)).mean() for path in paths] == [6, 2, 6]


def test_a_wrong_moment_is_said_before_anything_is_started(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(video, "Worker", lambda *_: pytest.fail("a process was started"))
    fake_run.fake_run([RecordingOutput(tmp_path)], steps=3)
    with pytest.raises(RecordingError, match="nothing at 5 s"):
        render_pictures(tmp_path / "recording.h5", {"a": 5.0}, tmp_path)


def test_a_picture_that_cannot_be_written_is_named(worker, tmp_path) -> None:
    worker()
    fake_run.fake_run([RecordingOutput(tmp_path)], steps=3)
    (tmp_path / "a.png").mkdir()
    with pytest.raises(RenderError, match=r"a\.png: cannot be written"):
        render_pictures(tmp_path / "recording.h5", {"a": 0.0}, tmp_path, STYLE)


@pytest.mark.filterwarnings("error:drawing stopped")
def test_the_real_process_refuses_what_it_cannot_draw(tmp_path) -> None:
    with pytest.raises(RenderError, match=r"none\.h5: no such recording"):
        draw_frames(tmp_path / "none.h5", STYLE, [0], lambda _: None, lambda: None)


def is_alive(process: int) -> bool:
    """Whether there is such a process, also one that has ended and was not waited for."""
    if sys.platform == "win32":
        pytest.skip("asks as POSIX does")
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return True
