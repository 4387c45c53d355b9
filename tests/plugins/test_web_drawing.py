"""What a page draws: surfaces with sharp edges, curves that fit, and the frames of a run and of its recording."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from fake_run import CUBE, CUBE_FACES

from taichisoft.building.simulation import Simulation
from taichisoft.control.control import Control
from taichisoft.scenes.scene import Scene
from taichisoft_plugins.recording.output import RecordingOutput
from taichisoft_plugins.recording.reader import read_recording
from taichisoft_plugins.web import recorded_frames
from taichisoft_plugins.web.creases import split_creases
from taichisoft_plugins.web.curves import MOST_POINTS, History
from taichisoft_plugins.web.frame import Cast, Frame
from taichisoft_plugins.web.live_bodies import live_bodies
from taichisoft_plugins.web.playback import Playback


def test_a_cube_gets_three_copies_of_each_corner_and_a_flat_face_shares_its_own() -> None:
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


def cast_and_frame(time: float, height: float = 0.0) -> tuple[Cast, Frame]:
    up = np.array([1.0, 0.0, 0.0])
    cast = Cast("", up, (), (), ("left.air",), ("left", "right"), "cube")
    forces = {"left|cube": 3.0, "cube|right": 2.0, "cube|floor": 9.0}
    place = np.array([[height, 0.0, 0.0]])
    nothing = np.zeros((0, 3))
    return cast, Frame(time, (), place, nothing, nothing, {"left.air": 10.0 * time}, forces)


def test_curves_have_pressures_forces_of_the_fingers_and_the_height_from_the_first_frame() -> None:
    cast, first = cast_and_frame(0.0, height=5.0)
    history = History(cast, first)
    history.add(cast_and_frame(0.5, height=7.5)[1])
    assert history.times == [0.5]
    assert history.rows[0].tolist() == [5.0, 3.0, 2.0, 2.5]


def test_curves_of_a_long_run_stay_small_and_reach_back_to_its_start() -> None:
    cast, first = cast_and_frame(0.0)
    history = History(cast, first)
    for step in range(20 * MOST_POINTS):
        frame = cast_and_frame(0.01 * step)[1]
        history.add(frame)
        history.add(frame)
    assert history.times[0] == 0.0 and history.times[-1] > 0.99 * 0.01 * 20 * MOST_POINTS
    assert MOST_POINTS / 2 <= len(history.times) <= MOST_POINTS
    assert np.ptp(np.diff(history.times)) < 1e-9, "evenly spaced"
    history.add(cast_and_frame(0.02)[1])
    assert history.times == [0.02], "a new start begins new curves"


def test_a_recording_has_the_frames_that_the_run_showed(taichisoft_scene: Scene, tmp_path: Path) -> None:
    simulation = Simulation(taichisoft_scene)
    bodies = live_bodies(simulation.model)
    recording = RecordingOutput(tmp_path)
    recording.begin(simulation.model, simulation.state)
    for _ in range(30):
        report = simulation.step(Control(pressure={"left.cavity": 9.0, "right.cavity": 9.0}))
        recording.record(simulation.state, report)
    recording.end("completed")
    state = simulation.state
    live = bodies.vertices(state.position, state.rigid_position, state.rigid_rotation)
    with read_recording(tmp_path / "recording.h5") as read:
        cast, frame = recorded_frames.cast_of(read), recorded_frames.frame_of(read, 30)
    assert [surface.name for surface in cast.surfaces] == [surface.name for surface in bodies.cast.surfaces]
    assert [surface.kind for surface in cast.surfaces] == [surface.kind for surface in bodies.cast.surfaces]
    assert (cast.cavities, cast.soft_bodies) == (bodies.cast.cavities, bodies.cast.soft_bodies)
    assert (cast.gripped, cast.title) == (bodies.cast.gripped, bodies.cast.title)
    for recorded, shown in zip(frame.vertices, live, strict=True):
        np.testing.assert_allclose(recorded, shown, atol=1e-9)
    assert frame.pressures == report.pressures
    assert {pair: force for pair, force in frame.normal_forces.items() if force} == pytest.approx(
        {pair: force for pair, force in report.normal_forces.items() if force}
    )
    assert len(frame.contact_forces) == report.contact_count > 0
    np.testing.assert_allclose(frame.contact_forces, report.contact_forces, atol=1e-9)


def test_playback_goes_with_the_clock_and_a_new_start_of_the_run_takes_no_time() -> None:
    playback = Playback(np.array([0.0, 0.1, 0.2, 0.0, 0.1]))
    assert playback.length == pytest.approx(0.3)
    playback.advance(0.15)
    assert playback.frame == 1
    playback.speed = 2.0
    playback.advance(0.05)
    assert playback.frame == 3
    playback.advance(1.0)
    assert (playback.frame, playback.position) == (4, playback.length)
    playback.extend(np.array([0.0, 0.1, 0.2, 0.0, 0.1, 0.2, 0.3]))
    playback.advance(0.05)
    assert playback.frame == 5
    playback.play_or_pause()
    playback.advance(1.0)
    assert playback.frame == 5
    playback.position = playback.length
    playback.play_or_pause()
    assert (playback.frame, playback.playing) == (0, True)


def test_a_recording_without_forces_or_pressures_plots_none(taichisoft_scene: Scene) -> None:
    title = 'title = "x"\n[goal]\nobject = "cube"\n'
    recorded = SimpleNamespace(
        scene=title, up=np.array([0, 0, 1.0]), surfaces=(), planes=(), cavities=["a"], pairs=[],
        rigid_bodies=(SimpleNamespace(name="cube"),), has=lambda name: name == "position",
    )  # fmt: skip
    cast = recorded_frames.cast_of(recorded)  # type: ignore[arg-type]
    assert (cast.cavities, cast.gripped) == ((), None)
