"""The surfaces that can touch, of all bodies in one set of arrays, with the neighbourhoods of their features."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from taichisoft.bodies.rigid_body import Obstacle, RigidBody
from taichisoft.bodies.soft_body import SoftBody
from taichisoft.contact import bounding_volumes
from taichisoft.kernels.bounding_volumes import refit
from taichisoft.kernels.runtime import SOFT, STATIC
from taichisoft.kernels.surface_motion import move_vertices
from taichisoft.meshes.surface import MappedSurface

# On a body that keeps its shape, faces whose normals differ by less than this from the first one's make one plane
# facet [rad]; edges inside a facet touch nothing that the facet does not.
FLAT_ANGLE = 0.02


@dataclass(frozen=True)
class _Part:
    """One surface before it is put together with the others."""

    body: int
    vertices: np.ndarray
    triangles: np.ndarray
    owner: int
    nodes: np.ndarray
    weights: np.ndarray


class ContactSurfaces:
    """Vertices, edges and triangles of every body's surface, and the half-spaces of planes.

    Attributes:
        body: index of the body (soft bodies first, then rigid bodies, then obstacles) of each surface.
        vertex_range, triangle_range, edge_range: where each surface's features stand, shape (surface_count, 2).
        triangles: vertex indices, shape (triangle_count, 3).
        triangle_edges: edge opposite to each corner, shape (triangle_count, 3).
        edges: vertex indices, shape (edge_count, 2).
        edge_triangles: the one or two triangles at each edge, -1 for none, shape (edge_count, 2).
        vertex_is_feature, edge_is_feature: whether it may touch other surfaces (flat ones of rigid bodies do not).
        vertex_owner: rigid body that carries each vertex, or SOFT, or STATIC.
        vertex_nodes, vertex_weights: soft nodes that carry each vertex, shape (vertex_count, nodes_per_vertex).
        position: of the vertices now [mm], shape (vertex_count, 3).
        moving: surfaces that can move, shape (moving_count,).
        volumes: the trees of boxes over their triangles now.
        fan_start, fan: for each vertex, corners (3 * triangle + corner) of the triangles around it.
        star_start, star: for each vertex, the other ends of its edges.
        first_triangle: one triangle of each vertex, that of the lowest index.
        body_size: smallest extent of each body that can move at the start [mm], infinite for others, by body number.
        plane_body, plane_point, plane_normal: the planes.
    """

    def __init__(self, soft: Sequence[SoftBody], rigid: Sequence[RigidBody], obstacles: Sequence[Obstacle]):
        """Put the surfaces together."""
        parts = [_soft_part(index, body) for index, body in enumerate(soft)]
        parts += [_rigid_part(len(soft) + index, index, body) for index, body in enumerate(rigid)]
        first_obstacle = len(soft) + len(rigid)
        for index, obstacle in enumerate(obstacles):
            if obstacle.vertices is not None and obstacle.triangles is not None:
                parts.append(_fixed_part(first_obstacle + index, STATIC, obstacle.vertices, obstacle.triangles))
        planes = [(first_obstacle + i, o.point, o.normal) for i, o in enumerate(obstacles) if o.normal is not None]
        self.plane_body = np.array([body for body, _, _ in planes], dtype=np.int32)
        self.plane_point = np.array([point for _, point, _ in planes]).reshape(-1, 3)
        self.plane_normal = np.array([normal for _, _, normal in planes]).reshape(-1, 3)
        self.body = np.array([part.body for part in parts], dtype=np.int32)
        self._join(parts)
        self._allocate(sum(body.nodes.stop - body.nodes.start for body in soft), len(rigid))
        body_count = len(soft) + len(rigid) + len(obstacles)
        self.body_size = np.full(body_count, np.inf)
        for part in parts:
            if part.owner != STATIC:
                self.body_size[part.body] = np.ptp(part.vertices, axis=0).min()

    def _join(self, parts: Sequence[_Part]) -> None:
        vertex_start = np.cumsum([0, *(len(part.vertices) for part in parts)])
        self.vertex_range = _ranges([len(part.vertices) for part in parts])
        self.triangle_range = _ranges([len(part.triangles) for part in parts])
        shifted = [part.triangles + start for part, start in zip(parts, vertex_start[:-1], strict=True)]
        self.triangles = np.vstack(shifted).astype(np.int32)
        self._local = np.vstack([part.vertices for part in parts])
        self.vertex_owner = np.concatenate([np.full(len(p.vertices), p.owner) for p in parts]).astype(np.int32)
        most = max(part.nodes.shape[1] for part in parts)
        self.vertex_nodes = np.vstack([_padded(part.nodes, most) for part in parts]).astype(np.int32)
        self.vertex_weights = np.vstack([_padded(part.weights, most) for part in parts])
        self.edges, self.triangle_edges, self.edge_triangles = _find_edges(self.triangles)
        edge_counts = np.bincount(
            np.searchsorted(vertex_start, self.edges[:, 0], side="right") - 1, minlength=len(parts)
        )
        self.edge_range = _ranges(edge_counts)
        self.vertex_is_feature, self.edge_is_feature = self._find_features()
        self.fan_start, self.fan = _incidence(self.triangles, len(self._local))
        self.star_start, star = _incidence(self.edges, len(self._local))
        edge, end = np.divmod(star, 2)
        self.star = self.edges[edge, 1 - end].astype(np.int32)
        self.first_triangle = (self.fan[self.fan_start[:-1]] // 3).astype(np.int32)

    def _find_features(self) -> tuple[np.ndarray, np.ndarray]:
        """Of surfaces that keep their shape only edges and corners of facets touch; of soft ones everything may."""
        soft_edge = self.vertex_owner[self.edges[:, 0]] == SOFT
        facet = self._find_facets()[self.edge_triangles]
        is_edge = soft_edge | (facet[:, 0] != facet[:, 1]) | (self.edge_triangles[:, 1] < 0)
        # A corner joins edges of at least two directions.
        along = self._local[self.edges[:, 1]] - self._local[self.edges[:, 0]]
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        spread = np.zeros((len(self._local), 3, 3))
        for end in (0, 1):
            np.add.at(spread, self.edges[is_edge, end], along[is_edge, :, None] * along[is_edge, None, :])
        middle_direction = np.linalg.eigvalsh(spread)[:, 1]
        is_vertex = (self.vertex_owner == SOFT) | (middle_direction > FLAT_ANGLE**2)
        return is_vertex.astype(np.int32), is_edge.astype(np.int32)

    def _find_facets(self) -> np.ndarray:
        """Number of the plane facet that each triangle of a surface that keeps its shape belongs to.

        A facet grows over neighbours whose normal is that of its first triangle to FLAT_ANGLE: compared with the
        neighbour's instead, a finely triangulated ball would be one facet without an edge.
        """
        corners = self._local[self.triangles]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        facet = np.full(len(self.triangles), -1)
        keeps_shape = self.vertex_owner[self.triangles[:, 0]] != SOFT
        neighbours: list[list[int]] = [[] for _ in self.triangles]
        for first, second in self.edge_triangles[self.edge_triangles[:, 1] >= 0].tolist():
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

    def _allocate(self, node_count: int, rigid_count: int) -> None:
        self.position = self._local.copy()
        self.moving = np.flatnonzero(self.vertex_owner[self.vertex_range[:, 0]] != STATIC).astype(np.int32)
        self.volumes = bounding_volumes.build(
            self.triangle_range,
            self.triangles,
            self._local,
            self.first_triangle,
            self.vertex_is_feature,
            self.edge_triangles,
            self.edge_is_feature,
        )
        self._refit(np.arange(self.count, dtype=np.int32))
        # Arrays that stay in place: a launch with new ones takes longer than the arithmetic.
        self._node_position = np.zeros((node_count, 3))
        self._rigid_position = np.zeros((rigid_count, 3))
        self._rigid_rotation = np.zeros((rigid_count, 3, 3))

    @property
    def count(self) -> int:
        """Number of surfaces, planes not counted."""
        return len(self.body)

    def update(self, node_position: np.ndarray, rigid_position: np.ndarray, rigid_rotation: np.ndarray) -> None:
        """Move the vertices and boxes with the nodes (N, 3) [mm] and rigid poses, (R, 3) [mm] and (R, 3, 3)."""
        self._node_position[:] = node_position
        self._rigid_position[:] = rigid_position
        self._rigid_rotation[:] = rigid_rotation
        move_vertices(
            self.vertex_owner,
            self._local,
            self.vertex_nodes,
            self.vertex_weights,
            self._node_position,
            self._rigid_position,
            self._rigid_rotation,
            self.position,
        )
        self._refit(self.moving)

    def _refit(self, some: np.ndarray) -> None:
        v = self.volumes
        refit(some, v.root, v.escape, v.corner_start, v.corner, self.position, v.lower, v.upper)

    def boxes(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper corner [mm] of each surface's bounding box, each (surface_count, 3)."""
        return self.volumes.lower[self.volumes.root[:-1]], self.volumes.upper[self.volumes.root[:-1]]


