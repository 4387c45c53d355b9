"""Meshes of SOFA scenes: files of every format in the order of the file, placement, stand-ins for SOFA's own."""

import os
from pathlib import Path

import numpy as np
import pytest
from blocks import make_block

from taichisoft.errors import MeshError
from taichisoft.mesh import enclosed_volume
from taichisoft.mesh.surface import closed_outward
from taichisoft_sofa.components.meshes import (
    STOCK_MESHES,
    find_mesh,
    multiply_quaternions,
    placed,
    placed_by_loader,
    quaternion,
    read_mesh,
    rotation_matrix,
    split_quads,
)

NO_MOVE = ((1.0, 1.0, 1.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


@pytest.mark.parametrize("binary", [True, False])
@pytest.mark.parametrize("suffix", [".vtk", ".vtu", ".msh"])
def test_tetrahedra_keep_the_order_of_the_file(tmp_path: Path, suffix: str, binary: bool) -> None:
    import meshio

    block = make_block((2, 1, 1), (2.0, 1.0, 1.0))
    triangles = block.elements[:2, :3]
    path = tmp_path / f"block{suffix}"
    content = meshio.Mesh(block.nodes, [("triangle", triangles), ("tetra", block.elements)])
    if suffix == ".msh":
        meshio.gmsh.write(path, content, "2.2", binary=binary)
    else:
        content.write(path, binary=binary)
    mesh = read_mesh(path)
    assert (mesh.points == block.nodes).all()
    assert (mesh.tetrahedra == block.elements).all()
    assert (mesh.triangles == triangles).all()


DIGITS = 0.1234567890123456
LEGACY = """# vtk DataFile Version 2.0
POINTS 1 float
ASCII
DATASET UNSTRUCTURED_GRID
POINTS 4 {precision}
{points}
CELLS 1 5
4 0 1 2 3
CELL_TYPES 1
10
"""
XML = """<?xml version="1.0"?>
<VTKFile type="{type}" version="0.1" byte_order="BigEndian">
<UnstructuredGrid><Piece NumberOfPoints="4" NumberOfCells="1">
<Points><DataArray type="Float32" NumberOfComponents="3" format="ascii">{points}</DataArray></Points>
<Cells>
<DataArray type="Int32" Name="connectivity" format="ascii">0 1 2 3</DataArray>
<DataArray type="Int32" Name="offsets" format="ascii">4</DataArray>
<DataArray type="UInt8" Name="types" format="ascii">10</DataArray>
</Cells></Piece></UnstructuredGrid></VTKFile>
"""
POINTS = f"{DIGITS} 0 0  1 0 0  0 1 0  0 0 1"


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("float.vtk", LEGACY.format(precision="float", points=POINTS)),
        ("double.vtk", LEGACY.format(precision="double", points=POINTS)),
        ("xml.vtk", XML.format(type="UnstructuredGrid", points=POINTS)),
        ("xml.vtu", XML.format(type="UnstructuredGrid", points=POINTS)),
    ],
)
def test_decimal_coordinates_are_read_in_double_precision(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text)
    mesh = read_mesh(tmp_path / name)
    assert mesh.points[0].tolist() == [DIGITS, 0.0, 0.0]
    assert mesh.tetrahedra.tolist() == [[0, 1, 2, 3]]


def test_xml_of_another_kind_says_what_would_be_valid(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "poly.vtk").write_text(XML.format(type="PolyData", points=POINTS))
    with pytest.raises(MeshError, match=r"poly.vtk: is XML of VTK, but not an UnstructuredGrid; save the mesh as one"):
        read_mesh(tmp_path / "poly.vtk")
    (tmp_path / "none.vtk").write_text("nothing")
    with pytest.raises(MeshError, match=r"none.vtk: not readable as VTK"):
        read_mesh(tmp_path / "none.vtk")
    assert capsys.readouterr() == ("", "")  # the library prints what it thinks of it


def test_stl_vertices_are_merged_in_order(tmp_path: Path) -> None:
    corners = [(5.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 3.0, 0.0), (5.0, 3.0, 0.0)]
    path = tmp_path / "two.stl"
    facets = [[0, 1, 2], [0, 2, 3]]
    lines = ["solid two"]
    for facet in facets:
        lines += ["facet normal 0 0 1", "outer loop"]
        lines += ["vertex {} {} {}".format(*corners[corner]) for corner in facet]
        lines += ["endloop", "endfacet"]
    path.write_text("\n".join([*lines, "endsolid two", ""]))
    mesh = read_mesh(path)
    assert mesh.points.tolist() == [list(corner) for corner in corners]
    assert mesh.triangles.tolist() == facets


def test_an_obj_file_keeps_its_vertices_and_polygons(tmp_path: Path) -> None:
    path = tmp_path / "faces.obj"
    path.write_text(
        "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 9 9 9\nv 2 0.5 0\nf 1/1/1 2/2/1 3/3/1 4/4/1\nf 2//1 -1//1 3//1\n"
        "f 1 2 6 3 4\nl 1 2 3\n"
    )
    mesh = read_mesh(path)
    assert len(mesh.points) == 6
    assert mesh.quads.tolist() == [[0, 1, 2, 3]]
    assert mesh.triangles.tolist() == [[1, 5, 2], [0, 1, 5], [0, 5, 2], [0, 2, 3]]
    assert mesh.edges.tolist() == [[0, 1], [1, 2]]
    assert split_quads(mesh.quads).tolist() == [[0, 1, 2], [0, 2, 3]]
    path.write_text("v 0 0 0\nf 1 2 3\n")
    with pytest.raises(MeshError, match=r"faces.obj: a face names a vertex outside 1..1"):
        read_mesh(path)


