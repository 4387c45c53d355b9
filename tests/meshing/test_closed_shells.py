"""Surfaces of files: mended or refused, told apart as outside and cavities, and searched for crossings."""

import re
import warnings
from pathlib import Path

import numpy as np
import pytest
import trimesh
from conftest import examples
from hypothesis import given
from hypothesis import strategies as st
from solid_shapes import Surface, arrays, ball, box, moved, save, surface_of, together, turned_round

from taichisoft.errors import MeshError
from taichisoft_meshing.closed_shells import (
    Crossings,
    HollowBody,
    Shell,
    closed_shells,
    find_crossings,
    hollow_body,
    read_hollow_body,
)


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


@pytest.mark.parametrize("inward", [False, True])
def test_most_of_a_surface_decides_where_it_faces(inward: bool) -> None:
    """Also where the triangle from which its neighbours are turned is itself a wrong one: parts are told so."""
    surface = ball(5.0, parts=1)
    vertices, triangles = arrays(turned_round(surface) if inward else surface)
    for seed in range(5):
        wrong = np.random.default_rng(seed).random(len(triangles)) < 0.4
        mixed = np.where(wrong[:, None], triangles[:, ::-1], triangles)
        assert mended(surface_of(vertices, mixed), "are turned round$").was_inward == inward


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


# Which shell is the outside and which are cavities, and what does not make a body.

BODY = box((30, 20, 20))


def shells(surface: Surface, source: str = "body.stl") -> list[Shell]:
    return closed_shells(*arrays(surface), source)


def quiet(outer: Surface, *cavities: Surface) -> HollowBody:
    """A body of which nothing is to be said."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return hollow_body(
            shells(outer),
            [shell for number, cavity in enumerate(cavities) for shell in shells(cavity, f"cavity{number}.stl")],
        )


def test_a_cavity_from_a_file_of_its_own_may_face_either_way() -> None:
    for cavity in (box((4, 4, 4)), turned_round(box((4, 4, 4)))):
        body = quiet(BODY, cavity)
        assert body.volume == pytest.approx(12000 - 64)
        assert [wall.volume for wall in body.cavities] == pytest.approx([64])


def test_a_file_may_hold_the_outside_and_cavities_in_any_order() -> None:
    body = quiet(together(turned_round(box((4, 4, 4))), BODY, turned_round(ball(3, (9, 0, 0)))))
    assert body.outer.volume == pytest.approx(12000)
    assert [wall.volume for wall in body.cavities] == pytest.approx([64, ball(3).volume])


def test_a_body_may_have_no_cavity() -> None:
    assert quiet(BODY).cavities == ()


def test_cavities_stand_in_the_order_of_their_files() -> None:
    body = quiet(BODY, box((2, 2, 2), (-5, 0, 0)), box((3, 3, 3), (5, 0, 0)), box((1, 1, 1), (10, 0, 0)))
    assert [wall.volume for wall in body.cavities] == pytest.approx([8, 27, 1])


def test_a_cavity_that_the_outer_file_has_too_counts_once() -> None:
    """The tutorial's files repeat a cavity so, with its vertices in another order, or in single precision."""
    cavity = ball(3)
    again = together(cavity)
    again.vertices = again.vertices.astype(np.float32)
    again.vertices, again.faces = again.vertices[::-1], len(again.vertices) - 1 - again.faces
    body = quiet(together(BODY, turned_round(cavity)), again, box((2, 2, 2), (9, 0, 0)))
    assert [wall.volume for wall in body.cavities] == pytest.approx([cavity.volume, 8])


def test_what_is_inside_out_is_turned_and_said() -> None:
    with pytest.warns(UserWarning, match="^body.stl: is inside out; its triangles are turned round$"):
        body = hollow_body(shells(turned_round(BODY)))
    assert body.volume == pytest.approx(12000)
    with pytest.warns(UserWarning, match="^body.stl, shell 1 of 2: is inside out"):
        body = hollow_body(shells(turned_round(together(BODY, turned_round(box((4, 4, 4)))))))
    assert body.volume == pytest.approx(12000 - 64)


def test_a_solid_in_a_solid_is_taken_for_a_cavity_and_said() -> None:
    with pytest.warns(UserWarning, match="^body.stl, shell 2 of 2: faces the same way as the outer surface; taken for"):
        assert hollow_body(shells(together(BODY, box((4, 4, 4))))).volume == pytest.approx(12000 - 64)


