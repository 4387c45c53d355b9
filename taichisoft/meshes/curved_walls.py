"""The walls of cavities in ten-node tetrahedra: triangles of six nodes, whose curved sides follow the elements."""

from collections.abc import Sequence

import numpy as np

from taichisoft.meshes import ten_nodes
from taichisoft.meshes.surface import MappedSurface

_SHARES = (8 - 10**0.5 + np.array([1, -1]) * (38 - 44 * 0.4**0.5) ** 0.5) / 18
POINTS = np.vstack([np.full((3, 3), share) + np.eye(3) * (1 - 3 * share) for share in _SHARES])
WEIGHTS = np.repeat(620 + np.array([1, -1]) * (213125 - 53320 * 10**0.5) ** 0.5, 3) / 7440
"""Barycentric points, (6, 3), and weights that integrate functions of fourth order over a triangle of area 1/2 exactly
(Dunavant 1985, High degree efficient symmetrical Gaussian quadrature rules for the triangle). Of that order is a shape
function times the area vector of a six-node triangle."""

SIDES = np.array([[0, 1], [1, 2], [2, 0]])
"""The corners between which the nodes 3 to 5 of a triangle lie."""

SHAPES = np.hstack([POINTS * (2 * POINTS - 1), 4 * POINTS[:, SIDES[:, 0]] * POINTS[:, SIDES[:, 1]]])
"""The six shape functions at the points, shape (6, 6)."""


def _slopes() -> np.ndarray:
    unit, (first, second) = np.eye(3), SIDES.T
    at_corners = (4 * POINTS - 1)[:, :, None] * unit
    at_middles = 4 * (POINTS[:, first, None] * unit[second] + POINTS[:, second, None] * unit[first])
    along_all = np.concatenate([at_corners, at_middles], axis=1)
    return np.ascontiguousarray(along_all[..., 1:] - along_all[..., :1])


SLOPES = _slopes()
"""Their slopes along the last two barycentric coordinates, shape (6, 6, 2)."""

HALF_SIDE = np.array([3 / 8, 3 / 4, -1 / 8])
"""Shares of a corner, the middle and the other corner in the point between the first two of a bent side."""


def curved_walls(triangles: np.ndarray, elements: np.ndarray) -> MappedSurface:
    """A closed surface that follows the curved sides of ten-node tetrahedra; closed where `triangles` are.

    Four triangles that are a side of a tetrahedron, or look like one, become the six-node triangle that they stand for.
    Another one, as in a lid that a mesh has over a hole, becomes a six-node triangle of its own: a side of it that is
    half of one of a tetrahedron is half of that parabola, and any other is straight.

    Args:
        triangles: node indices, shape (triangle_count, 3).
        elements: ten-node tetrahedra, shape (element_count, 10).

    Returns:
        The surface with triangles of six vertices, the corners before the middles of `SIDES`, shape (count, 6).
    """
    used = np.isin(elements[:, 4:], triangles)
    ends = dict(zip(elements[:, 4:][used].tolist(), elements[:, ten_nodes.SIDES][used].tolist(), strict=True))
    given = {_rolled(one) for one in triangles.tolist()}
    whole, left = [], set(given)
    for one in sorted(given):
        corners = _corners(one, ends)
        parts = {_rolled((corners[k], one[k], one[k - 1])) for k in range(3)} if corners else set()
        if corners and parts <= left:
            whole.append([*corners, *one])
            left -= {one, *parts}
    return _surface(whole, sorted(left), ends)


def enclosed_volume_of_walls(vertices: np.ndarray, triangles: np.ndarray) -> float:
    """Signed volume [mm^3] inside a closed surface of six-node triangles (count, 6), positive if it faces outward."""
    nodes = (vertices - vertices.mean(axis=0))[triangles]
    place = np.einsum("qa,tai->tqi", SHAPES, nodes)
    along = np.einsum("qad,tai->tqdi", SLOPES, nodes)
    area = np.cross(along[:, :, 0], along[:, :, 1])
    return float(np.einsum("q,tqi,tqi->", WEIGHTS, place, area) / 3.0)


def _corners(middles: tuple[int, ...], ends: dict[int, list[int]]) -> tuple[int, ...] | None:
    """The corners 0, 1, 2 of a triangle whose sides 01, 12, 20 have these middle nodes, or None."""
    sides = [set(ends.get(node, ())) for node in middles]
    shared = [sides[k - 1] & sides[k] for k in range(3)]
    if any(len(one) != 1 for one in shared):
        return None
    corners = tuple(one.pop() for one in shared)
    return corners if len(set(corners)) == 3 else None


def _rolled(triangle: Sequence[int]) -> tuple[int, ...]:
    """The same triangle, its least node first."""
    least = triangle.index(min(triangle))
    return (*triangle[least:], *triangle[:least])


def _surface(whole: list[list[int]], left: list[tuple[int, ...]], ends: dict[int, list[int]]) -> MappedSurface:
    """Six-node triangles of nodes, and triangles whose sides get points of their own."""
    nodes = sorted({node for one in (*whole, *left) for node in one})
    place = {node: vertex for vertex, node in enumerate(nodes)}
    carried = [[node] * 3 for node in nodes]
    weights = [[1.0, 0.0, 0.0]] * len(nodes)
    points: dict[tuple[int, int], int] = {}

    def between(a: int, b: int) -> int:
        a, b = min(a, b), max(a, b)
        if (a, b) not in points:
            points[a, b] = len(carried)
            corner, middle = (a, b) if a in ends.get(b, ()) else (b, a)
            if corner in ends.get(middle, ()):
                carried.append([corner, middle, sum(ends[middle]) - corner])
                weights.append(HALF_SIDE.tolist())
            else:
                carried.append([a, b, b])
                weights.append([0.5, 0.5, 0.0])
        return points[a, b]

    triangles = [[place[node] for node in one] for one in whole]
    triangles += [[*(place[node] for node in one), *(between(one[a], one[b]) for a, b in SIDES)] for one in left]
    columns = 3 if points else 1
    return MappedSurface(
        np.array(carried, dtype=np.int32)[:, :columns],
        np.array(weights)[:, :columns],
        np.array(triangles, dtype=np.int32).reshape(-1, 6),
    )
