"""Cables in a recording, in pictures and on a page: seen without the model, and carried on to the bit."""

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cable_block import LINK, STEPS, TENDON, cable_scene, control, run_cables
from panel_viewer import served
from PIL import Image

from taichisoft import Control, Controller, Observation, Output, Session, Simulation, State, StepReport
from taichisoft.mechanics import CABLES
from taichisoft.mesh import count_open_edges, enclosed_volume
from taichisoft.scene import scene_from_toml
from taichisoft_outputs import Recording, Style, read_recording, render_pictures
from taichisoft_outputs.drawing.camera import outermost_points
from taichisoft_outputs.drawing.colouring import (
    BEAD,
    LINE,
    PLAIN,
    SIDES,
    Colouring,
    ColourScale,
    line_tubes,
    round_up,
    tube_triangles,
    tube_vertices,
)
from taichisoft_outputs.drawing.overlay import caption_parts
from taichisoft_outputs.recording.recording_output import RecordingOutput
from taichisoft_outputs.recording.resume import ResumeError, resumed_simulation, state_at
from taichisoft_outputs.web.address import find_address
from taichisoft_outputs.web.page_messages import lines_shown
from taichisoft_outputs.web.recording_page import instant_of
from taichisoft_outputs.web.web_output import page_setup, snapshot


class Kept(Output):
    """Keeps all states and reports."""

    def begin(self, model: Any, state: State) -> None:
        self.model, self.states = model, [state]
        self.reports: list[StepReport] = []

    def record(self, state: State, report: StepReport) -> None:
        self.states.append(state)
        self.reports.append(report)

    def end(self, outcome: str) -> None:
        pass


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Recording, Kept]]:
    folder, kept = tmp_path_factory.mktemp("cables"), Kept()
    run_cables(folder, [RecordingOutput(folder), kept])
    with read_recording(folder / "recording.h5") as recording:
        yield recording, kept


def test_every_state_comes_back_bit_for_bit(run: tuple[Recording, Kept]) -> None:
    recording, kept = run
    assert [state_at(recording, frame) for frame in range(STEPS + 1)] == kept.states


def test_tensions_lengths_and_pulls_stand_in_named_columns(run: tuple[Recording, Kept]) -> None:
    recording, kept = run
    assert recording.cables == [TENDON, LINK]
    for column, seen in (("tension", "cable_tensions"), ("cable_length", "cable_lengths"), ("pull", "cable_pulls")):
        for frame, report in enumerate(kept.reports, start=1):
            expected = getattr(report.observation, seen)
            assert dict(zip(recording.cables, recording.row(column, frame), strict=True)) == expected
    assert recording.row("pull", 0).tolist() == [0.0, 0.0]
    assert recording.row("pull", STEPS)[0] == pytest.approx(0.2 * STEPS, rel=0.01)
    assert recording.row("tension", STEPS)[1] == pytest.approx(5.0 * STEPS)


def test_points_are_those_of_the_state_without_the_model(run: tuple[Recording, Kept]) -> None:
    recording, kept = run
    paths = kept.model.cables.lines
    for frame in (0, 5, STEPS):
        for recorded, path in zip(recording.cable_points(frame), paths, strict=True):
            np.testing.assert_allclose(recorded, path.points(kept.states[frame], kept.model.frames), atol=1e-5)
    for recorded_path, path in zip(recording.lines(CABLES), paths, strict=True):
        assert vars(recorded_path).keys() == vars(path).keys()
        for name, value in vars(path).items():
            np.testing.assert_array_equal(getattr(recorded_path, name), value, err_msg=name)
    moved = recording.cable_points(STEPS)[0] - recording.cable_points(0)[0]
    assert np.linalg.norm(moved, axis=1).min() > 0.5, "there is something to see"
    tendon, link = recording.segment_efforts(CABLES, STEPS)
    assert tendon[-1] == recording.row("tension", STEPS)[0] - recording.row("tension_loss", STEPS).sum()
    assert link.tolist() == [recording.row("tension", STEPS)[1]]


