"""Contact detection: pairs of close points on two surfaces, and a choice of few, well-spread ones."""

from dataclasses import dataclass

import numpy as np

from taichisoft.contact_surfaces import ContactSurfaces
from taichisoft.kernels import contact_selection
from taichisoft.kernels.edge_contacts import edges_against_edges
from taichisoft.kernels.plane_contacts import vertices_against_planes
from taichisoft.kernels.vertex_contacts import vertices_against_triangles

FIRST_CAPACITY = 1024
MOST_BODIES = 1 << 15
SAME_CONTACT = 0.5  # [mm] moved in a step
CLEARLY_CLOSER = 0.05  # [mm]
SHARE_OF_BODY = 0.2


@dataclass(frozen=True)
class ContactPairs:
    """Pairs of points on two surfaces, `count` of them; the first body has the lower index.

    Attributes:
        bodies: indices of the two bodies, shape (count, 2).
        vertices: three vertices of each side's feature (repeated where it has fewer, -1 on a plane), (count, 2, 3).
        weights: barycentric weights of the points in them, shape (count, 2, 3).
        points: the two points [mm], shape (count, 2, 3); on a plane the foot of the other point.
        normal: unit vector from the first body to the second, shape (count, 3).
        distance: [mm], negative when the surfaces have slipped through each other, shape (count,).
    """

    bodies: np.ndarray
    vertices: np.ndarray
    weights: np.ndarray
    points: np.ndarray
    normal: np.ndarray
    distance: np.ndarray

    @property
    def count(self) -> int:
        """Number of pairs."""
        return len(self.distance)

    def take(self, chosen: np.ndarray) -> "ContactPairs":
        """The pairs at the given indices."""
        return ContactPairs(
            self.bodies[chosen],
            self.vertices[chosen],
            self.weights[chosen],
            self.points[chosen],
            self.normal[chosen],
            self.distance[chosen],
        )


class ContactDetection:
    """Finds the contacts of a set of surfaces; keeps its buffers between steps."""

    def __init__(self, surfaces: ContactSurfaces):
        """Prepare for the pairs of surfaces of which at least one can move."""
        self._surfaces = surfaces
        moves = np.isin(np.arange(surfaces.count), surfaces.moving)
        first, second = np.triu_indices(surfaces.count, 1)
        possible = moves[first] | moves[second]
        self._possible = np.column_stack([first, second])[possible].astype(np.int32)
        most_triangles = int(np.diff(surfaces.triangle_range).max())
        self._near_leaf = np.zeros(surfaces.volumes.most_leaves, dtype=np.int32)
        self._near_triangle = np.zeros(most_triangles, dtype=np.int32)
        self._near_weights = np.zeros((most_triangles, 3))
        self._deepest = np.zeros(len(self._possible))
        self._count = np.zeros(1, dtype=np.int32)
        self._make_room(FIRST_CAPACITY)

    def _make_room(self, capacity: int) -> None:
        self._found = ContactPairs(
            bodies=np.zeros((capacity, 2), dtype=np.int32),
            vertices=np.zeros((capacity, 2, 3), dtype=np.int32),
            weights=np.zeros((capacity, 2, 3)),
            points=np.zeros((capacity, 2, 3)),
            normal=np.zeros((capacity, 3)),
            distance=np.zeros(capacity),
        )

    @property
    def is_needed(self) -> bool:
        """Whether anything can touch anything."""
        return len(self._possible) > 0 or len(self._surfaces.plane_body) > 0

    def find(self, reach: float, depth: float) -> ContactPairs:
        """All locally closest pairs nearer than `reach` [mm], and those slipped through by up to `depth` [mm]."""
        count = self._run_kernels(reach, depth)
        if count > self._found.count:
            self._make_room(2 * count)
            count = self._run_kernels(reach, depth)
        return self._found.take(np.arange(count))

    def _run_kernels(self, reach: float, depth: float) -> int:
        s, v, found = self._surfaces, self._surfaces.volumes, self._found
        store = (
            self._count,
            found.bodies,
            found.vertices,
            found.weights,
            found.points,
            found.normal,
            found.distance,
        )
        self._count[0] = 0
        if len(self._possible):
            vertices_against_triangles(
                self._possible,
                s.body,
                reach,
                depth,
                s.triangles,
                s.triangle_edges,
                s.edges,
                s.edge_triangles,
                s.star_start,
                s.star,
                s.first_triangle,
                s.fan_start,
                s.fan,
                s.position,
                v.root,
                v.escape,
                v.triangle_start,
                v.triangle,
                v.vertex_start,
                v.vertex,
                v.lower,
                v.upper,
                self._near_leaf,
                self._near_triangle,
                self._near_weights,
                self._deepest,
                *store,
            )
            edges_against_edges(
                self._possible,
                s.body,
                reach,
                min(depth, reach),
                s.edges,
                s.edge_triangles,
                s.triangles,
                s.position,
                v.root,
                v.escape,
                v.edge_start,
                v.edge,
                v.lower,
                v.upper,
                self._near_leaf,
                self._deepest,
                *store,
            )
        if len(s.plane_body):
            vertices_against_planes(
                s.moving,
                s.body,
                s.plane_body,
                s.plane_point,
                s.plane_normal,
                reach,
                s.position,
                v.root,
                v.escape,
                v.vertex_start,
                v.vertex,
                v.lower,
                v.upper,
                *store,
            )
        return int(self._count[0])


