"""Surfaces that cross or touch are found; those that do not are left alone."""

import numpy as np
import pytest
import trimesh
from conftest import examples
from hypothesis import given
from hypothesis import strategies as st
from solid_shapes import Surface, arrays, ball, box, moved, surface_of

from taichisoft_meshing.closed_shells import Crossings, find_crossings


def crossings(*surfaces: Surface) -> Crossings:
    starts = np.cumsum([0, *(len(surface.vertices) for surface in surfaces)])
    return find_crossings(
        np.vstack([surface.vertices for surface in surfaces]),
        np.vstack([surface.faces + start for surface, start in zip(surfaces, starts, strict=False)]),
        np.repeat(np.arange(len(surfaces)), [len(surface.faces) for surface in surfaces]),
    )


interval = st.tuples(st.integers(-4, 4), st.integers(1, 6)).map(lambda pair: (pair[0], pair[0] + pair[1]))


@examples(60)
@given(st.tuples(interval, interval, interval), st.tuples(interval, interval, interval), st.integers(0, 1000))
def test_boxes_cross_unless_they_are_apart_or_one_is_inside_the_other(one: tuple, other: tuple, turn: int) -> None:
    """Whatever their corners: faces, edges and corners of both lie on a grid, so that they often just touch."""
    a, b = np.array(one, dtype=float), np.array(other, dtype=float)
    apart = ((a[:, 1] < b[:, 0]) | (b[:, 1] < a[:, 0])).any()
    nested = ((a[:, 0] < b[:, 0]) & (b[:, 1] < a[:, 1])).all() or ((b[:, 0] < a[:, 0]) & (a[:, 1] < b[:, 1])).all()
    boxes = [box(np.ptp(sides, axis=1), sides.mean(axis=1)) for sides in (a, b)]
    rotation = trimesh.transformations.random_rotation_matrix(np.random.default_rng(turn).uniform(size=3))
    for shape in boxes:
        shape.apply_transform(rotation)
    found = crossings(*boxes)
    assert (len(found.triangles) == 0) == (apart or nested)
    for shape in boxes:  # the places lie in both, up to the distance that counts as touching
        back = found.places @ rotation[:3, :3]
        assert (back >= shape.bounds.min() - 20).all()
        sides = a if shape is boxes[0] else b
        assert (back >= sides[:, 0] - 1e-4).all() and (back <= sides[:, 1] + 1e-4).all()


@pytest.mark.parametrize("gap", [1e-3, 1.0])
def test_a_thin_wall_is_a_wall(gap: float) -> None:
    assert len(crossings(box((10, 10, 10)), box((10 - 2 * gap,) * 3)).triangles) == 0


def test_walls_of_no_thickness_touch() -> None:
    """And a millionth of the diagonal is none."""
    assert len(crossings(box((10, 10, 10)), box((8, 8, 10))).triangles) > 0
    assert len(crossings(box((10, 10, 10)), box((8, 8, 10 - 2e-5))).triangles) > 0


@pytest.mark.parametrize("first", range(4))
def test_a_tip_that_touches_a_face_is_found(first: int) -> None:
    """The tip's vertex may have any number."""
    corners = np.array([[0, 0, 5], [1, 0, 8], [0, 1, 8], [-1, -1, 8.0]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    order = np.roll(np.arange(4), first)
    tip = surface_of(corners[order], np.argsort(order)[faces])
    found = crossings(box((10, 10, 10), parts=1), moved(tip, (0.5, 0.7, 1e-5)))
    assert found.places == pytest.approx(np.tile([0.5, 0.7, 5.0], (len(found.places), 1)), abs=1e-4)
    assert len(found.places) > 0


def test_a_surface_without_a_fault_does_not_cross_itself() -> None:
    for surface in (ball(5.0, parts=3), trimesh.creation.torus(6, 2), trimesh.creation.cylinder(5, 1, sections=60)):
        assert len(crossings(surface).triangles) == 0


def test_a_spindle_crosses_itself() -> None:
    """A ring thicker than its hole goes through itself near its axis."""
    found = crossings(trimesh.creation.torus(3, 3.5, major_sections=24, minor_sections=24))
    assert len(found.triangles) > 0
    assert (np.linalg.norm(found.places[:, :2], axis=1) < 0.6).all()
    assert (found.triangles[:, 0] < found.triangles[:, 1]).all()
    assert len(np.unique(found.triangles, axis=0)) == len(found.triangles)


def test_a_corner_pushed_through_the_opposite_face_is_found() -> None:
    vertices, triangles = arrays(box((10, 10, 10), parts=1))
    pushed = int(np.argmax(vertices @ [1, 1, 1]))
    vertices[pushed] = [-8, 0, 0]
    found = crossings(surface_of(vertices, triangles))
    at_the_corner = np.flatnonzero((triangles == pushed).any(axis=1))
    assert np.isin(found.triangles, at_the_corner).any(axis=1).all()
    assert np.abs(found.places[:, 0] + 5).min() < 1e-9


def test_a_fold_is_found() -> None:
    """A flap of no thickness: its two sides are neighbours that lie upon each other."""
    corners = np.array([[0, 0, 0], [4, 0, 0], [0, 4, 0], [1, 1, 3], [4, 4, 0.0]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 4, 3], [4, 2, 3], [1, 2, 4]])
    assert len(crossings(surface_of(corners, faces)).triangles) == 0
    folded = corners.copy()
    folded[4] = [1, 1, 0]  # back across the edge from 1 to 2
    assert [1, 2] not in crossings(surface_of(folded, faces)).triangles.tolist()
    assert [0, 5] in crossings(surface_of(folded, faces)).triangles.tolist()


def test_the_first_of_many_far_pairs_is_found() -> None:
    """Boxes are searched in halves: a crossing far from all else must not be lost on the way."""
    row = [moved(ball(1.0, parts=1), (3.0 * n, 0, 0)) for n in range(30)]
    found = crossings(*row, ball(0.5, (3 * 17 + 1.0, 0, 0), parts=1))
    assert set(found.triangles[:, 0] // 80) == {17}
    assert set(found.triangles[:, 1] // 80) == {30}
