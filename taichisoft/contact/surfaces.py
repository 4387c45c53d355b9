"""The contact surfaces and round shapes of all bodies in one set of arrays, at rest and in motion."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from taichisoft.contact.kernels.box_trees import NodeMotion, move_bodies, refit
from taichisoft.contact.kernels.contacts import (
    SMOOTH,
    Carriers,
    MovedShapes,
    MovedSurfaces,
    Planes,
    PoseArrays,
    RoundShapes,
    SmoothSurfaces,
    Surfaces,
    Trees,
    move_vertices,
)
from taichisoft.contact.kernels.shape_contacts import FACING, SHAPE, SURFACE, SURFACE_PAIR_COLUMNS, move_shapes
from taichisoft.contact.kernels.smooth_contacts import turn_normals
from taichisoft.mechanics.kernels.rigid_integration import RigidState
from taichisoft.mechanics.rigid_body_arrays import Obstacle, RigidBody, RoundShape
from taichisoft.mechanics.soft_body_arrays import SoftBody
from taichisoft.mechanics.state import State
from taichisoft.mesh.surface import count_open_edges, stacked, vertex_normals
from taichisoft.runtime.language import SOFT, STATIC

# Contact features: all vertices and edges of soft surfaces, on other surfaces those not inside a flat face.

# On an undeformable body, faces whose normals differ by less than this angle from the first face's normal form one
# plane facet [rad]; an edge inside a facet touches nothing that the facet does not touch.
FLAT_ANGLE = 0.02


# A vertex represents a round surface if the normals of its faces differ by less than this angle from their mean [rad].
ROUND_ANGLE = 0.05


def find_round_vertices(topology: Surfaces, carriers: Carriers) -> np.ndarray:
    """Whether each vertex of an undeformable surface represents a round surface, shape (vertex_count,)."""
    corners = carriers.local[topology.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    mean = np.zeros_like(carriers.local)
    for corner in range(3):
        np.add.at(mean, topology.triangles[:, corner], normals)
    mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-300)
    least = np.ones(len(mean))
    for corner in range(3):
        vertex = topology.triangles[:, corner]
        np.minimum.at(least, vertex, np.einsum("td,td->t", mean[vertex], normals))
    return least > np.cos(ROUND_ANGLE)


def find_features(topology: Surfaces, carriers: Carriers, is_smooth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Whether each vertex and each edge may touch other surfaces, shapes (vertex_count,) and (edge_count,).

    Vertices of smooth surfaces, `is_smooth`, shape (vertex_count,), and their edges are not features.
    """
    edges, edge_triangles, position = topology.edges, topology.edge_triangles, carriers.local
    facet = _find_facets(topology, carriers)[edge_triangles]
    is_edge = (carriers.owner[edges[:, 0]] == SOFT) | (facet[:, 0] != facet[:, 1]) | (edge_triangles[:, 1] < 0)
    is_edge &= ~is_smooth[edges[:, 0]]
    # A corner joins edges of at least two directions.
    along = position[edges[:, 1]] - position[edges[:, 0]]
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300)  # edges of length 0
    spread = np.zeros((len(position), 3, 3))
    for end in (0, 1):
        np.add.at(spread, edges[is_edge, end], along[is_edge, :, None] * along[is_edge, None, :])
    middle_direction = np.linalg.eigvalsh(spread)[:, 1]
    return ((carriers.owner == SOFT) | (middle_direction > FLAT_ANGLE**2)) & ~is_smooth, is_edge


def _find_facets(topology: Surfaces, carriers: Carriers) -> np.ndarray:
    """Number of the plane facet of each triangle of an undeformable surface, -1 on soft ones, (triangle_count,).

    A facet grows over neighbours whose normals differ from the normal of its first triangle by less than FLAT_ANGLE.
    With the neighbour's normal instead, a finely triangulated ball would be one facet without an edge.
    """
    corners = carriers.local[topology.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)  # triangles of area 0
    facet = np.full(len(corners), -1)
    keeps_shape = carriers.owner[topology.triangles[:, 0]] != SOFT
    neighbours: list[list[int]] = [[] for _ in corners]
    for first, second in topology.edge_triangles[topology.edge_triangles[:, 1] >= 0].tolist():
        neighbours[first].append(second)
        neighbours[second].append(first)
    for number, seed in enumerate(np.flatnonzero(keeps_shape).tolist()):
        if facet[seed] >= 0:
            continue
        facet[seed] = number
        grown = [seed]
        while grown:
            for neighbour in neighbours[grown.pop()]:
                if facet[neighbour] < 0 and normals[neighbour] @ normals[seed] > np.cos(FLAT_ANGLE):
                    facet[neighbour] = number
                    grown.append(neighbour)
    return facet


