"""How well shaped tetrahedra are."""

import numpy as np
import pytest

from taichisoft_meshing.quality import longest_edges, radius_ratios

ORDER = np.array([[0, 1, 2, 3]])


def test_the_regular_tetrahedron_has_the_ratio_1_in_any_size() -> None:
    corners = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], dtype=float)
    for size in (1e-3, 1.0, 1e3):
        assert radius_ratios(size * corners, ORDER) == pytest.approx([1], rel=1e-12)
        assert longest_edges(size * corners, ORDER) == pytest.approx([size * np.sqrt(8)], rel=1e-12)


def test_the_corner_of_a_cube_has_the_ratio_of_its_two_spheres() -> None:
    """Circumscribed sqrt(3)/2; inscribed 3 V / S = (1/2) / (3/2 + sqrt(3)/2) = 1 / (3 + sqrt(3))."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
    expected = 3 / (3 + np.sqrt(3)) / (np.sqrt(3) / 2)
    assert radius_ratios(corners, ORDER) == pytest.approx([expected], rel=1e-12)


def test_a_flat_tetrahedron_has_the_ratio_0() -> None:
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
    line = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]], dtype=float)
    assert radius_ratios(square, ORDER) == pytest.approx([0], abs=1e-15)
    assert radius_ratios(line, ORDER) == pytest.approx([0], abs=1e-15)
