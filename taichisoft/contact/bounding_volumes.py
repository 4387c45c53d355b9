"""A tree of boxes over the triangles of every surface, built once; only the boxes follow the moving vertices."""

from dataclasses import dataclass

import numpy as np

LEAF_TRIANGLES = 8


@dataclass(frozen=True)
class BoundingVolumes:
    """Binary trees of axis-parallel boxes, one per surface, their nodes one after the other in one set of arrays.

    Nodes stand in depth-first order: the first child of node n is n + 1, and behind its last descendant stands
    `escape[n]`, where a search that passes n over goes on without a stack. For a leaf that is n + 1.

    Every vertex and every edge that can touch belongs to one leaf, whose box holds it; what belongs to a node stands
    in lists: those of node n are `vertex[vertex_start[n] : vertex_start[n + 1]]` and the like, empty for inner nodes.

    Attributes:
        root: first node of each surface, and the number of nodes, shape (surface_count + 1,).
        escape: the node behind the last descendant, shape (node_count,).
        triangle_start, triangle: triangles of each leaf.
        corner_start, corner: vertices of these triangles, each once.
        vertex_start, vertex: vertices that belong to each leaf and can touch.
        edge_start, edge: edges that belong to each leaf and can touch.
        lower, upper: corners of the boxes now [mm], shape (node_count, 3).
    """

    root: np.ndarray
    escape: np.ndarray
    triangle_start: np.ndarray
    triangle: np.ndarray
    corner_start: np.ndarray
    corner: np.ndarray
    vertex_start: np.ndarray
    vertex: np.ndarray
    edge_start: np.ndarray
    edge: np.ndarray
    lower: np.ndarray
    upper: np.ndarray

    @property
    def most_leaves(self) -> int:
        """Leaves of the surface that has most of them: a full binary tree has one more leaf than inner nodes."""
        return int(np.diff(self.root).max() + 1) // 2


def build(
    triangle_range: np.ndarray,
    triangles: np.ndarray,
    position: np.ndarray,
    first_triangle: np.ndarray,
    vertex_is_feature: np.ndarray,
    edge_triangles: np.ndarray,
    edge_is_feature: np.ndarray,
) -> BoundingVolumes:
    """Trees for surfaces at these positions [mm]; see ContactSurfaces for the arrays. Their boxes are still empty."""
    centroid = position[triangles].mean(axis=1)
    root = [0]
    escape: list[int] = []
    owned: list[np.ndarray] = []
    for start, stop in triangle_range:
        _grow(np.arange(start, stop), centroid, escape, owned)
        root.append(len(escape))
    leaf_of_triangle = np.empty(len(triangles), dtype=np.int64)
    for node, some in enumerate(owned):
        leaf_of_triangle[some] = node
    node_count = len(escape)
    corner = np.unique(np.column_stack([np.repeat(leaf_of_triangle, 3), triangles.ravel()]), axis=0)
    vertex, edge = np.flatnonzero(vertex_is_feature), np.flatnonzero(edge_is_feature)
    return BoundingVolumes(
        np.array(root, dtype=np.int32),
        np.array(escape, dtype=np.int32),
        *_lists(leaf_of_triangle, np.arange(len(triangles)), node_count),
        *_lists(corner[:, 0], corner[:, 1], node_count),
        *_lists(leaf_of_triangle[first_triangle[vertex]], vertex, node_count),
        *_lists(leaf_of_triangle[edge_triangles[edge, 0]], edge, node_count),
        np.zeros((node_count, 3)),
        np.zeros((node_count, 3)),
    )


def _grow(some: np.ndarray, centroid: np.ndarray, escape: list[int], owned: list[np.ndarray]) -> None:
    """Append the subtree over some triangles, halved at the median of the longest extent of their centroids."""
    node = len(escape)
    escape.append(-1)
    if len(some) <= LEAF_TRIANGLES:
        owned.append(some)
    else:
        owned.append(some[:0])
        axis = int(np.ptp(centroid[some], axis=0).argmax())
        ordered = some[np.argsort(centroid[some, axis], kind="stable")]
        # A whole number of full leaves on the first side: all leaves but one are full.
        half = -(-len(some) // (2 * LEAF_TRIANGLES)) * LEAF_TRIANGLES
        _grow(ordered[:half], centroid, escape, owned)
        _grow(ordered[half:], centroid, escape, owned)
    escape[node] = len(escape)


def _lists(owner: np.ndarray, members: np.ndarray, node_count: int) -> tuple[np.ndarray, np.ndarray]:
    """Start of each node's list, shape (node_count + 1,), and the members in the order of their owners."""
    order = np.argsort(owner, kind="stable")
    start = np.searchsorted(owner[order], np.arange(node_count + 1))
    return start.astype(np.int32), members[order].astype(np.int32)
