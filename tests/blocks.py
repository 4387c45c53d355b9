"""Meshes of boxes, made in code."""

from itertools import permutations

import numpy as np

from taichisoft import VolumeMesh
from taichisoft.mesh import boundary_triangles


def make_block(cells: tuple[int, int, int], size: tuple[float, float, float], hollow: bool = False) -> VolumeMesh:
    """A box about the origin of `cells` boxes, each cut into six tetrahedra; `hollow` leaves out the inner boxes.

    The walls of the hollow are the surface group "cavity", facing from the air into the material.
    """
    grid = np.stack(np.meshgrid(*(np.arange(n + 1) for n in cells), indexing="ij"), axis=-1).reshape(-1, 3)
    strides = np.array([(cells[1] + 1) * (cells[2] + 1), cells[2] + 1, 1])
    corner = np.stack(np.meshgrid(*(np.arange(n) for n in cells), indexing="ij"), axis=-1).reshape(-1, 3)
    if hollow:
        corner = corner[((corner == 0) | (corner == np.array(cells) - 1)).any(axis=1)]
    paths = []  # of each tetrahedron along three edges from the lowest to the highest corner of a box
    for order in permutations(range(3)):
        steps = np.cumsum([np.zeros(3, dtype=int), *np.eye(3, dtype=int)[list(order)]], axis=0)
        even = np.linalg.det(np.eye(3)[list(order)]) > 0
        paths.append(steps if even else steps[[0, 2, 1, 3]])
    elements = ((corner[:, None, None, :] + np.array(paths)) @ strides).reshape(-1, 4)
    used, elements = np.unique(elements, return_inverse=True)
    elements = elements.reshape(-1, 4)
    nodes = (grid[used] / cells - 0.5) * size
    groups = {}
    if hollow:
        walls = boundary_triangles(elements)
        inner = (np.abs(nodes[walls]) < 0.5 * np.array(size) * (1 - 1e-9)).all(axis=(1, 2))
        groups["cavity"] = walls[inner][:, ::-1]
    return VolumeMesh("block", nodes, elements, groups).check()


def block_hexahedra(cells: tuple[int, int, int]) -> np.ndarray:
    """The boxes of `make_block` as hexahedra of its nodes, shape (count, 8)."""
    strides = np.array([(cells[1] + 1) * (cells[2] + 1), cells[2] + 1, 1])
    lowest = np.stack(np.meshgrid(*(np.arange(n) for n in cells), indexing="ij"), axis=-1).reshape(-1, 3)
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]])
    return np.asarray((lowest[:, None] + corners) @ strides)