def _soft_part(body: int, soft: SoftBody) -> _Part:
    surface: MappedSurface = soft.surface
    vertices = surface.positions(soft.rest_position)
    return _Part(body, vertices, surface.triangles, SOFT, surface.nodes + soft.nodes.start, surface.weights)


def _rigid_part(body: int, index: int, rigid: RigidBody) -> _Part:
    return _fixed_part(body, index, rigid.vertices, rigid.triangles)


def _fixed_part(body: int, owner: int, vertices: np.ndarray, triangles: np.ndarray) -> _Part:
    count = len(vertices)
    return _Part(body, vertices, triangles, owner, np.zeros((count, 1), dtype=np.int32), np.zeros((count, 1)))


def _ranges(counts: Sequence[int] | np.ndarray) -> np.ndarray:
    ends = np.cumsum(counts)
    return np.column_stack([ends - counts, ends]).astype(np.int32)


def _padded(table: np.ndarray, columns: int) -> np.ndarray:
    """Fill up with node 0 of weight 0."""
    return np.pad(table, ((0, 0), (0, columns - table.shape[1])))


def _find_edges(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Edges, the edge opposite to each triangle's corner, and the triangles at each edge."""
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
    """For each vertex the flat positions in `table` where it stands: start of each list, and the lists."""
    by_vertex = np.argsort(table.reshape(-1), kind="stable")
    start = np.searchsorted(table.reshape(-1)[by_vertex], np.arange(vertex_count + 1))
    return start.astype(np.int32), by_vertex.astype(np.int32)
