"""The shapes of tetrahedra."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from taichisoft_meshing.gmsh_session import gmsh_session
from taichisoft_meshing.wall_quality import dihedral_angles, edge_lengths, radius_ratios

ORDER = np.array([[0, 1, 2, 3]])
REGULAR = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], dtype=float)
CORNER = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
LINE = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]], dtype=float)


def test_the_regular_tetrahedron_has_the_ratio_1_in_any_size() -> None:
    for size in (1e-3, 1.0, 1e3):
        assert radius_ratios(size * REGULAR, ORDER) == pytest.approx([1], rel=1e-12)
        assert edge_lengths(size * REGULAR, ORDER).ravel() == pytest.approx([size * np.sqrt(8)] * 2, rel=1e-12)


def test_the_corner_of_a_cube_has_the_ratio_of_its_two_spheres() -> None:
    """Circumscribed sqrt(3)/2; inscribed 3 V / S = (1/2) / (3/2 + sqrt(3)/2) = 1 / (3 + sqrt(3))."""
    expected = 3 / (3 + np.sqrt(3)) / (np.sqrt(3) / 2)
    assert radius_ratios(CORNER, ORDER) == pytest.approx([expected], rel=1e-12)


def test_a_flat_tetrahedron_has_the_ratio_0() -> None:
    assert radius_ratios(SQUARE, ORDER) == pytest.approx([0], abs=1e-15)
    assert radius_ratios(LINE, ORDER) == pytest.approx([0], abs=1e-15)


def test_dihedral_angles_of_known_tetrahedra() -> None:
    """Regular: acos(1/3). Corner of a cube: 90 degrees at the three edges of the cube, else acos(1/sqrt(3))."""
    assert dihedral_angles(REGULAR, ORDER) == pytest.approx(np.full((1, 6), np.degrees(np.arccos(1 / 3))), rel=1e-12)
    slanted = np.degrees(np.arccos(1 / np.sqrt(3)))
    assert sorted(dihedral_angles(CORNER, ORDER)[0]) == pytest.approx([slanted] * 3 + [90] * 3, rel=1e-12)
    assert sorted(dihedral_angles(SQUARE, ORDER)[0]) == pytest.approx([0] * 4 + [180] * 2)


def test_edges_are_the_shortest_and_the_longest() -> None:
    corners = np.array([[0, 0, 0], [3, 0, 0], [0, 4, 0], [0, 0, 1]], dtype=float)
    assert edge_lengths(corners, ORDER).tolist() == [[1.0, 5.0]]


@given(st.integers(0, 2**32 - 1))
def test_no_measure_depends_on_where_a_tetrahedron_is_or_on_the_order_of_its_nodes(seed: int) -> None:
    random = np.random.default_rng(seed)
    corners = random.random((4, 3))
    turned, _ = np.linalg.qr(random.standard_normal((3, 3)))
    moved = corners @ turned + random.random(3)
    order = random.permutation(4).reshape(1, 4)
    for measure in (radius_ratios, dihedral_angles, edge_lengths):
        here, there = (np.sort(measure(*given).ravel()) for given in ((corners, ORDER), (moved, order)))
        np.testing.assert_allclose(there, here, rtol=1e-6, atol=1e-6)


def test_the_radius_ratio_is_gmshs_gamma() -> None:
    nodes = np.random.default_rng(3).random((40, 3))
    elements = np.arange(40).reshape(10, 4)
    with gmsh_session("tetrahedra") as gmsh:
        volume = gmsh.model.addDiscreteEntity(3)
        gmsh.model.mesh.addNodes(3, volume, np.arange(1, 41), nodes.ravel())
        gmsh.model.mesh.addElementsByType(volume, 4, np.arange(1, 11), elements.ravel() + 1)
        gamma = gmsh.model.mesh.getElementQualities(np.arange(1, 11), "gamma")
    np.testing.assert_allclose(radius_ratios(nodes, elements), np.abs(gamma), rtol=1e-9)
