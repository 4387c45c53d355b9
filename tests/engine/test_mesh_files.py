"""Volume meshes in files: what was written is read again, and what is broken is refused in one line."""

import warnings
from pathlib import Path

import numpy as np
import pytest

from taichisoft import VolumeMesh, read_volume_mesh, write_volume_mesh
from taichisoft.errors import MeshError
from taichisoft.mesh import tetrahedron_volumes

TUTORIAL = Path(__file__).resolve().parents[2].parent / "shared" / "tutorial-meshes"

# Thirds and tenths have no short decimal form: a format that rounds shows.
NODES = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) / 3 + np.sqrt(2) / 10
ELEMENTS = np.array([[0, 5, 4, 7], [0, 4, 6, 7], [0, 6, 2, 7], [0, 2, 3, 7], [0, 3, 1, 7], [0, 1, 5, 7]])
OUTER = np.array([[0, 6, 4], [0, 2, 6], [1, 5, 7]])


def cube() -> VolumeMesh:
    """A cube whose groups overlap, stand out of order, or leave elements out."""
    return VolumeMesh(
        "cube",
        NODES,
        ELEMENTS,
        {"outer": OUTER, "base plate": OUTER[[1]], "nowhere": OUTER[:0]},
        {"stiff": np.array([1, 4, 5]), "half": np.array([1, 2])},
    )


def refusal(path: Path) -> str:
    with pytest.raises(MeshError) as refused:
        read_volume_mesh(path)
    assert str(refused.value).startswith(f"{path}: ")
    assert "\n" not in str(refused.value)
    return str(refused.value)


@pytest.mark.parametrize("suffix", [".msh", ".vtk", ".vtu", ".MSH"])
def test_nodes_and_elements_come_back_bit_for_bit(tmp_path: Path, suffix: str) -> None:
    write_volume_mesh(cube(), tmp_path / f"cube{suffix}")
    mesh = read_volume_mesh(tmp_path / f"cube{suffix}")
    np.testing.assert_array_equal(mesh.nodes, NODES)
    np.testing.assert_array_equal(mesh.elements, ELEMENTS)
    assert list(tmp_path.iterdir()) == [tmp_path / f"cube{suffix}"]


def test_msh_keeps_groups_that_overlap_and_elements_in_none(tmp_path: Path) -> None:
    write_volume_mesh(cube(), tmp_path / "cube.msh")
    mesh = read_volume_mesh(tmp_path / "cube.msh")
    for name, groups in (("surface", "surface_groups"), ("element", "element_groups")):
        written, read = getattr(cube(), groups), getattr(mesh, groups)
        assert list(read) == list(written), name
        for group, members in written.items():
            np.testing.assert_array_equal(read[group], members)


def test_vtu_keeps_groups_as_cell_data_that_other_programs_show(tmp_path: Path) -> None:
    import meshio

    write_volume_mesh(cube(), tmp_path / "cube.vtu")
    mesh = read_volume_mesh(tmp_path / "cube.vtu")
    assert list(mesh.surface_groups) == ["outer", "base plate"]  # a group of nothing has no place there
    np.testing.assert_array_equal(mesh.surface_groups["outer"], OUTER)
    np.testing.assert_array_equal(mesh.surface_groups["base plate"], OUTER[[1]])
    np.testing.assert_array_equal(mesh.element_groups["stiff"], [1, 4, 5])
    np.testing.assert_array_equal(mesh.element_groups["half"], [1, 2])
    shown = meshio.vtu.read(tmp_path / "cube.vtu")
    np.testing.assert_array_equal(shown.cell_data["group:stiff"][0], [0, 1, 0, 0, 1, 1])
    np.testing.assert_array_equal(shown.cell_data["group:base plate"][1], [0, 1, 0])


def test_legacy_vtk_has_the_tetrahedra_alone(tmp_path: Path) -> None:
    import meshio

    write_volume_mesh(cube(), tmp_path / "cube.vtk")
    assert (tmp_path / "cube.vtk").read_bytes().startswith(b"# vtk DataFile Version 4.2\n")
    assert [block.type for block in meshio.vtk.read(tmp_path / "cube.vtk").cells] == ["tetra"]