# The triangulated surfaces that contact treats as curved.


def find_smooth(
    smooth: Sequence[bool],
    topology: Surfaces,
    carriers: Carriers,
    vertex_range: np.ndarray,
    triangle_range: np.ndarray,
) -> SmoothSurfaces:
    """Vertex normals and contact pairs of the `smooth` surfaces; see `ContactSurfaces` for the ranges."""
    normal = np.zeros_like(carriers.local)
    is_smooth = np.zeros(len(normal), dtype=np.int32)
    numbers = [surface for surface, curved in enumerate(smooth) if curved]
    for surface in numbers:
        vertices, triangles = slice(*vertex_range[surface]), slice(*triangle_range[surface])
        inner = topology.triangles[triangles] - vertices.start
        normal[vertices] = vertex_normals(carriers.local[vertices], inner)
        is_smooth[vertices] = 1
    pairs = [(one, other) for pair in topology.pairs.tolist() for one, other in (pair, pair[::-1]) if smooth[one]]
    return SmoothSurfaces(
        vertices=np.flatnonzero(is_smooth).astype(np.int32),
        is_smooth=is_smooth,
        local_normal=normal,
        normal=normal.copy(),
        moving=np.intersect1d(numbers, topology.moving).astype(np.int32),
        pairs=np.array(pairs, dtype=np.int32).reshape(-1, 2),
    )


# Bounding volume trees over the triangles of every surface: built once, then only their boxes are updated.

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


# The round shapes of all bodies in one set of arrays.

# A load leans to one side if it goes through an end farther from the axis than this fraction of the radius.
CLEAR_LEAN = 0.5


@dataclass(frozen=True)
class RoundPart:
    """One shape before it is joined with the others.

    Attributes:
        body: number of its body.
        owner: number of the rigid body that carries the shape, or STATIC.
        shape: kind and dimensions.
        centre, turn: position and rotation, on a rigid body in body axes from the centre of mass, else in the world,
            shapes (3,) [mm] and (3, 3).
        groups: parts with a common group do not touch each other.
        collides: False: touches no other part.
    """

    body: int
    owner: int
    shape: RoundShape
    centre: np.ndarray
    turn: np.ndarray
    groups: frozenset[int]
    collides: bool


def round_parts(first_body: int, rigid: Sequence[RigidBody], obstacles: Sequence[Obstacle]) -> list[RoundPart]:
    """Round shapes of the rigid bodies and obstacles; `first_body` is the number of the first rigid body."""
    parts = []
    for index, body in enumerate(rigid):
        if body.shape is not None:
            parts.append(
                RoundPart(
                    first_body + index, index, body.shape, -body.centre_of_mass, np.eye(3), body.groups, body.collides
                )
            )
    for index, obstacle in enumerate(obstacles, start=first_body + len(rigid)):
        if obstacle.shape is not None:
            parts.append(
                RoundPart(index, STATIC, obstacle.shape, obstacle.shift, obstacle.turn, obstacle.groups, collides=True)
            )
    return parts


def join_shapes(
    parts: Sequence[RoundPart], surface_pairs: Sequence[tuple[int, int, bool]], shape_pairs: Sequence[tuple[int, int]]
) -> RoundShapes:
    """Join shapes in one set of arrays.

    Args:
        parts: the shapes.
        surface_pairs: numbers of a shape and of a surface that can touch, and whether the surface is soft.
        shape_pairs: numbers of two shapes that can touch.
    """
    turns = np.array([part.turn for part in parts]).reshape(-1, 3, 3)
    moves = np.array([part.owner != STATIC and part.collides for part in parts], dtype=bool)
    return RoundShapes(
        body=np.array([part.body for part in parts], dtype=np.int32),
        owner=np.array([part.owner for part in parts], dtype=np.int32),
        flat=np.array([part.shape.flat for part in parts], dtype=np.int32),
        radius=np.array([part.shape.radius for part in parts], dtype=float),
        half_length=np.array([0.5 * part.shape.length for part in parts], dtype=float),
        local_centre=np.array([part.centre for part in parts], dtype=float).reshape(-1, 3),
        local_axis=turns[:, :, 2].copy(),
        local_side=turns[:, :, 0].copy(),
        moving=np.flatnonzero(moves).astype(np.int32),
        surface_pairs=np.array(surface_pairs, dtype=np.int32).reshape(-1, SURFACE_PAIR_COLUMNS),
        shape_pairs=np.array(shape_pairs, dtype=np.int32).reshape(-1, 2),
    )


def moved_shapes(shapes: RoundShapes) -> MovedShapes:
    """Arrays of current positions: shapes of obstacles in place, other shapes in body axes."""
    lean = np.repeat(shapes.local_side[:, None], 2, axis=1)
    return MovedShapes(shapes.local_centre.copy(), shapes.local_axis.copy(), shapes.local_side.copy(), lean)


