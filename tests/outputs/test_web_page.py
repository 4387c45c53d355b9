"""What a page draws of a run and of its recording, which is played, scrubbed, and followed while its run goes on."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import PATIENCE
from fake_run import CUBE, CUBE_FACES
from panel_viewer import PanelViewer, served
from tiny_run import STEPS, command, make_run, tiny_run

from taichisoft import Control, Scene, Session, Simulation
from taichisoft_controllers.keyboard_controller import KeyboardController
from taichisoft_outputs import RecordingError, read_recording
from taichisoft_outputs.drawing.overlay import caption_parts
from taichisoft_outputs.drawing.surface_painter import split_creases
from taichisoft_outputs.recording.recording_output import RecordingOutput
from taichisoft_outputs.web.address import find_address
from taichisoft_outputs.web.curves import MOST_POINTS, WINDOW, History, plotted_row
from taichisoft_outputs.web.page import ASPECT, FREE, view_above_panel
from taichisoft_outputs.web.page_messages import PageInstant
from taichisoft_outputs.web.recording_page import Playback, instant_of
from taichisoft_outputs.web.web_output import page_setup, snapshot


def test_creases_split_the_corners_of_a_cube() -> None:
    source, triangles = split_creases(CUBE, CUBE_FACES)
    assert np.bincount(source).tolist() == [3] * 8
    np.testing.assert_array_equal(source[triangles], CUBE_FACES)
    for first, second in triangles.reshape(6, 2, 3):
        assert len({*first, *second}) == 4


def test_what_bends_gently_is_not_split() -> None:
    """A tube of 24 sides turns by 15 degrees from side to side; its open ends are no creases."""
    angle = 2 * np.pi * np.arange(24) / 24
    ring = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(24)])
    start, stop = np.arange(24), np.roll(np.arange(24), -1)
    sides = np.vstack([np.column_stack([start, stop, stop + 24]), np.column_stack([start, stop + 24, start + 24])])
    source, triangles = split_creases(np.vstack([ring, ring + np.array([0, 0, 1])]), sides)
    assert sorted(source) == list(range(48))
    np.testing.assert_array_equal(source[triangles], sides)


SCENE = Scene.model_validate(
    {
        "gravity": [-9810.0, 0.0, 0.0],
        "soft_bodies": {
            name: {"mesh": "m", "mass": 1.0, "young_modulus": 500.0, "poisson_ratio": 0.3} for name in ("left", "right")
        },
        "rigid_bodies": {name: {"box": [1.0, 1.0, 1.0], "mass": 1.0} for name in ("ball", "cube")},
        "goal": {"object": "cube"},
    }
)


def on_page(forces: dict, peaks: dict, wrench: np.ndarray = np.arange(6.0).reshape(2, 1, 3)) -> dict:
    """Names and values of the figures of a page."""
    of_pairs = {"normal_force": forces, "peak_pressure": peaks}
    figures = {name: (list(of), np.array([*of.values()])) for name, of in of_pairs.items()}
    return figures | {"base_force": ([""], wrench[0]), "base_torque": ([""], wrench[1])}


def frame(time: float, height: float = 0.0) -> PageInstant:
    """A frame of a run with one cavity and one cable, in which the second rigid body is gripped."""
    forces = {("left", "cube"): 3.0, ("cube", "right"): 2.0, ("cube", "floor"): 9.0, ("left", "ball"): 7.0}
    places, nothing = np.array([[99.0, 0.0, 0.0], [height, 0.0, 0.0]]), np.zeros((0, 3))
    peaks = {("left", "cube"): 0.25}
    plotted = plotted_row(SCENE, np.array([10.0 * time, 400.0 * time]), on_page(forces, peaks), places)
    signals = {"force": 5.0} if time else {}
    return PageInstant(time, None, {}, nothing, nothing, plotted, signals)


def test_curves_have_efforts_forces_and_height() -> None:
    history = History(frame(0.0, height=5.0))
    history.add(frame(0.5, height=7.5))
    assert history.times == [0.5]
    assert history.rows[0].tolist() == [5.0, 200.0, *range(6), 3.0, 2.0, 0.25, 0.0, 2.5]


def test_a_scene_without_rigid_bodies_has_pressures_only() -> None:
    alone = SCENE.model_copy(update={"rigid_bodies": {}, "goal": None})
    figures = on_page({("left", "right"): 3.0}, {}, np.ones((2, 1, 3)))
    row = plotted_row(alone, np.array([4.0]), figures, np.zeros((0, 3)))
    assert row.tolist() == [4.0, *[1.0] * 6, *[0.0] * 4, 0.0]


def test_curves_show_the_last_seconds() -> None:
    history, count = History(frame(0.0)), 4000
    history.add(frame(0.0))
    for step in range(1, count):
        history.add(frame(0.01 * step))
        history.add(frame(0.01 * step))
    newest = 0.01 * (count - 1)
    assert history.times[-1] == newest and newest - WINDOW <= history.times[0] < newest - 0.99 * WINDOW
    assert 0.9 * 20.0 / 0.07 < len(history.times) <= MOST_POINTS + 1
    assert np.ptp(np.diff(history.times)[:-1]) < 1e-9, "evenly spaced"
    assert [len(history.rows), len(history.signals["force"])] == [len(history.times)] * 2
    history.add(frame(0.02))
    assert history.times == [0.02], "a new start begins new curves"


def test_a_recording_has_the_frames_that_the_run_showed(taichisoft_scene: Scene, tmp_path: Path) -> None:
    simulation = Simulation(taichisoft_scene)
    session = Session(simulation, KeyboardController(), duration=1.0)
    press = Control(pressure={"left.cavity": 9.0, "right.cavity": 9.0})
    make_run(simulation, [RecordingOutput(tmp_path)], [press] * 30)
    make_run(simulation, [RecordingOutput(tmp_path / "rest")], [])  # goes on from there, and begins with forces
    setup = page_setup(session, find_address("127.0.0.1:0"), snapshot(session, simulation.state))
    live = setup.first.instant
    with read_recording(tmp_path / "rest" / "recording.h5") as rest:
        first = instant_of(rest, 0)
        assert caption_parts(rest, 0)[1] == "pressure 9.0 kPa"
    with read_recording(tmp_path / "recording.h5") as read:
        recorded = instant_of(read, 30)
        np.testing.assert_array_equal(first.plotted, recorded.plotted)
        np.testing.assert_array_equal(first.contact_forces, recorded.contact_forces)
        for shown, surface in zip(setup.content.surfaces, read.body_surfaces, strict=True):
            assert (shown.name, shown.kind) == (surface.name, surface.kind)
            np.testing.assert_array_equal(shown.triangles, surface.triangles)
            places = surface.vertices(recorded.poses), shown.vertices(live.poses)
            np.testing.assert_allclose(*places, rtol=1e-6, err_msg="a snapshot has single precision")
        names = setup.content.actuators.names
        assert (setup.content.scene, names) == (read.scene, (*read.cavities, *read.cables))
    assert recorded.time == live.time
    np.testing.assert_allclose(recorded.plotted, live.plotted)
    assert live.plotted[:2] == pytest.approx(9.0) and live.plotted[8] > 0.0, "there is something to see"
    assert len(recorded.contact_forces) > 0
    np.testing.assert_array_equal(recorded.contact_forces, live.contact_forces)


def test_playback_follows_the_clock() -> None:
    playback = Playback(np.array([0.0, 0.1, 0.2, 0.0, 0.1]))
    assert playback.length == pytest.approx(0.3)
    playback.advance(0.15)
    assert playback.instant == 1
    playback.speed = 2.0
    playback.advance(0.05)
    assert playback.instant == 3
    playback.advance(1.0)
    assert (playback.instant, playback.position) == (4, playback.length)
    playback.extend(np.array([0.0, 0.1, 0.2, 0.0, 0.1, 0.2, 0.3]))
    playback.advance(0.05)
    assert playback.instant == 5
    playback.play_or_pause()
    playback.advance(1.0)
    assert playback.instant == 5
    playback.position = playback.length
    playback.play_or_pause()
    assert (playback.instant, playback.playing) == (0, True)


@pytest.mark.parametrize("aspect", [0.45, 0.6, 0.95])
def test_a_narrow_window_has_everything_above_the_panel(aspect: float) -> None:
    """The corners of the usual picture, at the distance of its middle, come into the uppermost 40 % of the window."""
    eye, target, up, fov = np.array([3.0, -4.0, 2.0]), np.array([0.0, 0.5, 0.3]), np.array([0.0, 0.0, 1.0]), 0.6

    def axes(eye: np.ndarray, target: np.ndarray) -> np.ndarray:
        forward = (target - eye) / np.linalg.norm(target - eye)
        right = np.cross(forward, up) / np.linalg.norm(np.cross(forward, up))
        return np.array([right, np.cross(right, forward), forward])

    right, upwards, _ = axes(eye, target)
    reach = np.tan(0.5 * fov) * np.linalg.norm(eye - target)
    corners = [target + reach * (ASPECT * x * right + y * upwards) for x in (-1, 1) for y in (-1, 1)]
    closer, lower = view_above_panel(eye, target, up, fov, aspect)
    x, y, depth = axes(closer, lower) @ (np.array(corners) - closer).T
    tangent = depth * np.tan(0.5 * fov)
    assert np.abs(x / (aspect * tangent)).max() <= 1.0 + 1e-9
    assert (y / tangent).max() <= 1.0 + 1e-9 and (y / tangent).min() >= 1.0 - 2.0 * FREE - 1e-9
    np.testing.assert_allclose((y / tangent).mean(), 1.0 - FREE)


# The page of a recording, seen by a viewer.


pytest.importorskip("viser", reason="needs the extra 'web'")


def cube(viewer: PanelViewer) -> np.ndarray:
    """Its centre [mm], as drawn."""
    return 100.0 * viewer.vertices["/cube"].mean(axis=0)


def test_a_recording_is_played_to_its_end_and_scrubbed(tmp_path: Path) -> None:
    tiny_run(tmp_path)
    with (
        read_recording(tmp_path / "recording.h5") as recording,
        served(tmp_path / "recording.h5") as (page, viewer, until),
    ):
        places = recording.column("rigid_position")[:, 0]
        time_step = recording.step_size
        viewer.find("time [s]")
        until(lambda: viewer.value("time [s]") == pytest.approx(STEPS * time_step))
        until(lambda: np.allclose(cube(viewer), places[STEPS], atol=1e-3))
        viewer.set("time [s]", 5 * time_step)
        until(lambda: np.allclose(cube(viewer), places[5], atol=1e-3))
        until(lambda: page.playback.position == 5 * time_step and not page.playback.playing)
        viewer.set("speed [x real time]", 0.5)
        viewer.press("space")
        until(lambda: viewer.value("time [s]") > 10 * time_step)


def test_equal_curves_can_be_told_apart(tmp_path: Path) -> None:
    """Both pads have the same pressure: the second line has gaps."""
    tiny_run(tmp_path)
    with served(tmp_path / "recording.h5") as (_, viewer, until):
        until(lambda: any("series" in element for element in list(viewer.elements.values())))
        first = next(element["series"] for element in list(viewer.elements.values()) if "series" in element)
        assert [line["label"] for line in first[1:]] == ["left.cavity", "right.cavity"]
        assert not first[1]["dash"] and len(first[2]["dash"]) == 2


def test_a_section_cuts_bodies_open_until_it_is_taken_away(tmp_path: Path) -> None:
    """The pads and the cube are symmetric about y = 0: half of each is left, and closed where it is cut."""
    tiny_run(tmp_path)
    with served(tmp_path / "recording.h5") as (_, viewer, until):
        viewer.find("section")
        whole = {name: viewer.vertices[name].shape for name in ("/cube", "/left", "/left.cavity")}

        def ends(name: str) -> list[float]:
            return [100.0 * float(viewer.vertices[name][:, 1].min()), 100.0 * float(viewer.vertices[name][:, 1].max())]

        viewer.set("section", "y<0")
        until(lambda: ends("/cube") == pytest.approx([-5.0, 0.0], abs=1e-3))
        until(lambda: ends("/left.cavity")[1] == pytest.approx(0.0, abs=1e-3) == ends("/left")[1])
        corners = 100.0 * viewer.vertices["/cube"].reshape(-1, 3, 3)
        volume = np.linalg.det(corners - corners.mean(axis=(0, 1))).sum() / 6.0
        assert volume == pytest.approx(500.0, rel=1e-3)
        viewer.set("section", "y<")
        until(lambda: any("must be a plane" in str(element.get("_markdown")) for element in viewer.elements.values()))
        viewer.set("section", "")
        until(lambda: {name: viewer.vertices[name].shape for name in whole} == whole)


GOING_ON = """
import sys
from pathlib import Path
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft.running.scene_files import load_scene
from taichisoft.running.simulation import Simulation
from taichisoft_outputs.recording.recording_output import RecordingOutput

