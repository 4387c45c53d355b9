"""The contact surfaces of all bodies in one set of arrays, with the adjacency of their features."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from taichisoft.bodies.rigid_body_arrays import Obstacle, RigidBody
from taichisoft.bodies.soft_body_arrays import SoftBody
from taichisoft.contact import bounding_volumes
from taichisoft.contact.features import find_features, find_round_vertices
from taichisoft.contact.kernels.round_shapes import SHAPE, SURFACE, RoundShapes
from taichisoft.contact.kernels.surface_vertices import SMOOTH, Carriers, Planes, Surfaces
from taichisoft.contact.shapes import RoundPart, join_shapes, round_parts
from taichisoft.contact.smooth import find_smooth
from taichisoft.meshes.surface import count_open_edges, stacked
from taichisoft.runtime.language import SOFT, STATIC

# A rolling ball with ten thousand vertices sinks by the tolerance at each vertex that it passes, and gains the energy:
# 2 % in a second with 1e-4 mm, 0.4 % with 1e-5 mm. Soft faces that lie on each other have so many similar contacts
# within less than 1e-4 mm that the solver takes thousands of sweeps.
RIGID_GAP_TOLERANCE, SOFT_GAP_TOLERANCE = 1e-5, 1e-4  # [mm]


@dataclass(frozen=True)
class _Part:
    """One surface before it is joined with the others.

    Attributes:
        body: number of its body.
        owner: number of the rigid body that carries the surface, or SOFT, or STATIC.
        vertices: positions at rest [mm], shape (vertex_count, 3).
        triangles: vertex indices, shape (triangle_count, 3).
        nodes, weights: soft nodes that carry each vertex and their weights, shape (vertex_count, nodes_per_vertex).
        groups: parts with a common group do not touch each other.
        collides: False: touches no other part.
        touches_itself: whether the surface has contacts with itself.
        smooth: whether the triangles represent a curved surface.
    """

    body: int
    owner: int
    vertices: np.ndarray
    triangles: np.ndarray
    nodes: np.ndarray
    weights: np.ndarray
    groups: frozenset[int] = frozenset()
    collides: bool = True
    smooth: bool = False
    touches_itself: bool = False


class ContactSurfaces:
    """Vertices, edges and triangles of every body's surface, round shapes and planes; constant during a run.

    Attributes:
        topology: triangles, edges and vertices, with their adjacency.
        carriers: the bodies and nodes that carry the vertices.
        planes: the half-spaces.
        shapes: the round shapes; their bodies have no triangulated surface.
        smooth: the surfaces treated as curved.
        trees: trees over the triangles.
        touching_itself: numbers of the surfaces with self-contact, shape (count,).
        vertex_range, triangle_range, edge_range: first and last + 1 of each surface's features, (surface_count, 2).
        vertex_is_feature, edge_is_feature: whether it may touch other surfaces, see `find_features`.
        vertex_is_round: SHARP, ROUND for a vertex that represents a round surface, or SMOOTH, shape (vertex_count,).
        body_size: smallest initial extent of each body that can move [mm], infinite for others, shape (body_count,).
        may_touch: whether two bodies can touch, shape (body_count, body_count).
        may_pass_through: whether one body could be beyond the other after a step; nothing is beyond a plane.
        gap_tolerance: tolerated intrusion of two bodies into the contact distance, up to which a contact may be left
            out [mm], shape (body_count, body_count).
        node_count, rigid_count: numbers of soft nodes and of rigid bodies.
    """

    def __init__(self, soft: Sequence[SoftBody], rigid: Sequence[RigidBody], obstacles: Sequence[Obstacle]):
        """Join the surfaces; bodies are numbered in the order of the arguments."""
        parts, rounds = _parts(soft, rigid, obstacles), round_parts(len(soft), rigid, obstacles)
        self.shapes = _join_shapes(rounds, parts)
        self.node_count, self.rigid_count = sum(body.nodes.stop - body.nodes.start for body in soft), len(rigid)
        first_obstacle = len(soft) + len(rigid)
        planes = [(first_obstacle + i, o.point, o.normal) for i, o in enumerate(obstacles) if o.normal is not None]
        self.planes = Planes(
            body=np.array([body for body, _, _ in planes], dtype=np.int32),
            point=np.array([point for _, point, _ in planes]).reshape(-1, 3),
            normal=np.array([normal for _, _, normal in planes]).reshape(-1, 3),
        )
        self.carriers = Carriers(
            owner=np.repeat([part.owner for part in parts], [len(part.vertices) for part in parts]).astype(np.int32),
            local=np.vstack([np.zeros((0, 3)), *(part.vertices for part in parts)]),
            nodes=stacked([part.nodes for part in parts]).astype(np.int32),
            weights=stacked([part.weights for part in parts]),
        )
        self.topology = _join(parts)
        self.touching_itself = np.flatnonzero([part.touches_itself for part in parts]).astype(np.int32)
        self.vertex_range = _ranges([len(part.vertices) for part in parts])
        self.triangle_range = _ranges([len(part.triangles) for part in parts])
        surface_of_edge = np.searchsorted(self.vertex_range[:, 1], self.topology.edges[:, 0], side="right")
        self.edge_range = _ranges(np.bincount(surface_of_edge, minlength=len(parts)))
        self.smooth = find_smooth(
            [part.smooth for part in parts], self.topology, self.carriers, self.vertex_range, self.triangle_range
        )
        is_smooth = self.smooth.is_smooth.astype(bool)
        self.vertex_is_feature, self.edge_is_feature = find_features(self.topology, self.carriers, is_smooth)
        is_round = find_round_vertices(self.topology, self.carriers)
        self.vertex_is_round = np.where(is_smooth, SMOOTH, is_round).astype(np.int32)
        self.trees = bounding_volumes.build(
            self.topology, self.triangle_range, self.carriers.local, self.vertex_is_feature, self.edge_is_feature
        )
        self.body_size = np.full(first_obstacle + len(obstacles), np.inf)
        # A soft body's collision surface may be a sheet without thickness.
        solids = [body.rest_position for body in soft] + [body.vertices for body in rigid]
        sheets = [False] * len(soft) + [count_open_edges(body.triangles) > 0 for body in rigid]
        for number, points in enumerate(solids):
            self.body_size[number] = np.inf if sheets[number] else np.ptp(points, axis=0).min()
        for part in rounds:
            if part.owner != STATIC:
                self.body_size[part.body] = part.shape.smallest_extent

        count = len(self.body_size)
        self.may_pass_through, self.may_touch = (np.zeros((count, count), dtype=bool) for _ in range(2))
        self.may_pass_through[tuple(self._body_pairs().T)] = True
        itself = self.topology.body[self.touching_itself]
        self.may_pass_through[itself, itself] = True
        of_surfaces, of_shapes = self.topology.body[self.topology.moving], self.shapes.body[self.shapes.moving]
        self.may_touch[np.ix_(np.concatenate([of_surfaces, of_shapes]), self.planes.body)] = True
        self.may_pass_through |= self.may_pass_through.T
        self.may_touch |= self.may_touch.T | self.may_pass_through
        # Nothing gives way between bodies that are carried, or between one and an obstacle.
        carried = np.array([False] * len(soft) + [body.follows is not None for body in rigid] + [True] * len(obstacles))
        self.may_touch[np.ix_(carried, carried)] = self.may_pass_through[np.ix_(carried, carried)] = False
        is_soft = np.arange(len(self.body_size)) < len(soft)
        self.gap_tolerance = np.where(is_soft[:, None] | is_soft, SOFT_GAP_TOLERANCE, RIGID_GAP_TOLERANCE)

    @property
    def count(self) -> int:
        """Number of surfaces, without planes."""
        return len(self.topology.body)

    def _body_pairs(self) -> np.ndarray:
        """Numbers of two bodies with surfaces or shapes that can touch, without planes, shape (count, 2)."""
        surface, shape = self.topology.body, self.shapes.body
        shape_of, surface_of = self.shapes.surface_pairs[:, SHAPE], self.shapes.surface_pairs[:, SURFACE]
        pairs = [
            surface[self.topology.pairs].reshape(-1, 2),
            shape[self.shapes.shape_pairs].reshape(-1, 2),
            np.column_stack([shape[shape_of], surface[surface_of]]),
        ]
        return np.vstack(pairs)


def _parts(soft: Sequence[SoftBody], rigid: Sequence[RigidBody], obstacles: Sequence[Obstacle]) -> list[_Part]:
    parts: list[_Part] = []
    for number, body in enumerate(soft):
        for collision in body.collision_surfaces:
            surface, vertices = collision.surface, collision.surface.positions(body.rest_position)
            nodes = surface.nodes + body.nodes.start
            collides, itself = body.settings.collides, body.settings.collides and body.settings.self_contact
            carried = nodes, surface.weights, collision.groups, collides
            part = _Part(number, SOFT, vertices, surface.triangles, *carried, touches_itself=itself)
            parts.append(part)
    others: list[RigidBody | Obstacle] = [*rigid, *obstacles]
    for index, other in enumerate(others):
        if other.vertices is not None and other.triangles is not None and other.shape is None:
            owner, no_node = index if index < len(rigid) else STATIC, np.zeros((len(other.vertices), 1))
            collides = other.collides if isinstance(other, RigidBody) else True
            number = len(soft) + index
            parts.append(
                _Part(
                    number,
                    owner,
                    other.vertices,
                    other.triangles,
                    no_node,
                    no_node,
                    other.groups,
                    collides,
                    other.smooth,
                )
            )
    return parts


def _ranges(counts: Sequence[int] | np.ndarray) -> np.ndarray:
    ends = np.cumsum(counts)
    return np.column_stack([ends - counts, ends]).astype(np.int32)


def _join(parts: Sequence[_Part]) -> Surfaces:
    vertex_counts = [len(part.vertices) for part in parts]
    shifted = [part.triangles + start for part, (start, _) in zip(parts, _ranges(vertex_counts), strict=True)]
    triangles = np.vstack([np.zeros((0, 3)), *shifted]).astype(np.int32)
    edges, triangle_edges, edge_triangles = _find_edges(triangles)
    fan_start, fan = _incidence(triangles, sum(vertex_counts))
    star_start, star = _incidence(edges, sum(vertex_counts))
    edge, end = np.divmod(star, 2)
    moves = np.array([_moves(part) for part in parts], dtype=bool)
    first, second = np.triu_indices(len(parts), 1)
    pairs = zip(first.tolist(), second.tolist(), strict=True)
    touch = np.array([_may_touch(parts[one], parts[other]) for one, other in pairs], dtype=bool)
    return Surfaces(
        body=np.array([part.body for part in parts], dtype=np.int32),
        triangles=triangles,
        triangle_edges=triangle_edges,
        edges=edges,
        edge_triangles=edge_triangles,
        star_start=star_start,
        star=edges[edge, 1 - end].astype(np.int32),
        first_triangle=(fan[fan_start[:-1]] // 3).astype(np.int32),
        fan_start=fan_start,
        fan=fan,
        moving=np.flatnonzero(moves).astype(np.int32),
        pairs=np.column_stack([first, second])[touch & (moves[first] | moves[second])].astype(np.int32),
    )


def _join_shapes(rounds: Sequence[RoundPart], parts: Sequence[_Part]) -> RoundShapes:
    surface_pairs = [
        (number, surface, part.owner == SOFT)
        for number, shape in enumerate(rounds)
        for surface, part in enumerate(parts)
        if _may_touch(shape, part) and (_moves(shape) or _moves(part))
    ]
    shape_pairs = [
        (first, second)
        for first, one in enumerate(rounds)
        for second, other in enumerate(rounds[:first])
        if _may_touch(one, other) and (_moves(one) or _moves(other))
    ]
    return join_shapes(rounds, surface_pairs, [(second, first) for first, second in shape_pairs])


def _moves(part: _Part | RoundPart) -> bool:
    return part.owner != STATIC and part.collides


def _may_touch(one: _Part | RoundPart, other: _Part | RoundPart) -> bool:
    return one.collides and other.collides and one.groups.isdisjoint(other.groups)


def _find_edges(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Find the edges, the edge opposite to each triangle's corner, and the triangles at each edge."""
    opposite = triangles[:, [[1, 2], [2, 0], [0, 1]]].reshape(-1, 2)
    edges, of_corner = np.unique(np.sort(opposite, axis=1), axis=0, return_inverse=True)
    of_corner = of_corner.reshape(-1)
    by_edge = np.argsort(of_corner, kind="stable")
    start = np.searchsorted(of_corner[by_edge], np.arange(len(edges) + 1))
    edge_triangles = np.full((len(edges), 2), -1, dtype=np.int32)
    edge_triangles[:, 0] = by_edge[start[:-1]] // 3
    two = np.diff(start) > 1
    edge_triangles[two, 1] = by_edge[start[:-1][two] + 1] // 3
    return edges.astype(np.int32), of_corner.reshape(-1, 3).astype(np.int32), edge_triangles


def _incidence(table: np.ndarray, vertex_count: int) -> tuple[np.ndarray, np.ndarray]:
    """Flat indices into `table` at which each vertex occurs: start of each vertex's list, and the lists."""
    by_vertex = np.argsort(table.reshape(-1), kind="stable")
    start = np.searchsorted(table.reshape(-1)[by_vertex], np.arange(vertex_count + 1))
    return start.astype(np.int32), by_vertex.astype(np.int32)
