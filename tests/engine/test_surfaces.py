"""Surfaces: files, closed ones and their volume, edges that cross triangles, and sections by a plane."""

import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from blocks import make_block
from conftest import examples
from hypothesis import assume, given
from hypothesis import strategies as st

from taichisoft.errors import MeshError
from taichisoft.mesh import (
    SectionPlane,
    boundary_triangles,
    closed_cap,
    common_points,
    count_open_edges,
    cut_tetrahedra,
    enclosed_volume,
    pairs_of_meeting_boxes,
    read_surface,
    read_volume_mesh,
    split_triangles,
    write_stl,
)
from taichisoft.mesh.surface import LEAVES_AT_A_TIME, closed_outward

# Surfaces in files: equal vertices are merged, polygons triangulated, broken files refused in one line.

TUTORIAL = Path(__file__).resolve().parents[2].parent / "shared" / "tutorial-meshes"

CORNERS = [(x, y, z) for x in (0, 2) for y in (0, 3) for z in (0, 4)]
SIDES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


def obj(path: Path, corners: list, faces: list) -> Path:
    lines = [f"v {x} {y} {z}" for x, y, z in corners]
    lines += ["f " + " ".join(str(corner + 1) for corner in face) for face in faces]
    path.write_text("\n".join(lines) + "\n")
    return path


