"""Edges that go through triangles or touch them: the search for candidates, and the common points of pairs."""

from collections.abc import Iterator
from itertools import islice

import numpy as np

ROUND_OFF = 1e-9
"""Error of barycentric weights that is tolerated, so that no edge slips through between two triangles [-]."""
FEW_EDGES = 32
"""Number of edges that are no longer halved, but compared with each triangle around."""
LEAVES_AT_A_TIME = 256
"""Number of such groups of edges whose pairs are given at a time, which bounds the memory."""


def boxes_meet(lower: np.ndarray, upper: np.ndarray, other_lower: np.ndarray, other_upper: np.ndarray) -> np.ndarray:
    """Whether axis-aligned boxes meet; the last axis of the arrays has the three coordinates of a corner [mm]."""
    return np.all((lower <= other_upper) & (other_lower <= upper), axis=-1)


def pairs_of_meeting_boxes(
    edges: np.ndarray, triangles: np.ndarray, near: float = 0.0
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Find the edges and triangles whose axis-aligned boxes meet, each pair once, some pairs at a time.

    Args:
        edges: ends [mm], shape (edge_count, 2, 3).
        triangles: corners [mm], shape (triangle_count, 3, 3).
        near: length by which the boxes of edges grow on every side [mm].

    Yields:
        Edge indices and triangle indices, both of shape (pair_count,).
    """
    edge_lower, edge_upper = edges.min(axis=1) - near, edges.max(axis=1) + near
    lower, upper = triangles.min(axis=1), triangles.max(axis=1)

    def search(some: np.ndarray, around: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Halve the edges, and keep the triangles that meet the box of all of them, until few are left."""
        around = around[
            boxes_meet(lower[around], upper[around], edge_lower[some].min(axis=0), edge_upper[some].max(axis=0))
        ]
        if not len(around):
            return
        if len(some) > FEW_EDGES:
            yield from search(some[: len(some) // 2], around)
            yield from search(some[len(some) // 2 :], around)
        else:
            edge, triangle = np.nonzero(
                boxes_meet(edge_lower[some][:, None], edge_upper[some][:, None], lower[around], upper[around])
            )
            yield some[edge], around[triangle]

    reached = np.flatnonzero(boxes_meet(edge_lower, edge_upper, lower.min(axis=0), upper.max(axis=0)))
    if not len(reached):
        return
    order = reached[_near_each_other(edge_lower[reached], edge_upper[reached])]
    leaves = search(order, np.arange(len(triangles)))
    while some_leaves := list(islice(leaves, LEAVES_AT_A_TIME)):
        yield np.concatenate([edge for edge, _ in some_leaves]), np.concatenate([found for _, found in some_leaves])


def common_points(edges: np.ndarray, triangles: np.ndarray, near: np.ndarray | float = 0.0) -> np.ndarray:
    """Find the point where each edge goes through its triangle, or an end of the edge that lies in the triangle.

    Args:
        edges: ends [mm], shape (pair_count, 2, 3).
        triangles: corners [mm], shape (pair_count, 3, 3).
        near: distance from the triangle's plane up to which an end lies in it [mm], one or shape (pair_count,).

    Returns:
        Points [mm], shape (pair_count, 3); NaN where edge and triangle share none, or the triangle has no area.
    """
    begin, end = np.moveaxis(edges, 1, 0)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    points = np.full_like(begin, np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):  # a triangle of no area has no point
        units = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        heights = np.einsum("ned,nd->ne", edges - triangles[:, :1], units)
        rise = heights[:, 0] - heights[:, 1]
        crosses = (heights.min(axis=1) <= 0) & (heights.max(axis=1) >= 0) & (rise != 0)
        share = np.divide(heights[:, 0], rise, out=np.zeros_like(rise), where=crosses)
        for point, in_plane in (
            (begin + share[:, None] * (end - begin), crosses),
            (begin, np.abs(heights[:, 0]) <= near),
            (end, np.abs(heights[:, 1]) <= near),
        ):
            hit = in_plane & _inside(point, triangles, normals)
            points[hit] = point[hit]
    return points


def _inside(points: np.ndarray, triangles: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Whether the projection of each point on the plane of its triangle lies in the triangle, shape (pair_count,)."""
    side, other_side = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    offset = points - triangles[:, 0]
    square = np.einsum("nd,nd->n", normals, normals)
    second = np.einsum("nd,nd->n", np.cross(offset, other_side), normals) / square
    third = np.einsum("nd,nd->n", np.cross(side, offset), normals) / square
    return (second >= -ROUND_OFF) & (third >= -ROUND_OFF) & (second + third <= 1 + ROUND_OFF)


def _near_each_other(lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Order boxes so that boxes of similar size stand together, and among these boxes that are near each other."""
    sizes = (upper - lower).max(axis=1)
    octave = np.frexp(sizes / (sizes.max() or 1.0))[1]  # also defined for edges of no length
    centres = (lower + upper) / 2
    extent = np.ptp(centres, axis=0).max()
    cells = ((centres - centres.min(axis=0)) / (extent if extent > 0 else 1.0) * 1023).astype(np.int64)
    place = np.zeros(len(cells), dtype=np.int64)
    for bit in range(10):  # the bits of x, y and z in turn: cells that differ in low bits only are near (Morton)
        for axis in range(3):
            place |= ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
    return np.lexsort((place, octave))