def test_msh_2_repeats_a_cell_for_each_of_its_groups(tmp_path: Path) -> None:
    """As the shipped meshes do: such a cell is read once."""
    path = tmp_path / "old.msh"
    nodes = "".join(f"{i} {x} {y} {z}\n" for i, (x, y, z) in enumerate(NODES.tolist(), start=1))
    path.write_text(
        '$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n2\n3 7 "all"\n3 8 "stiff"\n$EndPhysicalNames\n'
        f"$Nodes\n8\n{nodes}$EndNodes\n$Elements\n8\n"
        + "".join(f"{i} 4 2 7 1 {' '.join(map(str, cell + 1))}\n" for i, cell in enumerate(ELEMENTS, start=1))
        + "".join(f"{i} 4 2 8 1 {' '.join(map(str, cell + 1))}\n" for i, cell in enumerate(ELEMENTS[[4, 2]], start=7))
        + "$EndElements\n"
    )
    mesh = read_volume_mesh(path)
    np.testing.assert_array_equal(mesh.elements, ELEMENTS)
    np.testing.assert_array_equal(mesh.element_groups["all"], np.arange(6))
    np.testing.assert_array_equal(mesh.element_groups["stiff"], [2, 4])


@pytest.mark.parametrize(("name", "nodes", "elements"), [("Coarse", 376, 1195), ("", 2316, 9560)])
def test_the_tutorials_meshes_keep_their_numbering(name: str, nodes: int, elements: int) -> None:
    path = TUTORIAL / f"pneunetCut{name}.vtk"
    if not path.is_file():
        pytest.skip(f"the tutorial's meshes are not at {TUTORIAL}")
    mesh = read_volume_mesh(path)
    assert (len(mesh.nodes), len(mesh.elements)) == (nodes, elements)
    assert tetrahedron_volumes(mesh.nodes, mesh.elements).sum() == pytest.approx(51162.5, rel=1e-9)
    lines = path.read_text().splitlines()
    start = lines.index(f"POINTS {nodes} double") + 1
    np.testing.assert_array_equal(mesh.nodes, np.loadtxt(lines[start : start + nodes]))


def test_an_element_written_twice_is_still_an_error(tmp_path: Path) -> None:
    """MSH repeats an element for each of its groups; repeated within one group it is a fault of the mesh."""
    group = {"all": np.arange(7)}
    twice = VolumeMesh("cube", NODES, np.vstack([ELEMENTS, ELEMENTS[:1]]), element_groups=group)
    for suffix in (".msh", ".vtk"):
        write_volume_mesh(twice, tmp_path / f"twice{suffix}")
        assert "element 6 stands twice" in refusal(tmp_path / f"twice{suffix}")


def test_an_inverted_element_is_refused_and_not_turned_round(tmp_path: Path) -> None:
    write_volume_mesh(VolumeMesh("cube", NODES, ELEMENTS[:, [0, 1, 3, 2]]), tmp_path / "inside-out.vtu")
    assert "is inverted" in refusal(tmp_path / "inside-out.vtu")


def test_a_node_of_no_element_is_refused(tmp_path: Path) -> None:
    write_volume_mesh(VolumeMesh("cube", np.vstack([NODES, [9, 9, 9]]), ELEMENTS), tmp_path / "loose.msh")
    assert "node 8 belongs to no element" in refusal(tmp_path / "loose.msh")


def test_a_surface_is_no_volume_mesh(tmp_path: Path) -> None:
    import meshio

    meshio.vtk.write(tmp_path / "skin.vtk", meshio.Mesh(NODES, [("triangle", OUTER)]))
    assert "has no tetrahedra" in refusal(tmp_path / "skin.vtk")


@pytest.mark.parametrize("suffix", [".vtk", ".vtu"])
def test_cells_of_other_shapes_are_named(tmp_path: Path, suffix: str) -> None:
    """A hexahedron beside a tetrahedron: to leave it out would leave a hole."""
    import meshio

    nodes = np.vstack([NODES, [2, 2, 2]])
    cells = [("tetra", np.array([[0, 5, 4, 7]])), ("hexahedron", np.array([[0, 1, 3, 2, 4, 5, 7, 8]]))]
    write = {".vtk": meshio.vtk.write, ".vtu": meshio.vtu.write}[suffix]
    write(tmp_path / f"mixed{suffix}", meshio.Mesh(nodes, cells))
    assert "has cells that are no tetrahedra (1 of hexahedron)" in refusal(tmp_path / f"mixed{suffix}")


