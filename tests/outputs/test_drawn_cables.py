"""Cables in pictures: tubes around their points, with the colours of the tension along them."""

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from cable_block import STEPS, run_cables
from PIL import Image

from taichisoft.mechanics import CABLES
from taichisoft.mesh import count_open_edges, enclosed_volume
from taichisoft_outputs import Recording, Style, read_recording, render_pictures
from taichisoft_outputs.drawing.camera import outermost_points
from taichisoft_outputs.drawing.colouring import PLAIN, Colouring
from taichisoft_outputs.drawing.overlay import caption_parts
from taichisoft_outputs.drawing.painting import BEAD, LINE, SIDES, line_tubes, round_up, tube_triangles, tube_vertices
from taichisoft_outputs.recording.recording_output import RecordingOutput

FRAMES = range(STEPS + 1)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Recording]:
    folder = tmp_path_factory.mktemp("cables")
    run_cables(folder, [RecordingOutput(folder)])
    with read_recording(folder / "recording.h5") as opened:
        yield opened


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
    """Magenta is in the picture where the tendon runs, and is not without the colour of its tension."""
    magenta = []
    for style in (Style(size=(320, 180)), Style(size=(320, 180), cable_tension=False)):
        (path,) = render_pictures(recording.path, {"end": 0.01 * STEPS}, tmp_path, style)
        red, green, blue = np.asarray(Image.open(path).convert("RGB"), dtype=int)[:, :260].transpose(2, 0, 1)
        magenta.append(int(((red - green > 25) & (blue - green > 12)).sum()))
    assert magenta[0] > 150 and magenta[1] < 20
