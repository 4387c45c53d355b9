"""Meshes of ten-node tetrahedra: with nodes in the middles of the sides of four-node ones."""

import numpy as np

from taichisoft.meshes.ten_nodes import SIDES
from taichisoft.meshes.volume_mesh import VolumeMesh, four_triangles


def with_middle_nodes(mesh: VolumeMesh) -> VolumeMesh:
    """The mesh with straight-sided ten-node tetrahedra, its own nodes first; a mesh that has them is returned as it is.

    Each triangle of a surface becomes four; of one with sides that no tetrahedron has, only the others are halved.
    """
    if mesh.elements.shape[1] == 10:
        return mesh
    node_count = len(mesh.nodes)
    sides = np.sort(mesh.elements[:, SIDES], axis=2).astype(np.int64)
    keys, side = np.unique(sides @ [node_count, 1], return_inverse=True)
    ends = np.column_stack(np.divmod(keys, node_count))

    def quartered(triangles: np.ndarray) -> np.ndarray:
        pairs = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2).astype(np.int64) @ [node_count, 1]
        place = np.minimum(np.searchsorted(keys, pairs), len(keys) - 1)
        middle = np.where(keys[place] == pairs, node_count + place, -1)
        whole = (middle >= 0).all(axis=1)
        parts = [four_triangles(np.hstack([triangles, middle])[whole])]
        parts += [_halved(three, its) for three, its in zip(triangles[~whole], middle[~whole], strict=True)]
        return np.vstack(parts).astype(np.int32)

    return VolumeMesh(
        mesh.source,
        np.vstack([mesh.nodes, mesh.nodes[ends].mean(axis=1)]),
        np.hstack([mesh.elements, node_count + side.reshape(-1, 6)]),
        {name: quartered(triangles) for name, triangles in mesh.surface_groups.items()},
        mesh.element_groups,
    )


def _halved(triangle: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """A triangle in parts: its sides 01, 12, 20 have nodes in the middle where `middle` is not -1, but not all."""
    whole = int(np.argmin(middle))  # the parts meet in a corner of a side that has none
    ring = [node for k in range(3) for node in (triangle[(whole + k) % 3], middle[(whole + k) % 3]) if node >= 0]
    return np.array([[ring[0], *ring[k : k + 2]] for k in range(1, len(ring) - 1)])
