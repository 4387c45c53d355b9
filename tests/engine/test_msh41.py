"""MSH 4.1: what is written is what gmsh understands, and what gmsh writes is read, in all its variants."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from taichisoft import VolumeMesh, read_volume_mesh, write_volume_mesh
from taichisoft.errors import MeshError
from taichisoft.mesh import read_unchecked_mesh, tetrahedron_volumes
from taichisoft_meshing.gmsh_session import gmsh_session

NODES = np.vstack([np.zeros(3), np.eye(3), np.ones(3)])
ELEMENTS = np.array([[0, 1, 2, 3], [1, 2, 3, 4]])
FACES = np.array([[1, 2, 3], [0, 2, 1], [1, 2, 4]])


@contextmanager
def gmsh_open(path: Path | None = None) -> Iterator[Any]:
    with gmsh_session("a test") as gmsh:
        if path is not None:
            gmsh.open(str(path))
        yield gmsh


def test_gmsh_finds_every_group_with_its_cells(tmp_path: Path) -> None:
    """Groups that overlap, that name their cells out of order, and cells in no group."""
    surfaces = {"outer": FACES[[1, 2]], "base": FACES[[1]], "inside": FACES[[0]]}
    mesh = VolumeMesh("two", NODES, ELEMENTS, surfaces, {"silicone": np.arange(2), "stiff layer": np.array([1])})
    write_volume_mesh(mesh, tmp_path / "two.msh")
    found = {}
    with gmsh_open(tmp_path / "two.msh") as gmsh:
        for dimension, tag in gmsh.model.getPhysicalGroups():
            entities = gmsh.model.getEntitiesForPhysicalGroup(dimension, tag)
            rows = [gmsh.model.mesh.getElements(dimension, entity)[2][0] for entity in entities]
            cells = np.concatenate(rows).reshape(-1, dimension + 1) - 1
            found[gmsh.model.getPhysicalName(dimension, tag)] = sorted(cells.tolist())
        tags, positions, _ = gmsh.model.mesh.getNodes()
    expected = {name: sorted(group.tolist()) for name, group in surfaces.items()}
    assert found == expected | {"silicone": ELEMENTS.tolist(), "stiff layer": ELEMENTS[[1]].tolist()}
    np.testing.assert_array_equal(positions.reshape(-1, 3)[np.argsort(tags)], NODES)


@pytest.mark.parametrize("binary", [0, 1])
@pytest.mark.parametrize("save_all", [0, 1])
@pytest.mark.parametrize("parametric", [0, 1])
def test_what_gmsh_writes_is_read_in_any_variant(tmp_path: Path, binary: int, save_all: int, parametric: int) -> None:
    """A box of 2 x 3 x 4 mm beside one of 1 x 3 x 4 mm; only the first is in a group, with two of its sides."""
    with gmsh_open() as gmsh:
        boxes = [gmsh.model.occ.addBox(0, 0, 0, 2, 3, 4), gmsh.model.occ.addBox(2, 0, 0, 1, 3, 4)]
        gmsh.model.occ.fragment([(3, boxes[0])], [(3, boxes[1])])
        gmsh.model.occ.synchronize()
        gmsh.model.addPhysicalGroup(2, [1, 2], name="two sides")
        gmsh.model.addPhysicalGroup(3, [boxes[0]], name="first")
        gmsh.model.addPhysicalGroup(3, [boxes[0]], name="the same")
        gmsh.model.mesh.generate(3)
        for option, value in (("Binary", binary), ("SaveAll", save_all), ("SaveParametric", parametric)):
            gmsh.option.setNumber(f"Mesh.{option}", value)
        gmsh.write(str(tmp_path / "boxes.msh"))
    mesh = read_volume_mesh(tmp_path / "boxes.msh")
    volumes = tetrahedron_volumes(mesh.nodes, mesh.elements)
    assert volumes.sum() == pytest.approx(36 if save_all else 24, rel=1e-12)
    assert volumes[mesh.element_groups["first"]].sum() == pytest.approx(24, rel=1e-12)
    np.testing.assert_array_equal(mesh.element_groups["the same"], mesh.element_groups["first"])
    a, b, c = np.moveaxis(mesh.nodes[mesh.surface_groups["two sides"]], 1, 0)
    assert np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2 == pytest.approx(24, rel=1e-12)


# Some library that Taichi loads lets this process round subnormal numbers to 0.
NUMBERS = st.floats(allow_nan=False, allow_infinity=False, allow_subnormal=False)


@given(arrays(np.float64, (4, 3), elements=NUMBERS))
def test_every_digit_of_a_node_is_kept(tmp_path_factory: pytest.TempPathFactory, nodes: np.ndarray) -> None:
    path = tmp_path_factory.getbasetemp() / "digits.msh"
    write_volume_mesh(VolumeMesh("one", nodes, np.arange(4).reshape(1, 4)), path)
    assert read_unchecked_mesh(path).nodes.tobytes() == nodes.tobytes()


def test_cells_and_nodes_come_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    """Files may have them in any order, numbered with gaps."""
    path = tmp_path / "numbers.msh"
    path.write_text(
        "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Comments\nanything $ at all\n$EndComments\n"
        "$Nodes\n2 5 1 90\n3 1 0 3\n30\n1\n90\n0 1 0\n0 0 0\n1 1 1\n3 2 0 2\n40 20\n0 0 1 1 0 0\n$EndNodes\n"
        "$Elements\n2 2 5 7\n3 1 4 1\n7 20 30 40 90\n3 2 4 1\n5 1 20 30 40\n$EndElements\n"
    )
    mesh = read_volume_mesh(path)
    np.testing.assert_array_equal(mesh.nodes, NODES)
    np.testing.assert_array_equal(mesh.elements, ELEMENTS)


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ("1 1 2 3 4", "1 1 2 3 9", "a cell names the node 9, which it does not have"),
        ("1 1 2 3 4", "1 1 2 3", "a section has fewer numbers than it says"),
        ("1 1 2 3 4", "1 1 2 3 4.5", "4.5 stands where a whole number is needed"),
        ("1 1 2 3 4", "1 1 2 3 many", "could not convert string to float"),
        ("3 1 4 2", "3 1 77 2", "it has cells of type 77, which is not known here"),
        ("1 5 1 5", "1 6 1 6", "it has 5 nodes with numbers of their own instead of 6"),
        ("$EndNodes\n", "", r"the file stops in the middle of $Nodes"),
        ("$Nodes", "$Knots", "the file stops in the middle of $Knots"),
    ],
)
def test_a_broken_file_is_refused_with_what_is_wrong(tmp_path: Path, old: str, new: str, why: str) -> None:
    path = tmp_path / "two.msh"
    write_volume_mesh(VolumeMesh("two", NODES, ELEMENTS), path)
    whole = path.read_text()
    assert old in whole
    path.write_text(whole.replace(old, new, 1))
    with pytest.raises(MeshError) as refused:
        read_volume_mesh(path)
    assert f"{path}: not readable as MSH: {why}" in str(refused.value)


def test_a_binary_file_that_stops_anywhere_is_refused(tmp_path: Path) -> None:
    with gmsh_open() as gmsh:
        gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
        gmsh.model.occ.synchronize()
        gmsh.model.mesh.generate(3)
        gmsh.option.setNumber("Mesh.Binary", 1)
        gmsh.write(str(tmp_path / "box.msh"))
    content = (tmp_path / "box.msh").read_bytes()
    for length in range(1, len(content) - 1, len(content) // 50):
        (tmp_path / "part.msh").write_bytes(content[:length])
        with pytest.raises(MeshError, match=r"part\.msh: not readable as MSH: "):
            read_volume_mesh(tmp_path / "part.msh")


def test_cells_of_other_shapes_are_named(tmp_path: Path) -> None:
    """A pyramid beside the tetrahedra: to leave it out would leave a hole."""
    path = tmp_path / "mixed.msh"
    write_volume_mesh(VolumeMesh("two", NODES, ELEMENTS), path)
    path.write_text(path.read_text().replace("1 2 1 2\n3 1 4 2", "2 3 1 3\n3 1 7 1\n3 1 2 3 4 5\n3 1 4 2"))
    with pytest.raises(MeshError, match=r"has cells that are no tetrahedra \(1 of pyramid\)"):
        read_volume_mesh(path)