def test_a_file_that_has_changed_is_read_again(tmp_path: Path) -> None:
    path = tmp_path / "one.obj"
    path.write_text("v 0 0 0\n")
    assert len(read_mesh(path).points) == 1
    path.write_text("v 0 0 0\nv 1 0 0\n")
    os.utime(path, ns=(1, 1))
    assert len(read_mesh(path).points) == 2


@pytest.mark.parametrize(("name", "volume"), [("smCube27", 7.0**3), ("cube", 8.0), ("floor", 4.0 * 149.34**2)])
def test_a_stock_solid_is_closed_and_has_its_size(name: str, volume: float) -> None:
    mesh = STOCK_MESHES[f"mesh/{name}.obj"]()
    triangles = closed_outward(mesh.points, mesh.triangles, name)
    assert (triangles == mesh.triangles).all()
    assert enclosed_volume(mesh.points, triangles) == pytest.approx(volume, rel=1e-12)


def test_a_stock_mesh_is_found_only_where_the_scene_has_none(tmp_path: Path) -> None:
    def find(name: str) -> Path | None:
        return tmp_path / name if (tmp_path / name).is_file() else None

    assert read_mesh(find_mesh("mesh/floorFlat.obj", find)).points.max() == 20.0
    (tmp_path / "mesh").mkdir()
    (tmp_path / "mesh" / "floorFlat.obj").write_text("v 1 2 3\n")
    assert read_mesh(find_mesh("mesh/floorFlat.obj", find)).points.tolist() == [[1.0, 2.0, 3.0]]
    with pytest.raises(
        MeshError, match=r"^mesh/liver.obj: no such file beside .*; SOFA's own that are known: mesh/smCube"
    ):
        find_mesh("mesh/liver.obj", find)


def test_rotations_turn_about_x_then_y_then_z() -> None:
    turned = placed(np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), (1, 2, 1), (90, 0, 90), (10, 0, 0))
    # y goes to z by the first turn and stays; x goes to y by the last one.
    assert turned == pytest.approx(np.array([[10.0, 1.0, 0.0], [10.0, 0.0, 2.0]]), abs=1e-15)
    both = multiply_quaternions(quaternion((0, 0, 90)), quaternion((90, 0, 0)))
    assert both == pytest.approx(quaternion((90, 0, 90)))
    matrix = rotation_matrix((33.0, -20.0, 71.0))
    assert matrix @ matrix.T == pytest.approx(np.eye(3), abs=1e-15)


def test_a_loader_that_moves_nothing_changes_no_bit() -> None:
    points = np.array([[0.1, 1e-30, -3.3]])
    assert placed_by_loader(points, *NO_MOVE) is points


def test_loaders_place_to_the_last_bit_as_sofa(shared: Path) -> None:
    fingers = np.load(shared / "reference/sofa-cables/second-seed/free.npz")
    points = read_mesh(shared / "sofa-scenes/soft-gripper/mesh/finger.vtk").points
    for number, rotation, shift in ((1, (0, 0, 25), (150, 0, 0)), (2, (180, 0, -25), (150, 20, 0))):
        assert (placed_by_loader(points, (1, 1, 1), rotation, shift) == fingers[f"finger{number}_x0"]).all()
    surface = read_mesh(shared / "sofa-scenes/soft-gripper/mesh/finger.stl")
    assert (surface.triangles == fingers["collis_finger1_collis_tri"]).all()


GID = """ MESH dimension 3 ElemType {kind} Nnode {count}
Coordinates
    1  0 0 0
    2  1.5 0 0
    3  0 2e-3 0
    7  0 0 -3
End Coordinates

Elements
{elements}
End Elements
"""


def test_gid_meshes_keep_their_order(tmp_path: Path) -> None:
    path = tmp_path / "one.gidmsh"
    path.write_text(GID.format(kind="Tetrahedra", count=4, elements="1 1 2 3 7"))
    mesh = read_mesh(path)
    assert mesh.points.tolist() == [[0, 0, 0], [1.5, 0, 0], [0, 2e-3, 0], [0, 0, -3]]
    assert mesh.tetrahedra.tolist() == [[0, 1, 2, 3]]
    path = tmp_path / "triangles.gid"
    path.write_text(GID.format(kind="Triangle", count=3, elements="5 7 2 3\n6 1 2 3"))
    assert read_mesh(path).triangles.tolist() == [[3, 1, 2], [0, 1, 2]]


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        (GID.format(kind="Tetrahedra", count=10, elements="1 1 2 3 7"), r"Nnode 10; known are Linear of 2 nodes, "),
        (GID.format(kind="Tetrahedra", count=4, elements="1 1 2 3 4"), "names node 4, which is not among"),
        (GID.format(kind="Tetrahedra", count=4, elements=""), "no lines between 'Elements'"),
        ("MESH", "has no ElemType and Nnode"),
    ],
)
def test_a_broken_mesh_of_gid_is_one_line(tmp_path: Path, text: str, wrong: str) -> None:
    path = tmp_path / "broken.gidmsh"
    path.write_text(text)
    with pytest.raises(MeshError, match=wrong):
        read_mesh(path)
