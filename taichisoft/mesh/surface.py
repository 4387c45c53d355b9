"""Triangulated surfaces: those that move with nodes, and whether a surface is closed and which way it faces."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice, pairwise
from typing import Self

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from taichisoft.base.text import warn_caller
from taichisoft.errors import MeshError
from taichisoft.mesh import volume_mesh

# Normals of a triangulated surface at its vertices, and whether it can be taken as a smooth one.

SHARPEST = 40.0  # [degrees] between two triangles of a surface that stands for a smooth one
# A triangle is curved in both directions if its corners' normals span at least this share of the solid angle that they
# would on a ball of the same angles; on a cylinder they span none.
CURVED = 1e-3


def vertex_normals(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Unit normals at the vertices, shape (vertex_count, 3): means of the outward triangles', weighted by their
    angles.
    """
    corners = vertices[triangles]
    faces = _unit(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    total = np.zeros_like(vertices)
    for corner in range(3):
        one = _unit(corners[:, (corner + 1) % 3] - corners[:, corner])
        other = _unit(corners[:, (corner + 2) % 3] - corners[:, corner])
        angle = np.arccos(np.clip((one * other).sum(axis=1), -1.0, 1.0))
        np.add.at(total, triangles[:, corner], angle[:, None] * faces)
    return _unit(total)


def refuse_unsmooth(vertices: np.ndarray, triangles: np.ndarray, source: str) -> None:
    """Refuse a surface that does not stand for a smooth one, curved in both directions, as a ball or an egg."""
    corners = vertices[triangles]
    faces = _unit(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    edges = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    order = np.lexsort(edges.T)
    same = (edges[order[1:]] == edges[order[:-1]]).all(axis=1)
    cosine = (faces[order[1:][same] // 3] * faces[order[:-1][same] // 3]).sum(axis=1)
    turn = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
    if (turn > SHARPEST).any():
        raise MeshError(
            f"{source}: the surface turns by up to {turn.max():.0f} degrees, by more than {SHARPEST:.0f} at "
            f"{(turn > SHARPEST).sum()} edges; mesh it more finely, or leave smooth out"
        )
    normals = vertex_normals(vertices, triangles)[triangles]
    spread = np.linalg.norm(normals - np.roll(normals, 1, axis=1), axis=2)
    spanned = np.abs(np.linalg.det(normals))
    unfit = int((spanned <= CURVED * spread.max(axis=1) ** 2 + 1e-12).sum())
    if unfit:
        raise MeshError(
            f"{source}: {unfit} of {len(triangles)} triangles are flat or curved in one direction only; a surface "
            "that is taken as smooth is curved in both everywhere, as a ball or an egg is"
        )


def _unit(vectors: np.ndarray) -> np.ndarray:
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    unit: np.ndarray = vectors / np.where(lengths > 0.0, lengths, 1.0)
    return unit


# Edges that go through triangles or touch them: the search for candidates, and the common points of pairs.

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

    def search(part: np.ndarray, around: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Halve the edges, and keep the triangles that meet the box of all of them, until few are left."""
        around = around[
            boxes_meet(lower[around], upper[around], edge_lower[part].min(axis=0), edge_upper[part].max(axis=0))
        ]
        if not len(around):
            return
        if len(part) > FEW_EDGES:
            yield from search(part[: len(part) // 2], around)
            yield from search(part[len(part) // 2 :], around)
        else:
            edge, triangle = np.nonzero(
                boxes_meet(edge_lower[part][:, None], edge_upper[part][:, None], lower[around], upper[around])
            )
            yield part[edge], around[triangle]

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


# Sections by a plane: triangles and tetrahedra cut in two, with what is given at their corners, and closed caps.

TERM = re.compile(r"([+-]?)(\d+\.?\d*|\.\d+)?\*?([xyz])")
PLANE = re.compile(r"([^<>=]+)([<>=])([+-]?[0-9.]+(?:e[+-]?\d+)?)")


@dataclass(frozen=True)
class SectionPlane:
    """A plane that cuts things in two; the part against the normal is kept.

    Attributes:
        normal: unit normal [-].
        offset: distance of the plane from the origin, along the normal [mm].
        is_turned: whether the plane turns its normal to the eye (`facing`).
    """

    normal: tuple[float, float, float]
    offset: float
    is_turned: bool

    @classmethod
    def parse(cls, text: str) -> Self:
        """The plane of "y=0", of which an eye sees the far part; "y<0" keeps this part; "x+2*y=30" is aslant [mm].

        Raises:
            MeshError: the text is written otherwise.
        """
        parts = PLANE.fullmatch(text.replace(" ", ""))
        terms = list(TERM.finditer(parts[1])) if parts else []
        normal = np.zeros(3)
        for term in terms:
            normal["xyz".index(term[3])] += float(f"{term[1]}{term[2] or 1}")
        try:
            offset = float(parts[3]) if parts else np.nan
        except ValueError:
            offset = np.nan
        length = float(np.linalg.norm(normal))
        if parts is None or "".join(term[0] for term in terms) != parts[1] or not length > 0 or not abs(offset) < 1e9:
            raise MeshError(f"section '{text}' must be a plane in mm, as y=0, z<12.5 (what is kept) or x+2*y=30")
        sign = -1.0 if parts[2] == ">" else 1.0
        x, y, z = (float(part) for part in sign * normal / length)
        return cls((x, y, z), sign * offset / length, parts[2] == "=")

    def facing(self, eye: np.ndarray) -> Self:
        """The plane with its normal towards an eye [mm], shape (3,), unless it says itself which part is kept."""
        if not self.is_turned or self.height(eye) >= 0.0:
            return self
        x, y, z = self.normal
        return replace(self, normal=(-x, -y, -z), offset=-self.offset)

    def height(self, points: np.ndarray) -> np.ndarray:
        """Distance of points [mm], shape (..., 3), from the plane, along its normal [mm], shape (...)."""
        return points @ np.array(self.normal) - self.offset


def split_triangles(corners: np.ndarray, height: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Split triangles where a quantity that is linear in them is zero.

    Args:
        corners: what belongs to each corner, positions and anything else that is linear, shape (count, 3, width).
        height: the quantity at the corners, shape (count, 3).

    Returns:
        Triangles where it is negative or zero, those where it is positive, each (.., 3, width), in the sense of the
        triangles that they come from; and the sides that they share, shape (.., 2, width).
    """
    above = height > 0.0
    count = above.sum(axis=1)
    parts = {False: [corners[count == 0]], True: [corners[count == 3]]}
    sides = [corners[:0, :2]]
    for number, alone in ((1, True), (2, False)):
        cut = np.flatnonzero(count == number)
        turn = (np.argmax(above[cut] == alone, axis=1)[:, None] + np.arange(3)) % 3  # the corner that is alone first
        a, b, c = np.moveaxis(corners[cut[:, None], turn], 1, 0)
        ha, hb, hc = height[cut[:, None], turn].T
        ab, ac = a + (ha / (ha - hb))[:, None] * (b - a), a + (ha / (ha - hc))[:, None] * (c - a)
        parts[alone].append(np.stack([a, ab, ac], axis=1))
        parts[not alone] += [np.stack([ab, b, c], axis=1), np.stack([ab, c, ac], axis=1)]
        sides.append(np.stack([ab, ac], axis=1))
    return np.concatenate(parts[False]), np.concatenate(parts[True]), np.concatenate(sides)


def cut_tetrahedra(
    corners: np.ndarray, height: np.ndarray, normal: tuple[float, float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """The section of tetrahedra by the plane where a quantity that is linear in them is zero.

    Args:
        corners: what belongs to each corner, the position [mm] first, shape (count, 4, width).
        height: the quantity at the corners, such as the distance from the plane, shape (count, 4).
        normal: unit normal of the plane, to which the triangles turn their front.

    Returns:
        Triangles with what is interpolated at their corners, shape (.., 3, width), and the tetrahedron of each, (..,).
    """
    above = height > 0.0
    count = above.sum(axis=1)
    cut = np.flatnonzero((count > 0) & (count < 4))
    order = np.argsort(above[cut] == (count[cut] < 3)[:, None], axis=1, kind="stable")[:, ::-1]
    points, heights = corners[cut[:, None], order], height[cut[:, None], order]

    def crossing(cells: np.ndarray, first: int, second: int) -> np.ndarray:
        share = heights[cells, first] / (heights[cells, first] - heights[cells, second])
        start: np.ndarray = points[cells, first]
        return start + share[:, None] * (points[cells, second] - start)

    halves = count[cut] == 2  # two corners on either side: a quadrilateral; else the first one is alone
    single, double = np.flatnonzero(~halves), np.flatnonzero(halves)
    tips = [crossing(single, 0, second) for second in (1, 2, 3)]
    ring = [crossing(double, *edge) for edge in ((0, 2), (0, 3), (1, 3), (1, 2))]
    triangles = np.concatenate(
        [np.stack(tips, axis=1), np.stack(ring[:3], axis=1), np.stack([ring[0], ring[2], ring[3]], axis=1)]
    )
    return facing_triangles(triangles, normal), np.concatenate([cut[single], cut[double], cut[double]])


def closed_cap(sides: np.ndarray, normal: tuple[float, float, float]) -> np.ndarray:
    """Fill the outline that a plane cuts out of closed surfaces, by the even-odd rule: also outlines within others.

    The outline is divided into trapezoids between the heights of its corners, so that
    its sides may come in any order.

    Args:
        sides: the sides of the outline, in any order [mm], shape (side_count, 2, 3).
        normal: unit normal of the plane, to which the triangles turn their front.

    Returns:
        Corners of triangles [mm], shape (.., 3, 3).
    """
    if not len(sides):
        return np.zeros((0, 3, 3))
    axes = np.linalg.svd(np.array(normal)[None])[2]
    across, along, through = axes[1], axes[2], axes[0]
    x, y = sides @ across, sides @ along
    depth = float((sides @ through).mean())
    levels = np.unique(np.round(y, 7))
    trapezoids = []
    for low, high in pairwise(levels):
        crossed = np.flatnonzero((y.min(axis=1) < (low + high) / 2) & (y.max(axis=1) > (low + high) / 2))
        slope = (x[crossed, 1] - x[crossed, 0]) / (y[crossed, 1] - y[crossed, 0])
        at_low, at_high = (x[crossed, 0] + slope * (level - y[crossed, 0]) for level in (low, high))
        order = np.argsort(at_low + at_high)[: len(crossed) // 2 * 2]
        left, right = order[::2], order[1::2]
        for first, second, third in (
            ((at_low[left], low), (at_low[right], low), (at_high[right], high)),
            ((at_low[left], low), (at_high[right], high), (at_high[left], high)),
        ):
            corners = [where[:, None] * across + level * along for where, level in (first, second, third)]
            trapezoids.append(np.stack(corners, axis=1) + depth * through)
    return facing_triangles(np.concatenate(trapezoids), normal) if trapezoids else np.zeros((0, 3, 3))


def facing_triangles(corners: np.ndarray, normal: tuple[float, float, float]) -> np.ndarray:
    """Triangles, the position first at each corner, (count, 3, width), turned so that they show their front."""
    a, b, c = np.moveaxis(corners[..., :3], 1, 0)
    turned = np.cross(b - a, c - a) @ np.array(normal) < 0.0
    return np.where(turned[:, None, None], corners[:, ::-1], corners)


@dataclass(frozen=True)
class MappedSurface:
    """A surface that moves with nodes: vertex = sum over k of weights[k] * node position[nodes[k]].

    A surface made of the mesh's own nodes has one node of weight 1 per vertex; one that does not match the
    mesh has the nodes of the element around each vertex and their barycentric weights.

    Attributes:
        nodes: node indices of the body, shape (vertex_count, nodes_per_vertex).
        weights: their weights [-], shape (vertex_count, nodes_per_vertex); each row sums to 1.
        triangles: vertex indices, outward by the right-hand rule, shape (triangle_count, 3).
    """

    nodes: np.ndarray
    weights: np.ndarray
    triangles: np.ndarray

    @classmethod
    def of_nodes(cls, triangles: np.ndarray) -> "MappedSurface":
        """The surface spanned by triangles of node indices, its vertices renumbered in node order."""
        nodes, vertices = np.unique(triangles, return_inverse=True)
        return cls(
            nodes.reshape(-1, 1).astype(np.int32),
            np.ones((len(nodes), 1)),
            vertices.reshape(-1, 3).astype(np.int32),
        )

    @classmethod
    def joined(cls, surfaces: Sequence["MappedSurface"]) -> "MappedSurface":
        """Surfaces whose vertices have as many nodes each, as one, in their order; a single one remains itself."""
        if len(surfaces) == 1:
            return surfaces[0]
        first_vertex = np.cumsum([0, *(len(surface.nodes) for surface in surfaces)])
        return cls(
            np.vstack([surface.nodes for surface in surfaces]),
            np.vstack([surface.weights for surface in surfaces]),
            np.vstack(
                [surface.triangles + first for surface, first in zip(surfaces, first_vertex[:-1], strict=True)]
            ).astype(np.int32),
        )

    def positions(self, node_positions: np.ndarray) -> np.ndarray:
        """Vertex positions [mm], shape (vertex_count, 3), for node positions of shape (node_count, 3)."""
        return np.einsum("vk,vkd->vd", self.weights, node_positions[self.nodes])


def stacked(tables: Sequence[np.ndarray]) -> np.ndarray:
    """Nodes or weights of several surfaces under each other; narrower tables are filled up with node 0 of weight 0."""
    columns = max((table.shape[1] for table in tables), default=1)
    padded = [np.pad(table, ((0, 0), (0, columns - table.shape[1]))) for table in tables]
    return np.concatenate([np.zeros((0, columns)), *padded])


def enclosed_volume(vertices: np.ndarray, triangles: np.ndarray) -> float:
    """Signed volume [mm^3] inside a closed surface, positive when it faces outward (divergence theorem)."""
    a, b, c = np.moveaxis(vertices[triangles] - vertices.mean(axis=0), 1, 0)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def closed_outward(vertices: np.ndarray, triangles: np.ndarray, source: str) -> np.ndarray:
    """The triangles of a closed surface, turned round with a warning when it is inside out."""
    open_edges = count_open_edges(triangles)
    if open_edges:
        raise MeshError(
            f"{source}: is not closed: {open_edges} edges do not join exactly two triangles of one "
            "orientation; fill the holes and merge equal vertices"
        )
    volume = enclosed_volume(vertices, triangles)
    if volume == 0.0:
        raise MeshError(f"{source}: encloses no volume")
    if volume < 0.0:
        warn_caller(f"{source}: is inside out; its triangles are turned round")
        return np.ascontiguousarray(triangles[:, ::-1])
    return triangles


def count_open_edges(triangles: np.ndarray) -> int:
    """Number of directed edges that do not occur exactly once with exactly one opposite."""
    edges = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64)
    size = int(triangles.max()) + 1 if len(triangles) else 1
    forward, counts = np.unique(edges @ [size, 1], return_counts=True)
    backward = edges @ [1, size]
    return int((counts != 1).sum() + (~np.isin(backward, forward)).sum())


# The walls of cavities in ten-node tetrahedra: triangles of six nodes, whose curved sides follow the elements.

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
    ends = dict(zip(elements[:, 4:][used].tolist(), elements[:, volume_mesh.SIDES][used].tolist(), strict=True))
    given = {_rolled(triangle) for triangle in triangles.tolist()}
    whole, left = [], set(given)
    for triangle in sorted(given):
        corners = _corners(triangle, ends)
        parts = {_rolled((corners[k], triangle[k], triangle[k - 1])) for k in range(3)} if corners else set()
        if corners and parts <= left:
            whole.append([*corners, *triangle])
            left -= {triangle, *parts}
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
    if any(len(nodes) != 1 for nodes in shared):
        return None
    corners = tuple(nodes.pop() for nodes in shared)
    return corners if len(set(corners)) == 3 else None


def _rolled(triangle: Sequence[int]) -> tuple[int, ...]:
    """The same triangle, its least node first."""
    least = triangle.index(min(triangle))
    return (*triangle[least:], *triangle[:least])


def _surface(whole: list[list[int]], left: list[tuple[int, ...]], ends: dict[int, list[int]]) -> MappedSurface:
    """Six-node triangles of nodes, and triangles whose sides get points of their own."""
    nodes = sorted({node for triangle in (*whole, *left) for node in triangle})
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

    triangles = [[place[node] for node in face] for face in whole]
    triangles += [[*(place[node] for node in face), *(between(face[a], face[b]) for a, b in SIDES)] for face in left]
    columns = 3 if points else 1
    return MappedSurface(
        np.array(carried, dtype=np.int32)[:, :columns],
        np.array(weights)[:, :columns],
        np.array(triangles, dtype=np.int32).reshape(-1, 6),
    )


# The closed pieces of a body's boundary: the outside, and the walls of air chambers.

OUTER = "outer"
CAVITY = "cavity"


def named_surfaces(mesh: volume_mesh.VolumeMesh) -> dict[str, np.ndarray]:
    """The surface groups of a mesh by name, each (count, 3); "outer" and cavities too where the file names none."""
    named = dict(mesh.surface_groups)
    if OUTER in named:
        return named
    skins, cavities = skins_and_cavities(mesh.nodes, mesh.elements)
    outer = {OUTER: np.concatenate(skins)} if skins else {}
    return {**outer, **dict(zip(cavity_names(len(cavities)), cavities, strict=True)), **named}


def skins_and_cavities(nodes: np.ndarray, elements: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """The closed pieces of a body's boundary: outer skins, which face outward, and cavities, which face the silicone.

    Args:
        nodes: positions [mm], shape (node_count, 3).
        elements: tetrahedra of positive volume, shape (element_count, 4).

    Returns:
        Skins and cavities, each (count, 3) node indices; both enclose positive volumes.
    """
    outward = connected_pieces(volume_mesh.boundary_triangles(elements), len(nodes))
    skins = [piece for piece in outward if enclosed_volume(nodes, piece) > 0]
    cavities = [piece[:, ::-1] for piece in outward if enclosed_volume(nodes, piece) <= 0]
    return skins, cavities


def cavity_names(count: int) -> list[str]:
    """Names of the surface groups of cavities: "cavity" alone; "cavity_0", "cavity_1", ... where there are more."""
    return [CAVITY] if count == 1 else [f"{CAVITY}_{number}" for number in range(count)]


def connected_pieces(triangles: np.ndarray, node_count: int) -> list[np.ndarray]:
    """The triangles, each (count, 3), of every piece of a surface that shares no node with the others."""
    piece = joined_pieces(node_count, triangles[:, [0, 1, 1, 2]].reshape(-1, 2))[triangles[:, 0]]
    return [triangles[piece == number] for number in np.unique(piece)]


def joined_pieces(count: int, pairs: np.ndarray) -> np.ndarray:
    """Number of the piece of each of `count` things, shape (count,), of which pairs, (pair_count, 2), are joined."""
    graph = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(count, count))
    pieces: np.ndarray = connected_components(graph, directed=False)[1]
    return pieces