simulation = Simulation(load_scene(TINY_GRIPPER))
recording = RecordingOutput(Path(sys.argv[1]))
recording.begin(simulation.model, simulation.state)
for _ in range(2):
    for _ in range(60):
        report = simulation.step()
        recording.record(simulation.state, report)
    print("60 steps", flush=True)
    sys.stdin.readline()
recording.end("completed")
"""


def test_a_page_follows_a_running_simulation(tmp_path: Path) -> None:
    """The lock of a reader would keep the run from closing its file."""
    command = [sys.executable, "-c", GOING_ON, str(tmp_path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1) as run:
        assert run.stdin is not None and run.stdout is not None
        assert run.stdout.readline() == "60 steps\n"
        with served(tmp_path / "recording.h5") as (_, viewer, until):
            viewer.find("time [s]")
            run.stdin.write("\n\n")
            until(lambda: viewer.value("time [s]") == pytest.approx(1.2))
            until(lambda: any("completed" in str(element.get("_markdown")) for element in viewer.elements.values()))
        assert run.wait(PATIENCE) == 0
    with read_recording(tmp_path / "recording.h5") as read:
        assert (read.outcome, read.instant_count) == ("completed", 121)


def test_what_cannot_be_viewed_is_one_line(tmp_path: Path) -> None:
    result = command("view", str(tmp_path / "none.h5"))
    assert isinstance(result.exception, RecordingError)
    result = command("view", str(tmp_path / "none.h5"), "--address", "8080")
    assert "must look like 127.0.0.1:8080" in str(result.exception)
    result = command("view", str(tmp_path / "none.h5"), "--section", "y")
    assert "section 'y' must be a plane in mm" in str(result.exception)