def ply(path: Path) -> Path:
    header = (
        f"ply\nformat ascii 1.0\nelement vertex {len(CORNERS)}\nproperty double x\nproperty double y\n"
        f"property double z\nelement face {len(SIDES)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    body = [" ".join(map(str, corner)) for corner in CORNERS] + [f"4 {a} {b} {c} {d}" for a, b, c, d in SIDES]
    path.write_text(header + "\n".join(body) + "\n")
    return path


def stl(path: Path) -> Path:
    lines = ["solid box"]
    for a, b, c, d in SIDES:
        for triangle in ((a, b, c), (a, c, d)):
            corners = "".join(f"vertex {' '.join(map(str, CORNERS[corner]))}\n" for corner in triangle)
            lines.append(f"facet normal 0 0 0\nouter loop\n{corners}endloop\nendfacet")
    path.write_text("\n".join([*lines, "endsolid box\n"]))
    return path


def refusal(path: Path) -> str:
    with pytest.raises(MeshError) as refused:
        read_surface(path)
    assert str(refused.value).startswith(f"{path}: ")
    assert "\n" not in str(refused.value)
    return str(refused.value)


@pytest.mark.parametrize("suffix", [".stl", ".ply", ".obj"])
def test_box_has_vertices_triangles_and_volume(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"box{suffix}"
    {".stl": stl, ".ply": ply, ".obj": lambda path: obj(path, CORNERS, SIDES)}[suffix](path)
    vertices, triangles = read_surface(path)
    assert (vertices.shape, triangles.shape) == ((8, 3), (12, 3))
    assert enclosed_volume(vertices, triangles) == pytest.approx(24, rel=1e-14)


def test_vertices_of_no_face_and_faces_without_area_are_dropped(tmp_path: Path) -> None:
    corners = [(9, 9, 9), *CORNERS, CORNERS[0]]  # the last one stands where the second does
    faces = [*([corner + 1 for corner in side] for side in SIDES), (1, 9, 2)]
    vertices, triangles = read_surface(obj(tmp_path / "box.obj", corners, faces))
    assert (vertices.shape, triangles.shape) == ((8, 3), (12, 3))
    assert vertices.max() == 4


@pytest.mark.parametrize(
    ("name", "vertex_count", "triangle_count", "volume"),
    [
        ("pneunetCavityCut.stl", 458, 912, 8887.5),
        ("pneunetCut.stl", 1488, 2968, 51162.5),
        ("smCube27.obj", 26, 48, 343),
        ("floorFlat.obj", 4, 2, 0),
    ],
)
def test_the_tutorials_surfaces(name: str, vertex_count: int, triangle_count: int, volume: float) -> None:
    if not (TUTORIAL / name).is_file():
        pytest.skip(f"the tutorial's meshes are not at {TUTORIAL}")
    vertices, triangles = read_surface(TUTORIAL / name)
    assert (len(vertices), len(triangles)) == (vertex_count, triangle_count)
    # The file's single precision or six digits.
    assert abs(enclosed_volume(vertices, triangles)) == pytest.approx(volume, rel=1e-5, abs=1e-9)


def test_a_surface_that_cannot_be_used_is_refused(tmp_path: Path) -> None:
    assert "no such file; a surface (.stl, .obj, .ply) is needed" in refusal(tmp_path / "absent.stl")
    assert "'.step' is not a kind of surface file; valid: .stl, .obj, .ply" in refusal(tmp_path / "box.step")
    not_finite = [*CORNERS[:7], ("nan", 3, 4)]
    assert "vertex 7 has a coordinate that is not finite" in refusal(obj(tmp_path / "nan.obj", not_finite, SIDES))
    huge = [*CORNERS[:7], (1e155, 3, 4)]
    assert "vertex 7 has a coordinate of 1e+155 mm" in refusal(obj(tmp_path / "huge.obj", huge, SIDES))
    assert "has no faces" in refusal(obj(tmp_path / "points.obj", CORNERS, []))
    assert "every face has two equal corners" in refusal(obj(tmp_path / "line.obj", CORNERS, [(0, 1, 1)]))
    assert "not readable as OBJ" in refusal(obj(tmp_path / "outside.obj", CORNERS, [(0, 1, 99)]))


@pytest.mark.parametrize("suffix", [".stl", ".obj", ".ply"])
@pytest.mark.parametrize("content", [b"", b"hello\n", b"\x00\xff\xfe" * 50])
def test_a_broken_file_is_refused(tmp_path: Path, suffix: str, content: bytes) -> None:
    path = tmp_path / f"broken{suffix}"
    path.write_bytes(content)
    assert any(why in refusal(path) for why in ("no faces", "not readable as", "is empty"))


@pytest.mark.parametrize("make", [stl, ply])
def test_a_file_that_stops_early_is_refused(tmp_path: Path, make: Callable[[Path], Path]) -> None:
    """OBJ has neither an end nor a count, so that nobody can tell."""
    path = make(tmp_path / f"box.{make.__name__}")
    lines = path.read_text().splitlines(keepends=True)
    for count in range(1, len(lines)):
        path.write_text("".join(lines[:count]))
        refusal(path)


def test_what_is_written_as_stl_is_read_again_bit_for_bit(tmp_path: Path) -> None:
    """Thirds and roots have no short decimal form: a format that rounds shows."""
    vertices = np.array(CORNERS) / 3 + np.sqrt(2)
    triangles = np.array([(a, b, c) for a, b, c, _ in SIDES] + [(a, c, d) for a, _, c, d in SIDES])
    write_stl(vertices, triangles, tmp_path / "box.stl")
    read, corners = read_surface(tmp_path / "box.stl")
    np.testing.assert_array_equal(read[corners], vertices[triangles])
    assert [file.name for file in tmp_path.iterdir()] == ["box.stl"]
    with pytest.raises(MeshError, match=r"box\.stl: cannot be written: No such file or directory"):
        write_stl(vertices, triangles, tmp_path / "absent" / "box.stl")


# Is a surface closed, and which way does it face.

MESH = make_block((2, 2, 2), (4.0, 3.0, 2.0))
SKIN = boundary_triangles(MESH.elements)


def test_a_closed_surface_stays_as_it_is() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert closed_outward(MESH.nodes, SKIN, "skin.stl") is SKIN
    assert enclosed_volume(MESH.nodes, SKIN) == pytest.approx(24.0, rel=1e-14)


def test_one_that_is_inside_out_is_turned_round_with_a_warning() -> None:
    with pytest.warns(UserWarning, match=r"skin\.stl: is inside out; its triangles are turned round"):
        turned = closed_outward(MESH.nodes, SKIN[:, ::-1], "skin.stl")
    assert enclosed_volume(MESH.nodes, turned) == pytest.approx(24.0, rel=1e-14)


def with_one_turned(triangles: np.ndarray) -> np.ndarray:
    turned = triangles.copy()
    turned[0] = turned[0, ::-1]
    return turned


@pytest.mark.parametrize(
    ("triangles", "open_edges"),
    [
        (SKIN, 0),
        (SKIN[1:], 3),  # a hole
        (SKIN[:1], 3),
        (with_one_turned(SKIN), 6),  # one triangle faces the other way: its edges run twice in one direction
        (np.vstack([SKIN, SKIN[:1]]), 3),  # one stands twice
    ],
)
def test_every_edge_joins_two_triangles_of_one_orientation(triangles: np.ndarray, open_edges: int) -> None:
    assert bool(count_open_edges(triangles)) == bool(open_edges)
    if open_edges:
        with pytest.raises(MeshError, match=r"^skin\.stl: is not closed: \d+ edges do not join exactly two"):
            closed_outward(MESH.nodes, triangles, "skin.stl")


def test_a_surface_without_volume_is_refused() -> None:
    """Two triangles back to back are closed, and enclose nothing."""
    with pytest.raises(MeshError, match="encloses no volume"):
        closed_outward(np.eye(3), np.array([[0, 1, 2], [0, 2, 1]]), "flat.stl")


def test_the_volume_does_not_depend_on_the_origin() -> None:
    """A kilometre away the coordinates keep ten digits behind the point; about the middle no more are lost, while
    about the origin the terms would be of 1e18 mm^3."""
    far = MESH.nodes + 1e6
    assert enclosed_volume(far, SKIN) == pytest.approx(24.0, rel=1e-8)


# Edges that go through triangles: every pair that may is compared, and the common point lies in both.


@given(st.tuples(*[st.floats(-0.4, 1.2)] * 2), st.floats(-0.5, 1.5), st.integers(0, 1000))
def test_an_edge_crosses_a_triangle_where_it_goes_through_it(weights: tuple, along: float, seed: int) -> None:
    """The point is given by its barycentric weights in the triangle's plane and by its share of the edge's length."""
    second, third = weights
    nearest = min(second, third, 1 - second - third, along, 1 - along)
    assume(abs(nearest) > 1e-3)
    generator = np.random.default_rng(seed)
    corners = generator.uniform(-1, 1, (3, 3))
    point = corners[0] + second * (corners[1] - corners[0]) + third * (corners[2] - corners[0])
    direction = generator.uniform(-1, 1, 3)
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    assume(abs(direction @ normal) > 0.02)
    ends = np.array([point - along * direction, point + (1 - along) * direction])
    place = common_points(ends[None], corners[None], 1e-9)
    if nearest > 0:
        assert place[0] == pytest.approx(point, abs=1e-9)
    else:
        assert np.isnan(place).all()


@pytest.mark.parametrize("near", [0.0, 1e-6])
def test_an_end_that_touches_a_triangle_lies_in_it(near: float) -> None:
    corners = np.array([[0.0, 0, 0], [4, 0, 0], [0, 4, 0]])
    ends = np.array([[1.0, 1, near], [2, 2, 5]])
    assert common_points(ends[None], corners[None], near)[0] == pytest.approx([1, 1, near])
    assert np.isnan(common_points(ends[None] + [0, 0, 1e-3], corners[None], near)).all()


def test_a_triangle_of_no_area_has_no_point() -> None:
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]])
    assert np.isnan(common_points(np.array([[[1.0, -1, 0], [1, 1, 0]]]), corners[None])).all()


