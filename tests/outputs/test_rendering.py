"""Processes that draw: what is drawn again, what errors tell, that none is left; pictures of simulations and runs."""

import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import fake_run
import fake_worker
import numpy as np
import pytest
from bent_gripper import record_gripper
from conftest import PATIENCE
from PIL import Image

import taichisoft
import taichisoft_outputs
from taichisoft import Control, Model, Scene, Simulation, State, load_scene
from taichisoft.base import Worker, run_python
from taichisoft.base.processes import ChildResult
from taichisoft.errors import PluginError, TaichisoftError
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft_outputs import RecordingError, Style, read_recording, render_pictures
from taichisoft_outputs.recording.recording_output import RecordingOutput
from taichisoft_outputs.rendering import drawn_outputs, live_renderer, video
from taichisoft_outputs.rendering.drawn_outputs import PicturesOutput, finish_pictures, take_picture
from taichisoft_outputs.rendering.live_renderer import LiveRenderer
from taichisoft_outputs.rendering.video import RenderError, draw_frames, key_moments

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
def test_after_a_crash_a_new_process_goes_on(worker, what, problem) -> None:
    started = worker(what, at=2, times=1)
    with pytest.warns(UserWarning, match=f"stopped after 2 of 4 pictures: .*{problem}.*going on in a new process"):
        assert draw([10, 11, 12, 13]) == [10, 11, 12, 13]
    assert started.starts() == [0, 2]


def test_a_process_that_hangs_is_ended_and_replaced(worker, monkeypatch) -> None:
    monkeypatch.setattr(video, "PICTURE_LIMIT", 3.0)
    started = worker("hang", at=1, times=1)
    with pytest.warns(UserWarning, match="after 1 of 3 pictures: no answer within 3 s"):
        assert draw([7, 8, 9]) == [7, 8, 9]
    assert started.starts() == [0, 1]
    assert not any(is_alive(process) for process in started.processes())


def test_the_start_may_take_longer_than_a_frame_but_not_forever(worker, monkeypatch) -> None:
    monkeypatch.setattr(video, "START_LIMIT", 10.0)
    monkeypatch.setattr(video, "LOOK_LIMIT", 0.5)
    monkeypatch.setattr(video, "PICTURE_LIMIT", 3.0)
    worker("hang", at=0, times=1)
    with pytest.warns(UserWarning, match="after 0 of 2 pictures: no answer within 14 s"):
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


def test_an_interrupt_waits_for_no_picture(worker) -> None:
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


def test_pictures_of_one_moment_are_drawn_once(worker, tmp_path) -> None:
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


# A video of any length needs no more than so much memory: another process goes on.


LARGEST_GROWTH = 800.0 / video.PICTURES_PER_PROCESS
"""[MB] a frame: the frames of a process may cost 800 MB."""

SCRIPT = """
import resource, sys
from pathlib import Path
from taichisoft_outputs.drawing.drawer import Drawer
from taichisoft_outputs.recording.reader import read_recording
from taichisoft_outputs.drawing.style import Style

def peak():  # [MB]
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024

with read_recording(sys.argv[1]) as recording:
    drawer = Drawer(recording, Style(size=(320, 180), view="orbit", colour_by="stress"), [0, 1, 2])
    for number in range(60):
        drawer.image(number % 3)
        if number == 19:
            before = peak()
Path(sys.argv[2]).write_text(str((peak() - before) / 40))
"""


