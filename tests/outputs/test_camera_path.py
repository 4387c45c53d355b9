"""In every frame all that moves is in the picture, wherever the camera goes."""

import numpy as np
import pytest

from taichisoft_outputs import Style
from taichisoft_outputs.drawing.camera import (
    MARGIN,
    camera_path,
    followed_part,
    outermost_points,
    project,
    seen_from_front,
)
from taichisoft_outputs.drawing.painting import sample_frames
from taichisoft_outputs.drawing.style import StyleError
from taichisoft_outputs.recording.reader import RecordedSurface

SIZE = (320, 180)
UP = np.array([1.0, 0.0, 0.0])
FRAMES = range(24)
CUBE = np.array([[x, y, z] for x in (-5.0, 5.0) for y in (-5.0, 5.0) for z in (-5.0, 5.0)])
FACES = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5]])


def moving(name, kind, at):
    return RecordedSurface(name, kind, FACES, lambda frame: CUBE + np.asarray(at(frame), dtype=float))


SURFACES = (
    moving("cube", "rigid", lambda frame: [0.0, 0.0, 0.0]),
    # Far away in one frame alone: a look at some of the frames would miss it.
    moving("ball", "soft", lambda frame: [60.0 if frame == 13 else 0.0, frame, 20.0]),
    moving("mountain", "obstacle", lambda frame: [0.0, 5000.0, 0.0]),
)


def path_of(style):
    followed = followed_part(None, SURFACES, style.followed) if style.followed else None
    return camera_path(style, FRAMES, outermost_points(SURFACES, FRAMES), UP, SIZE[0] / SIZE[1], followed)


@pytest.mark.parametrize("view", ["iso", "front", "top", "orbit"])
def test_nothing_that_moves_is_cut_off_in_any_frame(view):
    path = path_of(Style(size=SIZE, view=view))
    edge = MARGIN * np.array(SIZE)
    reached = []
    for frame in FRAMES:
        points = np.concatenate([surface.vertices(frame) for surface in SURFACES if surface.kind != "obstacle"])
        pixels, depth = project(path(frame), points, SIZE)
        assert depth.min() > 1.0
        assert (pixels >= edge - 0.5).all() and (pixels <= SIZE - edge + 0.5).all()
        reached.append(np.minimum(pixels - edge, SIZE - edge - pixels).min())
    # An orbit is seen at some turns only, and chosen for all of them.
    assert min(reached) < (40.0 if view == "orbit" else 1.0), "it could stand nearer"


def test_an_orbit_goes_once_around_the_vertical():
    path = path_of(Style(view="orbit"))
    cameras = [path(frame) for frame in FRAMES]
    offsets = np.array([camera.eye - camera.target for camera in cameras])
    assert np.ptp(offsets[:, 0]) < 1e-9, "its height stays"
    turns = np.unwrap(np.arctan2(offsets[:, 2], offsets[:, 1]))
    assert np.allclose(np.diff(turns), turns[1] - turns[0])
    assert abs(turns[1] - turns[0]) == pytest.approx(2 * np.pi / len(FRAMES))


def test_a_followed_body_stays_at_its_place():
    path = path_of(Style(view="follow:ball"))
    seen = [project(path(frame), SURFACES[1].vertices(frame), SIZE)[0] for frame in FRAMES]
    assert np.allclose(seen, seen[0], atol=1e-6)
    height = np.ptp(seen[0][:, 1]) / SIZE[1]
    assert 0.4 < height < 1 - 2 * MARGIN, "near, and whole"


def test_an_explicit_camera_looks_at_its_target():
    eye, target = (100.0, 30.0, 50.0), (1.0, 2.0, 3.0)
    camera = path_of(Style(size=SIZE, eye=eye, target=target))(0)
    pixels, depth = project(camera, np.array([target, [2.0, 2.0, 3.0]]), SIZE)
    assert pixels[0] == pytest.approx([160.0, 90.0])
    assert depth[0] == pytest.approx(np.linalg.norm(np.subtract(eye, target)))
    assert pixels[1, 1] < 90.0, "x is up"
    from_above = path_of(Style(size=SIZE, eye=(100.0, 0.0, 0.0), target=(0.0, 0.0, 0.0)))(0)
    assert np.isfinite(from_above.axes).all()


def test_only_triangles_that_face_the_camera_are_seen_from_the_front():
    camera = path_of(Style(eye=(100.0, 0.0, 0.0), target=(0.0, 0.0, 0.0)))(0)
    assert seen_from_front(camera, CUBE[FACES]).tolist() == [False, False, True, True]


def test_flat_and_tiny_things_have_outermost_points_too():
    flat = RecordedSurface(
        "flat", "soft", FACES, lambda frame: np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]])
    )
    assert len(outermost_points([flat], [0])) == 4
    grid = np.stack(np.meshgrid(*[np.arange(5.0)] * 2), axis=-1).reshape(-1, 2)
    sheet = RecordedSurface("sheet", "soft", FACES, lambda frame: np.column_stack([grid, np.zeros(25)]))
    kept = outermost_points([sheet], [0])
    assert {(0.0, 0.0), (4.0, 0.0), (0.0, 4.0), (4.0, 4.0)} <= {(x, y) for x, y, _ in kept}


def test_a_frame_without_finite_positions_is_named():
    broken = moving("ball", "soft", lambda frame: [np.nan if frame == 3 else 0.0, 0.0, 0.0])
    with pytest.raises(StyleError, match="frame 3 cannot be drawn: positions of 'ball' are not finite"):
        outermost_points([SURFACES[0], broken], range(5))


def test_frames_are_spread_with_first_and_last():
    assert sample_frames(range(10, 20), 3) == [10, 14, 19]
    assert sample_frames([4], 3) == [4]