@examples(30)
@given(st.integers(0, 10**6), st.integers(1, 400), st.integers(1, 60), st.sampled_from([0.0, 0.3]))
def test_pairs_whose_boxes_meet_are_those_of_a_plain_search(
    seed: int, edge_count: int, count: int, near: float
) -> None:
    """Edges of all lengths, none included; the search halves them, and a plain one compares all pairs."""
    generator = np.random.default_rng(seed)
    edges = generator.uniform(-5, 5, (edge_count, 1, 3)) + generator.exponential(
        generator.choice([0, 0.1, 3], (edge_count, 1, 1)), (edge_count, 2, 3)
    )
    triangles = generator.uniform(-5, 5, (count, 1, 3)) + generator.uniform(-1, 1, (count, 3, 3))
    found = [np.column_stack(pair) for pair in pairs_of_meeting_boxes(edges, triangles, near)]
    lower, upper = edges.min(axis=1)[:, None] - near, edges.max(axis=1)[:, None] + near
    meet = ((lower <= triangles.max(axis=1)) & (triangles.min(axis=1) <= upper)).all(axis=2)
    pairs = np.vstack([np.empty((0, 2), dtype=int), *found])
    assert np.array_equal(pairs[np.lexsort(pairs.T[::-1])], np.argwhere(meet))


def test_many_edges_come_in_several_parts() -> None:
    """So that memory stays bounded."""
    starts = np.arange(64.0 * LEAVES_AT_A_TIME)[:, None, None] * [1, 0, 0]
    edges = starts + np.array([[0.1, 0.1, -1], [0.1, 0.1, 1]])
    triangles = starts + np.array([[0.0, 0, 0], [0.5, 0, 0], [0, 0.5, 0]])
    parts = list(pairs_of_meeting_boxes(edges, triangles))
    assert len(parts) > 1
    edge, triangle = np.concatenate([edge for edge, _ in parts]), np.concatenate([found for _, found in parts])
    assert np.array_equal(np.sort(edge), np.arange(len(edges))) and np.array_equal(edge, triangle)


