"""Surfaces in files: equal vertices are merged, polygons triangulated, broken files refused in one line."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from taichisoft.errors import MeshError
from taichisoft.mesh import enclosed_volume, read_surface, write_stl

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
def test_a_box_has_eight_vertices_twelve_triangles_and_its_volume(tmp_path: Path, suffix: str) -> None:
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