def test_a_run_without_cables_has_none(tmp_path: Path) -> None:
    run_cables(tmp_path, [RecordingOutput(tmp_path)], cables=False)
    with read_recording(tmp_path / "recording.h5") as recording:
        assert (recording.cables, recording.cable_points(1), recording.segment_efforts(CABLES, 1)) == ([], [], [])
        assert recording.column("tension").shape == (STEPS + 1, 0)


def test_a_run_goes_on_to_the_bit(run: tuple[Recording, Kept]) -> None:
    recording, kept = run
    simulation = resumed_simulation(recording, 5, recording.scene)
    for step in range(5, STEPS):
        simulation.step(control(step))
    assert simulation.state == kept.states[-1]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("points=[[-10.0, 2.0, 4.0], [18.0, 0.0, 4.0]]", "'block.tendon' is not as it was recorded: its places were 5"),
        ("pull_point=[-31.0, 0.0, 4.0]", "'block.tendon' is not as it was recorded: its places differ by up to 1 mm"),
        (
            "points=[[-10.0, 2.0, 4.0], [0.0, -2.0, 3.5], [10.0, 1.0, 4.5], [18.0, 0.5, 4.0]]",
            "'block.tendon' is not as it was recorded: its points differ by up to 0.5 mm",
        ),
        ("friction=0.0", "its actuator_loss has shape (3,), the model's (0,)"),
    ],
)
def test_another_cable_is_refused(run: tuple[Recording, Kept], change: str, message: str) -> None:
    recording, _ = run
    scene = scene_from_toml(recording.scene_text, "scene", [f"soft_bodies.block.cables.tendon.{change}"])
    with pytest.raises(ResumeError) as caught:
        resumed_simulation(recording, 5, scene)
    assert message in str(caught.value)


def test_another_limit_is_the_same_cable(run: tuple[Recording, Kept]) -> None:
    recording, _ = run
    scene = scene_from_toml(recording.scene_text, "scene", ["soft_bodies.block.cables.tendon.highest_pull=1.0"])
    assert isinstance(resumed_simulation(recording, 2, scene), Simulation)
    assert cable_scene(recording.path.parent) == recording.scene


# Drawn cables.


FRAMES = range(STEPS + 1)


@pytest.fixture(scope="module")
def recording(run: tuple[Recording, Kept]) -> Recording:
    return run[0]


def test_a_tube_has_its_radius_and_beads() -> None:
    """Each vertex of the straight parts is at the radius from the line, each of a bead at the bead's from its point."""
    points, radius = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [10.0, 6.0, 8.0]]), 0.5
    vertices = tube_vertices(points, radius)
    rings = vertices[: 4 * SIDES].reshape(2, 2, SIDES, 3)
    for ends, corners in zip(rings, pairwise(points), strict=True):
        along = (corners[1] - corners[0]) / np.linalg.norm(corners[1] - corners[0])
        for ring, corner in zip(ends, corners, strict=True):
            np.testing.assert_allclose((ring - corner) @ along, 0.0, atol=1e-12)
            np.testing.assert_allclose(np.linalg.norm(ring - corner, axis=1), radius)
    beads = vertices[4 * SIDES :].reshape(3, -1, 3) - points[:, None]
    np.testing.assert_allclose(np.linalg.norm(beads, axis=2), BEAD * radius)


