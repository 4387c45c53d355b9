"""Volume meshes: what they must be, and their files: what was written is read, what is broken refused in one line."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import examples
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from taichisoft import VolumeMesh, read_volume_mesh, write_volume_mesh
from taichisoft.errors import MeshError
from taichisoft.mesh import boundary_triangles, enclosed_volume, read_unchecked_mesh, tetrahedron_volumes
from taichisoft_meshing.gmsh_session import gmsh_session

# What a volume mesh must be before anything is computed with it.

# A unit box cut into six tetrahedra around its diagonal from node 0 to node 7.
CUBE_NODES = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
CUBE = np.array([[0, 4, 6, 7], [0, 6, 2, 7], [0, 2, 3, 7], [0, 3, 1, 7], [0, 1, 5, 7], [0, 5, 4, 7]])


def box(nodes: np.ndarray = CUBE_NODES, elements: np.ndarray = CUBE) -> VolumeMesh:
    return VolumeMesh("cube.msh", nodes, elements)


def with_entry(array: np.ndarray, place: tuple[int, ...], value: float) -> np.ndarray:
    changed = array.copy()
    changed[place] = value
    return changed


def test_a_sound_mesh_is_returned_itself_with_its_volume() -> None:
    mesh = box()
    assert mesh.check() is mesh
    np.testing.assert_allclose(tetrahedron_volumes(mesh.nodes, mesh.elements), 1 / 6, rtol=1e-14)


@pytest.mark.parametrize(
    ("mesh", "message"),
    [
        (box(elements=np.empty((0, 4))), "has no tetrahedra; a volume mesh (.vtk, .vtu, .msh) is needed"),
        (box(nodes=with_entry(CUBE_NODES, (5, 1), np.nan)), "node 5 has a coordinate that is not finite"),
        (box(nodes=with_entry(CUBE_NODES, (2, 0), np.inf)), "node 2 has a coordinate that is not finite"),
        (
            box(nodes=with_entry(CUBE_NODES, (2, 0), -1e300)),
            "node 2 has a coordinate of -1e+300 mm; 1e+09 mm is the",
        ),
        (
            box(nodes=with_entry(CUBE_NODES, (7, 2), 1.01e9)),
            "node 7 has a coordinate of 1.01e+09 mm; 1e+09 mm is the",
        ),
        (box(elements=with_entry(CUBE, (3, 1), 8)), "element 3 has a node index outside 0..7"),
        (box(elements=with_entry(CUBE, (3, 1), -1)), "element 3 has a node index outside 0..7"),
        (box(nodes=np.vstack([CUBE_NODES, [2, 2, 2]])), "node 8 belongs to no element"),
        (box(elements=np.vstack([CUBE, CUBE[1, [1, 2, 0, 3]]])), "element 6 stands twice in the mesh"),
        (box(elements=with_entry(CUBE, (2, 0), 3)), "element 2 has no volume"),
        (box(elements=CUBE[:, [0, 1, 3, 2]]), "element 0 is inverted (its volume is negative); swap two"),
        (box(elements=CUBE[:, [0, 1, 3, 2]]), "(6 such elements)"),
    ],
)
def test_an_unsound_mesh_is_refused_in_one_line(mesh: VolumeMesh, message: str) -> None:
    with pytest.raises(MeshError) as refused:
        mesh.check()
    assert str(refused.value).startswith("cube.msh: ")
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)


@examples(60)
@given(element=st.integers(0, 5), corner=st.integers(0, 3), index=st.integers(-2, 9))
def test_what_passes_has_positive_elements_and_no_loose_node(element: int, corner: int, index: int) -> None:
    """One corner of a sound mesh replaced: refused, or at least every element by itself is sound."""
    elements = with_entry(CUBE, (element, corner), index)
    changed = not np.array_equal(elements, CUBE)
    try:
        mesh = box(elements=elements).check()
    except MeshError as error:
        assert changed and str(error).startswith("cube.msh: ")
        return
    assert (tetrahedron_volumes(mesh.nodes, mesh.elements) > 0).all()
    assert set(range(8)) == set(mesh.elements.ravel().tolist())


@examples(40)
@given(node=st.integers(0, 7), axis=st.integers(0, 2), value=st.sampled_from([np.nan, np.inf, -np.inf]))
def test_any_coordinate_that_is_not_finite_is_refused(node: int, axis: int, value: float) -> None:
    with pytest.raises(MeshError, match=f"node {node} has a coordinate that is not finite"):
        box(nodes=with_entry(CUBE_NODES, (node, axis), value)).check()


@examples(40)
@given(order=st.permutations(range(8)), first=st.permutations(range(6)))
def test_a_sound_mesh_stays_sound_however_it_is_numbered(order: list[int], first: list[int]) -> None:
    new_number = np.argsort(order)
    mesh = box(nodes=CUBE_NODES[order], elements=new_number[CUBE][first]).check()
    skin = boundary_triangles(mesh.elements)
    assert enclosed_volume(mesh.nodes, skin) == pytest.approx(1.0, rel=1e-14)


def test_the_boundary_of_a_cube_is_its_twelve_outward_triangles() -> None:
    """Every edge of a closed surface is passed once in each direction; outward means a positive volume."""
    skin = boundary_triangles(CUBE)
    assert skin.shape == (12, 3)
    edges = {(a, b) for triangle in skin.tolist() for a, b in zip(triangle, triangle[1:] + triangle[:1], strict=True)}
    assert len(edges) == 36
    assert all((b, a) in edges for a, b in edges)
    assert enclosed_volume(CUBE_NODES, skin) == pytest.approx(1.0, rel=1e-14)


# Volume meshes in files: what was written is read again, and what is broken is refused in one line.

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


@pytest.mark.parametrize(
    ("nodes", "elements", "message"),
    [
        (NODES, np.vstack([ELEMENTS, ELEMENTS[:1]]), "element 6 stands twice"),  # also within a group of MSH
        (NODES, ELEMENTS[:, [0, 1, 3, 2]], "is inverted"),  # and not turned round
        (np.vstack([NODES, [9, 9, 9]]), ELEMENTS, "node 8 belongs to no element"),
    ],
)
@pytest.mark.parametrize("suffix", [".msh", ".vtk", ".vtu"])
def test_file_of_an_unsound_mesh_is_refused(
    tmp_path: Path, suffix: str, nodes: np.ndarray, elements: np.ndarray, message: str
) -> None:
    mesh = VolumeMesh("cube", nodes, elements, element_groups={"all": np.arange(len(elements))})
    write_volume_mesh(mesh, tmp_path / f"cube{suffix}")
    assert message in refusal(tmp_path / f"cube{suffix}")


def test_surface_is_no_volume_mesh(tmp_path: Path) -> None:
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
def test_a_file_that_stops_anywhere_is_refused(tmp_path: Path, suffix: str) -> None:
    whole, broken = tmp_path / f"whole{suffix}", tmp_path / f"broken{suffix}"
    write_volume_mesh(cube(), whole)
    content = whole.read_bytes()
    end = content.rindex(b"$End") if suffix == ".msh" else len(content) - 2
    for length in (*range(0, end, max(end // 40, 1)), *range(end - 20, end)):
        broken.write_bytes(content[:length])
        refusal(broken)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("absent.msh", None, "no such file; a volume mesh (.msh, .vtk, .vtu) is needed"),
        ("skin.stl", None, "'.stl' is not a kind of volume mesh file; valid: .msh, .vtk, .vtu"),
        ("noise.msh", bytes(range(256)), "not readable as MSH"),
        *(
            (f"empty{suffix}", b"", "is empty; a volume mesh (.msh, .vtk, .vtu) is")
            for suffix in (".msh", ".vtk", ".vtu")
        ),
    ],
)
def test_file_of_another_kind_is_refused(tmp_path: Path, name: str, content: bytes | None, message: str) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    assert message in refusal(tmp_path / name)


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


@pytest.mark.parametrize(
    ("mesh", "name", "message"),
    [
        (cube(), "absent/cube.msh", r"cannot be written: No such file or directory"),
        (cube(), "cube.txt", r"'\.txt' is not a kind of volume mesh file"),
        (
            VolumeMesh("cube", NODES, ELEMENTS, {"a": OUTER}, {"a": np.arange(2)}),
            "cube.msh",
            "'a' names a surface group and an element group",
        ),
        (VolumeMesh("cube", NODES, ELEMENTS, {'"': OUTER}), "cube.msh", "files need a name without quotes"),
        (
            VolumeMesh("cube", NODES, ELEMENTS, {"a": OUTER[[0, 0]]}),
            "cube.vtu",
            "cube: group 'a' names one triangle twice",
        ),
    ],
)
def test_failed_writing_leaves_nothing_behind(tmp_path: Path, mesh: VolumeMesh, name: str, message: str) -> None:
    with pytest.raises(MeshError, match=message):
        write_volume_mesh(mesh, tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_huge_node_number_is_refused_without_warning(tmp_path: Path) -> None:
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


# MSH 4.1: what is written is what gmsh understands, and what gmsh writes is read, in all its variants.

TWO_NODES = np.vstack([np.zeros(3), np.eye(3), np.ones(3)])
TWO = np.array([[0, 1, 2, 3], [1, 2, 3, 4]])
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
    mesh = VolumeMesh("two", TWO_NODES, TWO, surfaces, {"silicone": np.arange(2), "stiff layer": np.array([1])})
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
    assert found == expected | {"silicone": TWO.tolist(), "stiff layer": TWO[[1]].tolist()}
    np.testing.assert_array_equal(positions.reshape(-1, 3)[np.argsort(tags)], TWO_NODES)


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
    np.testing.assert_array_equal(mesh.nodes, TWO_NODES)
    np.testing.assert_array_equal(mesh.elements, TWO)


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
    write_volume_mesh(VolumeMesh("two", TWO_NODES, TWO), path)
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


def test_pyramid_beside_tetrahedra_is_named(tmp_path: Path) -> None:
    """A pyramid beside the tetrahedra: to leave it out would leave a hole."""
    path = tmp_path / "mixed.msh"
    write_volume_mesh(VolumeMesh("two", TWO_NODES, TWO), path)
    path.write_text(path.read_text().replace("1 2 1 2\n3 1 4 2", "2 3 1 3\n3 1 7 1\n3 1 2 3 4 5\n3 1 4 2"))
    with pytest.raises(MeshError, match=r"has cells that are no tetrahedra \(1 of pyramid\)"):
        read_volume_mesh(path)


MSH_1 = """$NOD
5
7 0 0 0
1 10 0 0
3 0 10 0
4 0 0 10
9 10 10 10
$ENDNOD
$ELM
3
1 15 0 1 1 7
2 4 5 1 4 7 1 3 4
3 4 6 1 4 1 9 3 4
$ENDELM
"""


def test_msh_1_is_read_by_the_numbers_of_its_nodes(tmp_path: Path) -> None:
    path = tmp_path / "old.msh"
    path.write_text(MSH_1)
    mesh = read_volume_mesh(path)
    assert mesh.nodes.tolist() == [[10, 0, 0], [0, 10, 0], [0, 0, 10], [0, 0, 0], [10, 10, 10]]
    assert mesh.elements.tolist() == [[3, 0, 1, 2], [0, 4, 1, 2]]


@pytest.mark.parametrize("end", range(0, len(MSH_1) - 2, 7))
def test_msh_1_that_stops_anywhere_is_refused(tmp_path: Path, end: int) -> None:
    path = tmp_path / "old.msh"
    path.write_text(MSH_1[:end])
    with pytest.raises(MeshError, match=r"old\.msh"):
        read_volume_mesh(path)
