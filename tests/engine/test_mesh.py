"""What a volume mesh must be before anything is computed with it."""

import numpy as np
import pytest
from conftest import examples
from hypothesis import given
from hypothesis import strategies as st

from taichisoft import VolumeMesh
from taichisoft.errors import MeshError
from taichisoft.mesh import boundary_triangles, enclosed_volume, tetrahedron_volumes

# A unit cube cut into six tetrahedra around its diagonal from node 0 to node 7.
CUBE_NODES = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
CUBE = np.array([[0, 4, 6, 7], [0, 6, 2, 7], [0, 2, 3, 7], [0, 3, 1, 7], [0, 1, 5, 7], [0, 5, 4, 7]])


def cube(nodes: np.ndarray = CUBE_NODES, elements: np.ndarray = CUBE) -> VolumeMesh:
    return VolumeMesh("cube.msh", nodes, elements)


def with_entry(array: np.ndarray, place: tuple[int, ...], value: float) -> np.ndarray:
    changed = array.copy()
    changed[place] = value
    return changed


def test_a_sound_mesh_is_returned_itself_with_its_volume() -> None:
    mesh = cube()
    assert mesh.check() is mesh
    np.testing.assert_allclose(tetrahedron_volumes(mesh.nodes, mesh.elements), 1 / 6, rtol=1e-14)


@pytest.mark.parametrize(
    ("mesh", "message"),
    [
        (cube(elements=np.empty((0, 4))), "has no tetrahedra; a volume mesh (.vtk, .vtu, .msh) is needed"),
        (cube(nodes=with_entry(CUBE_NODES, (5, 1), np.nan)), "node 5 has a coordinate that is not finite"),
        (cube(nodes=with_entry(CUBE_NODES, (2, 0), np.inf)), "node 2 has a coordinate that is not finite"),
        (cube(nodes=with_entry(CUBE_NODES, (2, 0), -1e300)), "node 2 has a coordinate of -1e+300 mm; 1e+09 mm is the"),
        (cube(nodes=with_entry(CUBE_NODES, (7, 2), 1.01e9)), "node 7 has a coordinate of 1.01e+09 mm; 1e+09 mm is the"),
        (cube(elements=with_entry(CUBE, (3, 1), 8)), "element 3 has a node index outside 0..7"),
        (cube(elements=with_entry(CUBE, (3, 1), -1)), "element 3 has a node index outside 0..7"),
        (cube(nodes=np.vstack([CUBE_NODES, [2, 2, 2]])), "node 8 belongs to no element"),
        (cube(elements=np.vstack([CUBE, CUBE[1, [1, 2, 0, 3]]])), "element 6 stands twice in the mesh"),
        (cube(elements=with_entry(CUBE, (2, 0), 3)), "element 2 has no volume"),
        (cube(elements=CUBE[:, [0, 1, 3, 2]]), "element 0 is inverted (its volume is negative); swap two"),
        (cube(elements=CUBE[:, [0, 1, 3, 2]]), "(6 such elements)"),
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
        mesh = cube(elements=elements).check()
    except MeshError as error:
        assert changed and str(error).startswith("cube.msh: ")
        return
    assert (tetrahedron_volumes(mesh.nodes, mesh.elements) > 0).all()
    assert set(range(8)) == set(mesh.elements.ravel().tolist())


@examples(40)
@given(node=st.integers(0, 7), axis=st.integers(0, 2), value=st.sampled_from([np.nan, np.inf, -np.inf]))
def test_any_coordinate_that_is_not_finite_is_refused(node: int, axis: int, value: float) -> None:
    with pytest.raises(MeshError, match=f"node {node} has a coordinate that is not finite"):
        cube(nodes=with_entry(CUBE_NODES, (node, axis), value)).check()


@examples(40)
@given(order=st.permutations(range(8)), first=st.permutations(range(6)))
def test_a_sound_mesh_stays_sound_however_it_is_numbered(order: list[int], first: list[int]) -> None:
    new_number = np.argsort(order)
    mesh = cube(nodes=CUBE_NODES[order], elements=new_number[CUBE][first]).check()
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