@pytest.mark.parametrize(
    ("outer", "cavities", "problem"),
    [
        (
            together(BODY, box((5, 5, 5), (40, 0, 0))),
            [],
            r"^body.stl: has 2 bodies, of 1.2e\+04, 125 mm\^3, where one is expected",
        ),
        (
            together(BODY, box((5, 5, 5), (16, 0, 0))),
            [],
            r"^body.stl, shell 2 of 2: crosses or touches the outer surface, body.stl, shell 1 of 2: \d+ pairs of "
            r"triangles, the first \(\d+ and \d+\) at \[.*\] mm; silicone must remain between them; both face the same "
            "way: if they are parts of one body, unite = true joins them$",
        ),
        (
            BODY,
            [box((4, 4, 4), (14, 0, 0))],
            r"^cavity0.stl: crosses or touches the outer surface, body.stl: .* at \[15.0, -?2.0, ",
        ),
        (BODY, [box((4, 4, 20))], "^cavity0.stl: crosses or touches the outer surface, body.stl"),
        (
            BODY,
            [box((4, 4, 4), (50, 0, 0))],
            r"^cavity0.stl: the cavity is not inside body.stl: it spans \[48.0, -2.0, -2.0\] to \[52.0, 2.0, 2.0\] mm, "
            r"the body \[-15.0, -10.0, -10.0\] to",
        ),
        (box((4, 4, 4)), [BODY], "^cavity0.stl: the cavity is not inside body.stl"),
        (BODY, [BODY], "^cavity0.stl: crosses or touches the outer surface, body.stl"),
        (BODY, [box((4, 4, 4)), box((4, 4, 4), parts=1)], r"both span \[-2.0, .* to .* mm: if they are the same"),
        (BODY, [box((4, 4, 4)), ball(3, (3, 0, 0))], "^cavity1.stl: crosses or touches another cavity, cavity0.stl"),
        (BODY, [box((8, 8, 8)), box((2, 2, 2))], r"^cavity1.stl: lies inside a cavity \(it spans \[-1.0, -1.0, -1.0\]"),
        (
            together(BODY, turned_round(box((8, 8, 8))), box((2, 2, 2))),
            [],
            "^body.stl, shell 3 of 3: lies inside a cavity",
        ),
    ],
)
def test_what_is_no_body_is_told(outer: Surface, cavities: list[Surface], problem: str) -> None:
    with pytest.raises(MeshError, match=problem):
        quiet(outer, *cavities)


def test_a_surface_that_cuts_through_itself_is_told() -> None:
    vertices, triangles = arrays(box((10, 10, 10), parts=1))
    vertices[np.argmax(vertices @ [1, 1, 1])] = [-8, 0, 0]
    with pytest.raises(MeshError, match=r"^body.stl: cuts through itself: \d+ pairs of triangles, the first \(\d+ and"):
        hollow_body(closed_shells(vertices, triangles, "body.stl"))


@pytest.mark.parametrize("suffix", ["stl", "obj", "ply"])
def test_files_are_read_with_their_unit(tmp_path: Path, suffix: str) -> None:
    """STL in metres: 0.03 m are 30 mm."""
    outer = save(together(BODY).apply_scale(1e-3), tmp_path / f"body.{suffix}")
    cavity = save(box((4e-3, 4e-3, 4e-3)), tmp_path / f"cavity.{suffix}")
    assert read_hollow_body(outer, [cavity], scale=1000.0).volume == pytest.approx(12000 - 64, rel=1e-6)


@pytest.mark.parametrize(
    ("name", "content", "problem"),
    [
        ("body.stl", None, "no such file"),
        ("body.stl", b"", "is empty"),
        ("body.stl", b"solid nothing\nendsolid nothing\n", "not readable as STL|has no faces"),
        ("body.stl", b"hello\n" * 50, "not readable as STL|has no faces"),
        ("body.obj", b"v 0 0 0\nv 1 0 0\n", "not readable as OBJ|has no faces"),
        ("body.ply", b"ply\nformat", "not readable as PLY"),
        ("body.step", b"ISO-10303-21;", r"'.step' is not a kind of surface file; valid: .stl, .obj, .ply"),
        ("body.obj", b"v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n", "vertex 1 has a coordinate that is not finite"),
    ],
)
def test_files_that_are_no_surfaces_are_told(tmp_path: Path, name: str, content: bytes | None, problem: str) -> None:
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(MeshError, match=rf"{name}: .*({problem})"):
        read_hollow_body(path)


# Surfaces that cross or touch are found; those that do not are left alone.


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
def test_boxes_cross_unless_apart_or_nested(one: tuple, other: tuple, turn: int) -> None:
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
