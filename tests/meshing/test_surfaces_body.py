"""Which shell is the outside and which are cavities, and what does not make a body."""

import warnings
from pathlib import Path

import numpy as np
import pytest
from solid_shapes import Surface, arrays, ball, box, save, together, turned_round

from taichisoft.errors import MeshError
from taichisoft_meshing.closed_shells import HollowBody, Shell, closed_shells, hollow_body, read_hollow_body

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
            r"triangles, the first \(\d+ and \d+\) at \[.*\] mm; silicone must remain between them$",
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
