"""Where closed surfaces go through themselves or each other, or touch.

Two triangles that cross have an edge of one that goes through the other, so edges are cut with triangles that share no
vertex with them. Triangles that lie upon each other have no such edge, but a vertex of one lies in the other.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np

from taichisoft_meshing.bodies.surface_repair import NEAR, diagonal

# Of the diagonal: a vertex this near to a triangle of the same shell lies in it. Fine meshes have thin triangles, so
# NEAR, the distance at which different shells touch, would be too large.
SAME_SHELL_NEAR = 1e-9

ROUND_OFF = 1e-9  # of barycentric weights: no edge slips through between two triangles
FOLDED = 1e-6  # [rad] between two neighbours that lie upon each other
FEW_EDGES = 16  # are compared with each triangle around
LEAVES_AT_A_TIME = 256


@dataclass(frozen=True)
class Crossings:
    """Pairs of triangles that cross or touch.

    Attributes:
        triangles: the two triangles of each pair, the lower number first, each pair once, shape (count, 2).
        places: a point in both [mm], shape (count, 3).
    """

    triangles: np.ndarray
    places: np.ndarray


def find_crossings(vertices: np.ndarray, triangles: np.ndarray, shell: np.ndarray) -> Crossings:
    """Cut all triangles of some closed shells with each other.

    Args:
        vertices: [mm], shape (vertex_count, 3); no two shells have one in common.
        triangles: vertex indices, shape (triangle_count, 3).
        shell: number of the shell that each triangle belongs to, shape (triangle_count,).
    """
    edges, first, inverse = np.unique(
        np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0, return_index=True, return_inverse=True
    )
    own = first // 3
    found = [_folds(vertices, triangles, np.argsort(inverse.ravel(), kind="stable").reshape(-1, 2) // 3)]
    near = NEAR * diagonal(vertices)
    for edge, triangle in _meeting_boxes(vertices[edges], vertices[triangles], near):
        apart = (edges[edge][:, :, None] != triangles[triangle][:, None, :]).all(axis=(1, 2))
        edge, triangle = edge[apart], triangle[apart]
        reach = np.where(shell[own[edge]] == shell[triangle], SAME_SHELL_NEAR / NEAR, 1.0) * near
        place = _common_point(vertices[edges[edge]], vertices[triangles[triangle]], reach)
        hit = np.isfinite(place).all(axis=1)
        found.append((np.column_stack([own[edge], triangle])[hit], place[hit]))
    pairs = np.sort(np.vstack([pairs for pairs, _ in found]), axis=1)
    pairs, once = np.unique(pairs, axis=0, return_index=True)
    return Crossings(pairs, np.vstack([places for _, places in found])[once])


def _folds(vertices: np.ndarray, triangles: np.ndarray, neighbours: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Neighbours that lie upon each other: across their common edge the surface turns back."""
    corners = vertices[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    one, other = normals[neighbours[:, 0]], normals[neighbours[:, 1]]
    folded = (np.linalg.norm(np.cross(one, other), axis=1) < FOLDED) & (np.einsum("nd,nd->n", one, other) < 0)
    return neighbours[folded], corners[neighbours[folded, 0]].mean(axis=1)


def _meeting_boxes(edges: np.ndarray, triangles: np.ndarray, near: float) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Indices of edges and triangles whose boxes meet, some at a time.

    Args:
        edges: ends [mm], shape (edge_count, 2, 3).
        triangles: corners [mm], shape (triangle_count, 3, 3).
        near: boxes of edges grow by this [mm].
    """
    edge_lower, edge_upper = edges.min(axis=1) - near, edges.max(axis=1) + near
    lower, upper = triangles.min(axis=1), triangles.max(axis=1)

    def search(some: np.ndarray, around: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Halve the edges, and keep the triangles that meet the box of all of them, until few are left."""
        around = around[_meet(lower[around], upper[around], edge_lower[some].min(axis=0), edge_upper[some].max(axis=0))]
        if len(some) > FEW_EDGES:
            yield from search(some[: len(some) // 2], around)
            yield from search(some[len(some) // 2 :], around)
        else:
            edge, triangle = np.nonzero(
                _meet(edge_lower[some][:, None], edge_upper[some][:, None], lower[around], upper[around])
            )
            yield some[edge], around[triangle]

    leaves = search(_near_each_other(edge_lower, edge_upper), np.arange(len(triangles)))
    while some_leaves := list(islice(leaves, LEAVES_AT_A_TIME)):
        yield np.concatenate([edge for edge, _ in some_leaves]), np.concatenate([found for _, found in some_leaves])


def _near_each_other(lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """An order of boxes in which those alike in size stand together, and among them those that are near each other."""
    sizes = (upper - lower).max(axis=1)
    octave = np.floor(np.log2(sizes / sizes.max())).astype(np.int64)
    centres = (lower + upper) / 2
    extent = np.ptp(centres, axis=0).max()
    cells = ((centres - centres.min(axis=0)) / (extent if extent > 0 else 1.0) * 1023).astype(np.int64)
    place = np.zeros(len(cells), dtype=np.int64)
    for bit in range(10):  # the bits of x, y and z in turn: cells that differ in low bits only are near (Morton)
        for axis in range(3):
            place |= ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
    return np.lexsort((place, octave))


def _meet(lower: np.ndarray, upper: np.ndarray, other_lower: np.ndarray, other_upper: np.ndarray) -> np.ndarray:
    """Whether boxes with these corners [mm] in the last axis meet."""
    return np.all((lower <= other_upper) & (other_lower <= upper), axis=-1)


def _common_point(ends: np.ndarray, corners: np.ndarray, near: np.ndarray) -> np.ndarray:
    """A point [mm] of each edge in its triangle, or nearer to it than `near` [mm]; NaN where there is none."""
    begin, end = np.moveaxis(ends, 1, 0)
    along = end - begin
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    heights = np.einsum("ned,nd->ne", ends - corners[:, :1], normal)
    rise = heights[:, 0] - heights[:, 1]
    crosses = (heights.min(axis=1) <= 0) & (heights.max(axis=1) >= 0) & (rise != 0)
    share = np.divide(heights[:, 0], rise, out=np.zeros_like(rise), where=crosses)
    candidates = (
        (begin + share[:, None] * along, crosses),
        (begin, np.abs(heights[:, 0]) <= near),
        (end, np.abs(heights[:, 1]) <= near),
    )
    place = np.full_like(begin, np.nan)
    for point, in_plane in candidates:
        hit = in_plane & _inside(point, corners)
        place[hit] = point[hit]
    return place


def _inside(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Whether the projection of each point on the plane of its triangle lies in the triangle."""
    side, other_side = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    offset = points - corners[:, 0]
    normal = np.cross(side, other_side)
    square = np.einsum("nd,nd->n", normal, normal)
    second = np.einsum("nd,nd->n", np.cross(offset, other_side), normal) / square
    third = np.einsum("nd,nd->n", np.cross(side, offset), normal) / square
    return (second >= -ROUND_OFF) & (third >= -ROUND_OFF) & (second + third <= 1 + ROUND_OFF)