def spread_out(
    pairs: ContactPairs, spacing: float, body_size: np.ndarray, last_key: np.ndarray, last_point: np.ndarray
) -> ContactPairs:
    """Of contacts between the same bodies, alike and closer together than `spacing` [mm], only the closest.

    Nearly equal contacts give nearly dependent constraints, on which a Gauss-Seidel converges slowly. The spacing
    is at most a share of the smaller body (`body_size` [mm] by body number), which would tip over a missing one.

    What was a contact in the last step (`last_key` and `last_point`, see State) stays one unless another is clearly
    closer: at rest all distances are equal but for round-off, and contacts that change with it find no warm start.
    """
    if pairs.count == 0:
        return pairs
    key, point = pair_key(pairs.bodies), pairs.points.mean(axis=1)
    goes_on = match(key, point, last_key, last_point, SAME_CONTACT) >= 0
    order = np.argsort(pairs.distance - CLEARLY_CLOSER * goes_on, kind="stable").astype(np.int32)
    largest = np.minimum(spacing, SHARE_OF_BODY * body_size[pairs.bodies].min(axis=1))
    keep = np.zeros(pairs.count, dtype=np.int32)
    contact_selection.spread_out(order, key, point, pairs.normal, largest, keep)
    return pairs.take(np.flatnonzero(keep))


def match(
    key: np.ndarray, point: np.ndarray, last_key: np.ndarray, last_point: np.ndarray, radius: float
) -> np.ndarray:
    """For each contact the index of the nearest one of the last step between the same bodies, -1 for none.

    Args:
        key: pairs of bodies, shape (count,); `point`: where the contacts are [mm], shape (count, 3).
        last_key: the same of the last step; `last_point` likewise. Each is matched once at most.
        radius: [mm] beyond which they are different contacts.
    """
    matched = np.full(len(key), -1, dtype=np.int32)
    if len(last_key):
        used = np.zeros(len(last_key), dtype=np.int32)
        contact_selection.match(key, point, last_key, last_point, radius, used, matched)
    return matched


def pair_key(bodies: np.ndarray) -> np.ndarray:
    """One integer per pair of bodies, for arrays of shape (count, 2)."""
    return (bodies[:, 0] * MOST_BODIES + bodies[:, 1]).astype(np.int32)


def bodies_of_key(key: int) -> tuple[int, int]:
    """The two bodies of a `pair_key`."""
    return divmod(key, MOST_BODIES)
