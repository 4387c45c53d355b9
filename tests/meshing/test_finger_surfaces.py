"""Groups of boundary triangles, from the closed pieces of a body's boundary."""

from itertools import permutations

import numpy as np
import pytest

from taichisoft.errors import MeshError
from taichisoft.mesh import enclosed_volume
from taichisoft_meshing.pneunet_finger import surface_groups


def voxels(solid: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit cubes where `solid` says so, six tetrahedra each; x goes from 0 down to -len(solid)."""
    cells = np.argwhere(solid)
    steps = np.eye(3, dtype=int)
    elements = []
    for a, b in permutations(range(3), 2):
        path = [np.zeros(3, dtype=int), steps[a], steps[a] + steps[b], np.ones(3, dtype=int)]
        elements.append(np.stack([cells + step for step in path], axis=1))
    corners, indices = np.unique(np.vstack(elements).reshape(-1, 3), axis=0, return_inverse=True)
    tetrahedra = indices.reshape(-1, 4)
    nodes = corners * np.array([-1.0, 1.0, 1.0])
    inverted = np.linalg.det(nodes[tetrahedra[:, 1:]] - nodes[tetrahedra[:, :1]]) < 0
    tetrahedra[inverted] = tetrahedra[inverted][:, [0, 1, 3, 2]]
    return nodes, tetrahedra


def block_with_holes(*holes: tuple[int, int, int]) -> tuple[np.ndarray, np.ndarray]:
    solid = np.ones((9, 3, 3), dtype=bool)
    for hole in holes:
        solid[hole] = False
    return voxels(solid)


def test_a_body_without_a_cavity_has_a_skin_and_a_base() -> None:
    nodes, elements = block_with_holes()
    surfaces = surface_groups(nodes, elements)
    assert list(surfaces) == ["outer", "base"]
    assert enclosed_volume(nodes, surfaces["outer"]) == pytest.approx(81)
    assert len(surfaces["base"]) == 18
    assert (nodes[surfaces["base"], 0] == 0).all()


def test_the_only_cavity_has_no_number() -> None:
    nodes, elements = block_with_holes((4, 1, 1))
    surfaces = surface_groups(nodes, elements)
    assert list(surfaces) == ["outer", "base", "cavity"]
    assert enclosed_volume(nodes, surfaces["cavity"]) == pytest.approx(1)


def test_several_cavities_are_numbered_from_the_base_on() -> None:
    nodes, elements = block_with_holes((7, 1, 1), (1, 1, 1), (4, 1, 1), (5, 1, 1))
    nodes, elements = nodes[::-1], len(nodes) - 1 - elements  # their order decides nothing
    surfaces = surface_groups(nodes, elements)
    assert list(surfaces) == ["outer", "base", "cavity_0", "cavity_1", "cavity_2"]
    volumes = [enclosed_volume(nodes, surfaces[f"cavity_{number}"]) for number in range(3)]
    assert volumes == pytest.approx([1, 2, 1])
    assert [nodes[surfaces[f"cavity_{number}"], 0].max() for number in range(3)] == [-1, -4, -7]


def test_a_body_in_two_pieces_is_refused() -> None:
    nodes, elements = block_with_holes()
    with pytest.raises(MeshError, match="the body has 2 outer skins; it must be one piece of silicone"):
        surface_groups(np.vstack([nodes, nodes + 20]), np.vstack([elements, elements + len(nodes)]))