def test_triangles_of_a_tube_are_seen_from_outside() -> None:
    """A tube, closed by its ends, has the volume of a prism, and beads those of balls, to what few sides leave out."""
    points, radius = np.array([[0.0, 0.0, 0.0], [0.0, 100.0, 0.0]]), 2.0
    vertices, triangles = tube_vertices(points, radius), tube_triangles(2)
    tube, beads = np.split(triangles, [2 * SIDES])
    lids = [[s, t, t + 1] for s, t in ((0, k) for k in range(1, SIDES - 1))]
    lids = np.concatenate([np.array(lids)[:, ::-1], np.array(lids) + SIDES])
    closed = np.concatenate([tube, lids])
    assert count_open_edges(closed) == 0
    assert enclosed_volume(vertices, closed) == pytest.approx(
        0.5 * SIDES * np.sin(2 * np.pi / SIDES) * radius**2 * 100.0
    )
    ball = 4.0 / 3.0 * np.pi * (BEAD * radius) ** 3
    assert enclosed_volume(vertices, beads) == pytest.approx(2 * ball, rel=0.2)


def test_tubes_follow_the_recorded_points(recording: Recording) -> None:
    for frame in (0, STEPS):
        for tube, points in zip(line_tubes(recording, 0), recording.cable_points(frame), strict=True):
            first = 2 * SIDES * (len(points) - 1)
            beads = tube.vertices(frame)[first:].reshape(len(points), -1, 3)
            middles = (beads.max(axis=1) + beads.min(axis=1)) / 2
            np.testing.assert_allclose(middles, points, atol=1e-9)
            assert tube.triangles.max() < len(tube.vertices(frame))


def test_the_camera_sees_the_pull_point(recording: Recording) -> None:
    tubes = line_tubes(recording, 0)
    points = outermost_points([*recording.surfaces, *tubes], FRAMES)
    assert points[:, 0].min() < -30.0 < outermost_points(recording.surfaces, FRAMES)[:, 0].min()


def test_colours_are_those_of_the_tension_along_a_cable(recording: Recording) -> None:
    tubes = line_tubes(recording, 0)
    colouring = Colouring(recording, Style(), FRAMES, [*recording.surfaces, *tubes])
    (scale,) = colouring.scales
    highest = recording.column("tension").max()
    assert (scale.title, scale.low, scale.high) == ("tension [mN]", 0.0, round_up(highest))
    tendon, link = tubes
    assert np.allclose(colouring.colours(0)[tendon.name], LINE[0]), "grey without tension"
    colours = colouring.colours(STEPS)
    along, _ = recording.segment_efforts(CABLES, STEPS)
    for segment, tension in enumerate(along):
        ends = colours[tendon.name][2 * SIDES * segment : 2 * SIDES * (segment + 1)]
        assert np.allclose(ends, scale.colours(np.array([tension])))
    assert not np.allclose(colours[tendon.name][0], colours[tendon.name][2 * SIDES * 3]), "friction takes some"
    assert np.allclose(colours[link.name], scale.colours(np.array([60.0])), atol=1e-6)


def test_tension_that_nobody_wants_to_see_has_no_bar(recording: Recording, tmp_path: Path) -> None:
    tubes = line_tubes(recording, 0)
    colouring = Colouring(recording, Style(cable_tension=False), FRAMES, [*recording.surfaces, *tubes])
    assert colouring.scales == ()
    assert tuple(colouring.colours(STEPS)[tubes[0].name]) == PLAIN["line"]
    assert Colouring(recording, Style(), [0], [*recording.surfaces, *tubes]).scales == (), "nothing pulls yet"
    run_cables(tmp_path, [RecordingOutput(tmp_path)], cables=False)
    with read_recording(tmp_path / "recording.h5") as without:
        assert line_tubes(without, 0) == []
        assert Colouring(without, Style(), FRAMES, without.surfaces).scales == ()
        assert caption_parts(without, 0) == ["0.00 s", "cube raised 0.0 mm"]


def test_the_caption_has_the_tensions(recording: Recording) -> None:
    assert caption_parts(recording, 0) == ["0.00 s", "tension 0 mN", "cube raised 0.0 mm"]
    tensions = recording.row("tension", STEPS)
    assert caption_parts(recording, STEPS)[1] == f"tensions {tensions[0]:.0f}, 60 mN"


