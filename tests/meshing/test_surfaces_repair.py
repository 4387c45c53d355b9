"""Nearly equal vertices are merged and triangles turned, with a warning; other faults are refused with their place."""

import re
import warnings

import numpy as np
import pytest
from solid_shapes import Surface, arrays, ball, box, moved, surface_of, together, turned_round

from taichisoft.errors import MeshError
from taichisoft_meshing.closed_shells import Shell, closed_shells


def shells_of(surface: Surface) -> list[Shell]:
    return closed_shells(*arrays(surface), "body.stl")


def mended(surface: Surface, said: str) -> Shell:
    """The one shell, after exactly one warning."""
    with pytest.warns(UserWarning) as warned:
        (shell,) = shells_of(surface)
    assert [re.search(said, str(warning.message)) is not None for warning in warned] == [True], list(map(str, warned))
    return shell


def test_what_is_whole_stays_as_it_is() -> None:
    vertices, triangles = arrays(ball(5.0))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        (shell,) = closed_shells(vertices, triangles, "body.stl")
    assert np.array_equal(shell.vertices, vertices)
    assert np.array_equal(shell.triangles, triangles)
    assert not shell.was_inward


def test_shells_come_in_the_order_of_the_file() -> None:
    small, large = ball(1.0, (9, 0, 0)), box((4, 4, 4))
    shells = shells_of(together(small, turned_round(large)))
    assert [shell.source for shell in shells] == ["body.stl, shell 1 of 2", "body.stl, shell 2 of 2"]
    assert [shell.volume for shell in shells] == pytest.approx([small.volume, 64.0])
    assert [shell.was_inward for shell in shells] == [False, True]


def test_nearly_equal_vertices_become_one() -> None:
    """Each triangle has vertices of its own, which rounding has moved apart."""
    whole = box((10, 10, 10), parts=1)
    soup = whole.triangles.reshape(-1, 3)
    soup = soup + np.random.default_rng(1).uniform(-1e-6, 1e-6, soup.shape)
    shell = mended(surface_of(soup, np.arange(len(soup)).reshape(-1, 3)), "118 vertices lie within 1.7e-05 mm")
    assert len(shell.vertices) == len(whole.vertices)
    assert shell.volume == pytest.approx(1000.0, rel=1e-6)


def test_triangles_that_face_the_other_way_are_turned_round() -> None:
    surface = ball(5.0)
    vertices, triangles = arrays(surface)
    some = [3, 50, 51, 200]
    triangles[some] = triangles[some][:, ::-1]
    shell = mended(
        surface_of(vertices, triangles),
        "^body.stl: triangles that face the other way than their neighbours are turned round$",
    )
    assert shell.volume == pytest.approx(surface.volume)
    assert not shell.was_inward


def with_a_flat_triangle() -> Surface:
    """A vertex on an edge of a cube, joined on one side only: on the other a flat triangle fills the gap."""
    vertices, triangles = arrays(box((10, 10, 10)))
    begin, end, apex = triangles[0].tolist()
    middle = len(vertices)
    vertices = np.vstack([vertices, vertices[[begin, end]].mean(axis=0)])
    halves = [[begin, middle, apex], [middle, end, apex], [begin, end, middle]]
    return surface_of(vertices, np.vstack([triangles[1:], halves]))


def two_cubes_with_a_common_edge() -> Surface:
    both = together(box((2, 2, 2)), box((2, 2, 2), (2, 2, 0)))
    both.merge_vertices()
    return both


def two_tetrahedra_with_a_common_tip() -> Surface:
    corners = np.vstack([np.zeros(3), np.eye(3)])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    one, other = surface_of(corners, faces), surface_of(-corners, faces[:, ::-1])
    both = together(one, other, moved(box((1, 1, 1)), (5, 5, 5)))
    both.merge_vertices()
    return both


def joined_at_a_point() -> Surface:
    """A ring that is closed by two tips which meet in one vertex: one shell, edge by edge."""
    ring = box((6, 6, 2), parts=2)
    vertices, triangles = arrays(ring)
    left = np.flatnonzero((np.abs(vertices - [0, 0, 1]) < 1e-9).all(axis=1))[0]
    right = np.flatnonzero((np.abs(vertices - [0, 0, -1]) < 1e-9).all(axis=1))[0]
    vertices[left] = 0.0
    triangles[triangles == right] = left
    return surface_of(vertices, triangles)


@pytest.mark.parametrize(
    ("surface", "problem"),
    [
        (
            surface_of(*(a if n == 0 else a[1:] for n, a in enumerate(arrays(box((10, 10, 10)))))),
            r"^body.stl: is not a closed surface: it has edges of one triangle only \(3\), the first from "
            r"\[-5.0, -5.0, -5.0\] to .* mm; fill",
        ),
        (
            two_cubes_with_a_common_edge(),
            r"it has edges of more than two triangles \(1\), the first from \[1.0, 1.0, -1.0\]",
        ),
        (with_a_flat_triangle(), r"^body.stl: triangle 13 at .* mm has no area \(1 such triangles\); remove them"),
        (joined_at_a_point(), r"^body.stl: touches itself in a single point at \[0.0, 0.0, 0.0\] mm"),
    ],
)
def test_what_has_no_one_repair_is_refused(surface: Surface, problem: str) -> None:
    with pytest.raises(MeshError, match=problem):
        shells_of(surface)


def test_two_shells_that_share_a_tip_are_two() -> None:
    """They are told to touch when the body is put together."""
    assert len(shells_of(two_tetrahedra_with_a_common_tip())) == 3


def test_a_surface_with_one_side_is_refused() -> None:
    """A Klein bottle: a grid whose ends are joined upside down in one direction."""
    n = 8
    at = np.arange(n * n).reshape(n, n)
    right = np.roll(at, -1, axis=1)
    below = np.vstack([at[1:], at[:1, ::-1]])
    below_right = np.roll(below, -1, axis=1)
    quads = np.stack([at, right, below_right, below], axis=-1).reshape(-1, 4)
    triangles = np.vstack([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    vertices = np.random.default_rng(1).uniform(size=(n * n, 3))
    with pytest.raises(MeshError, match=r"^body.stl: has one side only"):
        closed_shells(vertices, triangles, "body.stl")


def test_a_surface_around_nothing_is_refused() -> None:
    """A square, and the same square facing the other way, on other vertices inside."""
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.4, 0.5, 0], [0.6, 0.5, 0.0]])
    front = [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]
    back = [[1, 0, 5], [2, 1, 5], [3, 2, 5], [0, 3, 5]]
    with pytest.raises(MeshError, match=r"^body.stl: encloses no volume"):
        closed_shells(square, np.array(front + back), "body.stl")