@pytest.mark.parametrize("suffix", [".msh", ".vtk", ".vtu"])
def test_an_empty_file_is_named_as_such(tmp_path: Path, suffix: str) -> None:
    (tmp_path / f"empty{suffix}").touch()
    assert "is empty; a volume mesh (.msh, .vtk, .vtu) is needed" in refusal(tmp_path / f"empty{suffix}")


@pytest.mark.parametrize("suffix", [".msh", ".vtk", ".vtu"])
def test_a_file_that_stops_anywhere_is_refused(tmp_path: Path, suffix: str) -> None:
    whole, broken = tmp_path / f"whole{suffix}", tmp_path / f"broken{suffix}"
    write_volume_mesh(cube(), whole)
    content = whole.read_bytes()
    end = content.rindex(b"$End") if suffix == ".msh" else len(content) - 2
    for length in (*range(0, end, max(end // 40, 1)), *range(end - 20, end)):
        broken.write_bytes(content[:length])
        refusal(broken)


def test_what_is_missing_or_of_another_kind_is_refused(tmp_path: Path) -> None:
    assert "no such file; a volume mesh (.msh, .vtk, .vtu) is needed" in refusal(tmp_path / "absent.msh")
    assert "'.stl' is not a kind of volume mesh file; valid: .msh, .vtk, .vtu" in refusal(tmp_path / "skin.stl")
    (tmp_path / "noise.msh").write_bytes(bytes(range(256)))
    assert "not readable as MSH" in refusal(tmp_path / "noise.msh")


def test_a_disk_that_fills_up_leaves_the_old_file_as_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import meshio

    def fill_the_disk(path: Path, *_: object, **__: object) -> None:
        path.write_text("half a mesh")
        raise OSError(28, "No space left on device")

    (tmp_path / "cube.vtu").write_text("the mesh of yesterday")
    monkeypatch.setattr(meshio.vtu, "write", fill_the_disk)
    with pytest.raises(MeshError, match=r"cube\.vtu: cannot be written: No space left on device$"):
        write_volume_mesh(cube(), tmp_path / "cube.vtu")
    assert list(tmp_path.iterdir()) == [tmp_path / "cube.vtu"]
    assert (tmp_path / "cube.vtu").read_text() == "the mesh of yesterday"


def test_nothing_is_left_behind_when_writing_fails(tmp_path: Path) -> None:
    with pytest.raises(MeshError, match=r"cannot be written: No such file or directory"):
        write_volume_mesh(cube(), tmp_path / "absent" / "cube.msh")
    clash = VolumeMesh("cube", NODES, ELEMENTS, {"a": OUTER}, {"a": np.arange(2)})
    with pytest.raises(MeshError, match="'a' names a surface group and an element group"):
        write_volume_mesh(clash, tmp_path / "cube.msh")
    with pytest.raises(MeshError, match="files need a name without quotes"):
        write_volume_mesh(VolumeMesh("cube", NODES, ELEMENTS, {'"': OUTER}), tmp_path / "cube.msh")
    with pytest.raises(MeshError, match=r"'\.txt' is not a kind of volume mesh file"):
        write_volume_mesh(cube(), tmp_path / "cube.txt")
    with pytest.raises(MeshError, match="cube: group 'a' names one triangle twice"):
        write_volume_mesh(VolumeMesh("cube", NODES, ELEMENTS, {"a": OUTER[[0, 0]]}), tmp_path / "cube.vtu")
    assert list(tmp_path.iterdir()) == []


def test_a_number_of_a_node_that_no_integer_holds_is_refused_without_a_warning(tmp_path: Path) -> None:
    """As a broken transfer makes it: meshio casts whatever it reads."""
    path = tmp_path / "cube.msh"
    nodes = "".join(f"{number} {x} {y} {z}\n" for number, (x, y, z) in enumerate(NODES.tolist(), 1))
    nodes = nodes.replace("\n8 ", "\n1e300 ")
    path.write_text(
        f"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n8\n{nodes}$EndNodes\n"
        "$Elements\n1\n1 4 2 1 1 1 6 5 8\n$EndElements\n"
    )
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        refusal(path)
    assert [str(one.message) for one in told] == []