def test_memory_does_not_grow_with_the_frames(tmp_path: Path) -> None:
    growth = tmp_path / "growth"  # a file, because the renderer writes to standard output
    child = run_python(["-c", SCRIPT, str(record_gripper(tmp_path)), str(growth)], PATIENCE)
    assert not child.problem, child.problem
    assert float(growth.read_text()) < LARGEST_GROWTH


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The functions of all worker processes, of which each draws two frames."""
    functions: list[str] = []

    def start(function: str) -> Worker:
        functions.append(function)
        return Worker(function)

    for module in (video, live_renderer):
        monkeypatch.setattr(module, "PICTURES_PER_PROCESS", 2)
        monkeypatch.setattr(module, "Worker", start)
    return functions


def test_the_next_process_goes_on_with_the_frames(tmp_path: Path, started: list[str]) -> None:
    """In the same camera, which sees all frames."""
    recording, style = record_gripper(tmp_path), Style(size=(96, 54))
    images: list[np.ndarray] = []
    video.draw_frames(recording, style, [2, 0, 1], images.append, lambda: None)
    assert started == [video.WORKER] * 2
    whole: list[np.ndarray] = []
    video.PICTURES_PER_PROCESS = 3
    video.draw_frames(recording, style, [2, 0, 1], whole.append, lambda: None)
    assert started == [video.WORKER] * 3
    assert np.array_equal(images, whole)
    assert not np.array_equal(images[0], images[1])


def test_the_next_process_goes_on_with_the_pictures(started: list[str]) -> None:
    simulation = taichisoft.Simulation(taichisoft.load_scene("finger-inflated"))
    pictures = [simulation.render(size=(96, 54)) for _ in range(3)]
    assert started == [live_renderer.WORKER] * 2
    assert np.array_equal(pictures[0], pictures[2])


# Pictures of the present state, from a process that stays.


SMALL = (160, 120)


def process_id(simulation: Simulation) -> int:
    (renderer,) = simulation._kept.values()
    return renderer._process.worker.process.pid  # type: ignore[attr-defined]


def blue(picture: np.ndarray) -> np.ndarray:
    """Rows and columns of the pixels that show the cube, the only thing that is blue."""
    red, _, blue = np.moveaxis(picture.astype(int), -1, 0)
    return np.argwhere(blue > red + 60)


def test_the_process_of_pictures_stays_and_is_replaced(taichisoft_scene: Scene) -> None:
    simulation = Simulation(taichisoft_scene)
    start = simulation.state
    first = simulation.render("front", SMALL)
    process = process_id(simulation)
    assert first.shape == (120, 160, 3)
    assert first.dtype == np.uint8
    simulation.restore(start.changed(rigid_position=start.rigid_position + np.array([0.0, 0.0, 10.0])))
    risen = simulation.render("front", SMALL)
    # The pads are 52 mm apart, which is most of the picture's width: 10 mm are more than ten pixels.
    assert blue(risen)[:, 0].mean() < blue(first)[:, 0].mean() - 10
    assert process_id(simulation) == process
    os.kill(process, signal.SIGKILL)
    simulation.restore(start)
    with pytest.warns(UserWarning, match="the renderer stopped: .*; another takes its place"):
        again = simulation.render("front", SMALL)
    assert np.array_equal(again, first)
    simulation.close()
    assert not simulation._kept


def test_an_interrupted_picture_is_not_taken_for_the_next(taichisoft_scene: Scene) -> None:
    """Ctrl and c while the picture is drawn: what the process still sends belongs to no later picture."""
    renderer = LiveRenderer(Simulation(taichisoft_scene).model, SMALL, "front")
    ended = []

    class Interrupted:
        drawn = 0

        def draw(self, state: object, marks: object, camera: object) -> None:
            raise KeyboardInterrupt

        def end(self) -> None:
            ended.append(self)

    renderer._process = Interrupted()  # type: ignore[assignment]
    with pytest.raises(KeyboardInterrupt):
        renderer.picture(Simulation(taichisoft_scene).state, np.zeros((0, 3)))
    assert ended
    assert renderer._process is None


def test_a_camera_at_a_point_looks_where_it_is_told(taichisoft_scene: Scene) -> None:
    simulation = Simulation(taichisoft_scene)
    simulation.step(Control(pressure={"left.cavity": 1.0}))
    middle = blue(simulation.render(((0.0, -150.0, 5.2), (0.0, 0.0, 5.2)), SMALL)).mean(axis=0)
    assert np.allclose(middle, [59.5, 79.5], atol=3.0)
    simulation.close()


def test_a_mark_is_seen_where_its_point_is_also_behind_a_body(taichisoft_scene: Scene) -> None:
    simulation = Simulation(taichisoft_scene)
    camera = ((0.0, -150.0, 5.2), (0.0, 0.0, 5.2))
    plain = simulation.render(camera, SMALL).astype(int)
    marked = simulation.render(camera, SMALL, marks=[[0.0, 20.0, 5.2], [0.0, -400.0, 5.2]]).astype(int)
    changed = np.argwhere(np.abs(marked - plain).max(axis=-1) > 20)
    assert len(changed) > 5  # and what is behind the camera is nowhere
    assert np.allclose(changed.mean(axis=0), [59.5, 79.5], atol=1.0)
    assert np.abs(changed - [59.5, 79.5]).max() < 5
    simulation.close()


@pytest.mark.parametrize(
    ("camera", "size", "problem"),
    [
        ("above", SMALL, "no view is called 'above'"),
        ("orbit", SMALL, "camera 'orbit' needs a whole run"),
        ("follow:ball", SMALL, "no body is called 'ball'; there are: left, right, cube"),
        (((0.0, 0.0, 0.0),), SMALL, "two points"),
        ("iso", (4, 4), "from 16 to 8192 pixels"),
    ],
)
def test_what_cannot_be_drawn_is_refused(
    taichisoft_scene: Scene, camera: object, size: tuple[int, int], problem: str
) -> None:
    with pytest.raises(TaichisoftError, match=problem):
        Simulation(taichisoft_scene).render(camera, size)  # type: ignore[arg-type]


def test_a_renderer_that_nobody_provides_is_refused(taichisoft_scene: Scene) -> None:
    with pytest.raises(PluginError, match="no renderer is called 'paint'; there are: open3d"):
        Simulation(taichisoft_scene).render(renderer="paint")


# Pictures of a run.


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


def test_a_run_draws_three_pictures_with_everything_inside(folder, without_signs):
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


def test_a_child_process_that_hangs_crashes_or_fails_is_reported():
    assert run_python(["-c", "while True: pass"], 0.5).problem == "no answer within 0.5 s"
    crash = "import os, signal; os.kill(os.getpid(), signal.SIGSEGV)"
    assert "SIGSEGV" in run_python(["-c", crash], 20).problem
    assert run_python(["-c", "raise OSError('no libGL')"], 20).problem == "OSError: no libGL"
    assert run_python(["-c", "print(42)"], 20) == ChildResult("", "42\n")


# The picture key.


@cache
def made_steps() -> tuple[Model, list[State]]:
    """A model and its states after 0 to 10 steps of 10 ms."""
    simulation = Simulation(load_scene(TINY_GRIPPER, ["time.step=0.01"]))
    return simulation.model, [simulation.state, *(simulation.step() and simulation.state for _ in range(10))]


def session(folder: Path | None, step: int = 0) -> Any:
    model, states = made_steps()
    return SimpleNamespace(simulation=SimpleNamespace(model=model, state=states[step]), folder=folder)


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> dict[str, np.ndarray]:
    """Instead of drawing: which nodes were to be drawn, by name of the picture."""
    pictures: dict[str, np.ndarray] = {}

    def render(path: Path, times: dict[str, float], folder: Path) -> None:
        with read_recording(path) as recording:
            for name, time in times.items():
                pictures[name] = recording.row("position", recording.instant_at(time))

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
        run.simulation.state = made_steps()[1][step]
        take_picture(run)
    finish_pictures(run)
    assert list(drawn) == ["picture_1_at_0.07s", "picture_2_at_0.09s", "picture_3_at_0.03s"]
    for position, step in zip(drawn.values(), (7, 9, 3), strict=True):
        np.testing.assert_array_equal(position, made_steps()[1][step].position)


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