# Sections by a plane: what is cut closes again, and keeps volume, area and whatever is linear.

FINGER = read_volume_mesh(Path(__file__).parents[2] / "data/meshes/tutorial-coarse.msh")


def areas(triangles):
    """Area vectors of triangles, shape (count, 3)."""
    a, b, c = np.moveaxis(triangles[..., :3], 1, 0)
    return 0.5 * np.cross(b - a, c - a)


@given(
    normal=st.tuples(*3 * [st.floats(-1.0, 1.0)]).filter(lambda n: np.linalg.norm(n) > 0.1), share=st.floats(0.02, 0.98)
)
def test_a_cut_body_is_closed_and_the_two_caps_are_equal(normal, share):
    """The sum of a closed surface's area vectors is zero; the cap of elements has the area of the outline's inside.

    Round-off alone: 1e-9 of the surface. The mesh has cavities, so that outlines lie within others.
    """
    unit = np.array(normal) / np.linalg.norm(normal)
    heights = FINGER.nodes @ unit
    offset = heights.min() + share * np.ptp(heights)
    plane = SectionPlane(tuple(unit), float(offset), False)
    skin = FINGER.nodes[boundary_triangles(FINGER.elements)]
    below, above, sides = split_triangles(skin, plane.height(skin))
    cap, _ = cut_tetrahedra(FINGER.nodes[FINGER.elements], plane.height(FINGER.nodes[FINGER.elements]), plane.normal)
    whole = np.linalg.norm(areas(skin), axis=1).sum()
    assert np.linalg.norm(areas(below), axis=1).sum() + np.linalg.norm(areas(above), axis=1).sum() == pytest.approx(
        whole
    )
    assert areas(below).sum(axis=0) + areas(cap).sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-9 * whole)
    assert areas(cap) @ unit == pytest.approx(np.linalg.norm(areas(cap), axis=1), abs=1e-9)
    filled = closed_cap(sides, plane.normal)
    # The outline is filled between levels that are rounded to 1e-7 mm.
    assert areas(filled).sum(axis=0) @ unit == pytest.approx(areas(cap).sum(axis=0) @ unit, abs=1e-5 * whole)


def test_section_keeps_linear_fields_linear():
    plane = SectionPlane.parse("x+2*y=-20")
    values = 3.0 * FINGER.nodes[:, 0] - FINGER.nodes[:, 2] + 5.0
    corners = np.column_stack([FINGER.nodes, values])[FINGER.elements]
    cap, element = cut_tetrahedra(corners, plane.height(corners[..., :3]), plane.normal)
    assert np.abs(plane.height(cap[..., :3])).max() < 1e-9
    assert cap[..., 3] == pytest.approx(3.0 * cap[..., 0] - cap[..., 2] + 5.0)
    assert len(cap) == len(element) > 100
    lowest, highest = (getattr(FINGER.nodes[FINGER.elements[element]], end)(axis=1) for end in ("min", "max"))
    assert (cap[..., :3].min(axis=1) >= lowest - 1e-9).all() and (cap[..., :3].max(axis=1) <= highest + 1e-9).all()


def test_a_plane_is_written_as_an_equation_and_says_what_is_kept():
    eye = np.array([0.0, 50.0, 0.0])
    assert SectionPlane.parse("y = 2").facing(eye).normal == (0.0, 1.0, 0.0), "the near part is left out"
    assert SectionPlane.parse("y=2").facing(-eye) == SectionPlane((-0.0, -1.0, -0.0), -2.0, True)
    assert SectionPlane.parse("y<2").facing(-eye).height(eye) == 48.0, "y < 2 is kept, whoever looks"
    assert SectionPlane.parse("y>2").height(eye) == -48.0
    assert SectionPlane.parse("3*x+4z=10").offset == 2.0


@pytest.mark.parametrize("text", ["", "y", "y==0", "q=1", "y=", "=0", "0*x=1", "y=nan", "y=1e99", "x=0,y=0", "y=1.2.3"])
def test_anything_else_is_refused_in_one_line(text):
    with pytest.raises(MeshError, match="must be a plane in mm, as y=0"):
        SectionPlane.parse(text)