def update_lean(shapes: RoundShapes, there: MovedShapes, state: State) -> None:
    """Align the division of cylinder rims with the load in the step that led to `state`.

    On the edge of tipping the load goes through one point of the rim, which must then be a contact. A load near the
    middle has no clear direction: then the division is fixed on the cylinder.
    """
    pressing = np.abs((state.contact_impulse * state.contact_normal).sum(axis=1))
    for shape in np.flatnonzero(shapes.flat).tolist():
        axis, centre = there.axis[shape], there.centre[shape]
        mine = (state.contact_body_pair == shapes.body[shape]).any(axis=1)
        mine &= np.abs(state.contact_normal @ axis) > FACING
        arms = state.contact_point - centre
        for end, on_end in enumerate((arms @ axis < 0.0, arms @ axis >= 0.0)):
            weights = np.where(mine & on_end, pressing, 0.0)
            offset = weights @ arms / max(weights.sum(), 1e-300)
            offset -= offset @ axis * axis
            length = float(np.linalg.norm(offset))
            clear = length > CLEAR_LEAN * shapes.radius[shape]
            there.lean[shape, end] = offset / length if clear else there.side[shape]


def boxes(shapes: RoundShapes, there: MovedShapes) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper corners of the bounding boxes of shapes [mm], each (shape_count, 3)."""
    extent = shapes.half_length[:, None] * np.abs(there.axis) + shapes.radius[:, None]
    return there.centre - extent, there.centre + extent


# The contact surfaces of all bodies in one set of arrays, with the adjacency of their features.

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
        self.trees = build(
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


# The moving surfaces of a simulation.


class MovingSurfaces:
    """Current vertices and boxes of contact surfaces, and current round shapes, of one simulation.

    Attributes:
        moved: vertices and boxes.
        shapes: axes of the round shapes.
        smooth: the surfaces treated as curved, with their normals.
    """

    def __init__(self, surfaces: ContactSurfaces):
        """Start with all vertices at rest, vertices of rigid bodies in body axes."""
        self._surfaces = surfaces
        self._has_level_ends = bool(surfaces.shapes.flat.any())
        tree_nodes = len(surfaces.trees.escape)
        self.moved = MovedSurfaces(
            position=surfaces.carriers.local.copy(),
            lower=np.zeros((tree_nodes, 3)),
            upper=np.zeros((tree_nodes, 3)),
        )
        self.shapes = moved_shapes(surfaces.shapes)
        self.smooth = surfaces.smooth._replace(normal=surfaces.smooth.local_normal.copy())
        refit(np.arange(surfaces.count, dtype=np.int32), surfaces.trees, self.moved)
        # Reused arrays: a kernel launch with new arrays takes longer than the arithmetic.
        self._poses = PoseArrays(
            node_position=np.zeros((surfaces.node_count, 3)),
            rigid_position=np.zeros((surfaces.rigid_count, 3)),
            rigid_rotation=np.zeros((surfaces.rigid_count, 3, 3)),
        )

    def update(self, node_position: np.ndarray, rigid_position: np.ndarray, rigid_rotation: np.ndarray) -> None:
        """Move the surfaces to node positions (N, 3) [mm] and rigid poses, (R, 3) [mm] and (R, 3, 3)."""
        poses = self._poses
        poses.node_position[:] = node_position
        poses.rigid_position[:] = rigid_position
        poses.rigid_rotation[:] = rigid_rotation
        self._follow_poses()

    def move(self, passed: float, soft: NodeMotion, rigid: RigidState) -> None:
        """Move the surfaces to a time `passed` [s] after the start of a step, at the velocities of the start."""
        move_bodies(passed, soft, rigid, self._poses)
        self._follow_poses()

    def _follow_poses(self) -> None:
        poses, surfaces = self._poses, self._surfaces
        move_vertices(surfaces.carriers, poses, self.moved)
        refit(surfaces.topology.moving, surfaces.trees, self.moved)
        if len(surfaces.shapes.moving):
            move_shapes(surfaces.shapes, poses, self.shapes)
        if len(surfaces.smooth.moving):
            turn_normals(self.smooth, surfaces.carriers, poses)

    def follow_load(self, state: State) -> None:
        """Align the contact points of level cylinder ends with the load in the step that led to `state`."""
        if self._has_level_ends:
            update_lean(self._surfaces.shapes, self.shapes, state)

    def boxes(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper corners [mm] of the bounding boxes of surfaces, without shapes, each (surface_count, 3)."""
        root = self._surfaces.trees.root[:-1]
        return self.moved.lower[root], self.moved.upper[root]