def test_a_cable_is_seen_through_the_silicone(recording: Recording, tmp_path: Path) -> None:
    """Magenta is in the picture where the tendon runs, and is not before it is pulled."""
    magenta = []
    moments = {"start": 0.0, "end": 0.01 * STEPS}
    for path in render_pictures(recording.path, moments, tmp_path, Style(size=(320, 180))):
        red, green, blue = np.asarray(Image.open(path).convert("RGB"), dtype=int)[:, :260].transpose(2, 0, 1)
        magenta.append(int(((red - green > 25) & (blue - green > 12)).sum()))
    assert magenta[0] < 20 and magenta[1] > 100


# Cables on a page.


class Idle(Controller):
    """Asks for nothing."""

    def control(self, observation: Observation) -> Control:
        return Control()


def test_lines_run_from_point_to_point_of_each_cable() -> None:
    points = [np.arange(9.0).reshape(3, 3), -np.arange(6.0).reshape(2, 3)]
    lines, tensions = lines_shown(points, [np.array([5.0, 4.0]), np.array([7.0])])
    assert lines[:, 0].tolist() == [[0, 1, 2], [3, 4, 5], [0, -1, -2]]
    assert lines[:, 1].tolist() == [[3, 4, 5], [6, 7, 8], [-3, -4, -5]]
    assert tensions.tolist() == [5.0, 4.0, 7.0]
    lines, tensions = lines_shown([], [])
    assert (lines.shape, tensions.shape) == ((0, 2, 3), (0,))


def test_a_live_page_shows_what_its_recording_shows(recording: Recording, tmp_path: Path) -> None:
    simulation = run_cables(tmp_path)
    session = Session(simulation, Idle(), duration=1.0)
    setup = page_setup(session, find_address("127.0.0.1:0"), snapshot(session, simulation.state))
    live, recorded = setup.first.instant, instant_of(recording, STEPS)
    assert list(setup.content.actuators.names) == recording.cables == [TENDON, LINK]
    np.testing.assert_array_equal(live.plotted, recorded.plotted)
    for shown, expected in zip(live.lines["cable"], recorded.lines["cable"], strict=True):
        np.testing.assert_array_equal(shown, expected)
    assert recorded.plotted[:2].tolist() == recording.row("tension", STEPS).tolist()
    assert recorded.lines["cable"].ends.shape == (5, 2, 3)
    np.testing.assert_array_equal(recorded.lines["cable"].ends[4], recording.cable_points(STEPS)[1])


def test_viewers_see_the_lines_move_and_the_curves(recording: Recording) -> None:
    pytest.importorskip("viser", reason="needs the extra 'web'")
    lines = instant_of(recording, STEPS).lines["cable"].ends.reshape(-1, 3)
    with served(recording.path) as (page, viewer, until):
        viewer.find("time [s]")
        until(lambda: np.allclose(100.0 * viewer.vertices["/cable lines"], lines, atol=1e-3))
        titles = [element.get("title") for element in viewer.elements.values()]
        assert "tension [mN]" in titles and "pressure [kPa]" not in titles
        colours = page.page.view._lines["cable"].colors
    tensions = np.concatenate(recording.segment_efforts(CABLES, STEPS))
    highest = round_up(recording.column("tension").max())
    expected = 255 * ColourScale("", 0.0, highest, LINE).colours(tensions)
    np.testing.assert_allclose(colours[:, 0], expected, atol=0.51)
    np.testing.assert_array_equal(colours[:, 0], colours[:, 1])


def test_a_page_without_cables_has_no_lines(tmp_path: Path) -> None:
    pytest.importorskip("viser", reason="needs the extra 'web'")
    run_cables(tmp_path, [RecordingOutput(tmp_path)], cables=False)
    with served(tmp_path / "recording.h5") as (_, viewer, until):
        until(lambda: viewer.value("time [s]") == pytest.approx(0.01 * STEPS))
        assert "/block" in viewer.vertices and "/cable lines" not in viewer.vertices
        assert "tension [mN]" not in [element.get("title") for element in viewer.elements.values()]
