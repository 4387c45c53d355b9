"""Bounding volume trees over the triangles of every surface: built once, then only their boxes are updated."""

import numpy as np

from taichisoft.contact.kernels.box_trees import Trees
from taichisoft.contact.kernels.surface_vertices import Surfaces

LEAF_TRIANGLES = 8


def build(
    topology: Surfaces,
    triangle_range: np.ndarray,
    position: np.ndarray,
    vertex_is_feature: np.ndarray,
    edge_is_feature: np.ndarray,
) -> Trees:
    """Build the trees of surfaces with vertices at `position` [mm]; see `ContactSurfaces` for the arrays."""
    centroid = position[topology.triangles].mean(axis=1)
    root = [0]
    escape: list[int] = []
    owned: list[np.ndarray] = []
    for start, stop in triangle_range:
        _grow(np.arange(start, stop), centroid, escape, owned)
        root.append(len(escape))
    leaf_of_triangle = np.empty(len(topology.triangles), dtype=np.int64)
    for node, triangles in enumerate(owned):
        leaf_of_triangle[triangles] = node
    node_count = len(escape)
    corner = np.unique(np.column_stack([np.repeat(leaf_of_triangle, 3), topology.triangles.ravel()]), axis=0)
    vertex, edge = np.flatnonzero(vertex_is_feature), np.flatnonzero(edge_is_feature)
    return Trees(
        np.array(root, dtype=np.int32),
        np.array(escape, dtype=np.int32),
        *_lists(leaf_of_triangle, np.arange(len(topology.triangles)), node_count),
        *_lists(corner[:, 0], corner[:, 1], node_count),
        *_lists(leaf_of_triangle[topology.first_triangle[vertex]], vertex, node_count),
        *_lists(leaf_of_triangle[topology.edge_triangles[edge, 0]], edge, node_count),
    )


def most_leaves(trees: Trees) -> int:
    """Largest number of leaves of a surface: a full binary tree has one more leaf than inner nodes."""
    return int(np.diff(trees.root).max(initial=0) + 1) // 2


def _grow(triangles: np.ndarray, centroid: np.ndarray, escape: list[int], owned: list[np.ndarray]) -> None:
    """Append the subtree over `triangles`, halved at the median of the longest extent of their centroids."""
    node = len(escape)
    escape.append(-1)
    if len(triangles) <= LEAF_TRIANGLES:
        owned.append(triangles)
    else:
        owned.append(triangles[:0])
        axis = int(np.ptp(centroid[triangles], axis=0).argmax())
        ordered = triangles[np.argsort(centroid[triangles, axis], kind="stable")]
        # A whole number of full leaves on the first side: all leaves but one are full.
        half = -(-len(triangles) // (2 * LEAF_TRIANGLES)) * LEAF_TRIANGLES
        _grow(ordered[:half], centroid, escape, owned)
        _grow(ordered[half:], centroid, escape, owned)
    escape[node] = len(escape)


def _lists(owner: np.ndarray, members: np.ndarray, node_count: int) -> tuple[np.ndarray, np.ndarray]:
    """Start of each node's list, shape (node_count + 1,), and the members in the order of their owners."""
    order = np.argsort(owner, kind="stable")
    start = np.searchsorted(owner[order], np.arange(node_count + 1))
    return start.astype(np.int32), members[order].astype(np.int32)
