"""Contact detection: pairs of close points on two surfaces."""

from dataclasses import dataclass

import numpy as np

from taichisoft.contact.surfaces import ContactSurfaces
from taichisoft.kernels.edge_contacts import edges_against_edges
from taichisoft.kernels.plane_contacts import vertices_against_planes
from taichisoft.kernels.vertex_contacts import vertices_against_triangles

FIRST_CAPACITY = 1024
MOST_BODIES = 1 << 15


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

    @property
    def key(self) -> np.ndarray:
        """One integer per pair of bodies, shape (count,)."""
        return self.bodies[:, 0] * MOST_BODIES + self.bodies[:, 1]

    @property
    def middle(self) -> np.ndarray:
        """Midpoints [mm], shape (count, 3)."""
        return 0.5 * (self.points[:, 0] + self.points[:, 1])

    def take(self, chosen: np.ndarray) -> "ContactPairs":
        """The pairs at the given indices."""
        return ContactPairs(
            self.bodies.take(chosen, axis=0),
            self.vertices.take(chosen, axis=0),
            self.weights.take(chosen, axis=0),
            self.points.take(chosen, axis=0),
            self.normal.take(chosen, axis=0),
            self.distance.take(chosen),
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
        self._places = np.zeros((capacity, 3), dtype=np.int32)
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
        """All locally closest pairs nearer than `reach` [mm], and those slipped through by up to `depth` [mm].

        Vertices with triangles come first, then edges, then planes, each in the order of the surfaces' arrays.
        """
        count = self._run_kernels(reach, depth)
        if count > self._found.count:
            self._make_room(2 * count)
            count = self._run_kernels(reach, depth)
        return self._found.take(np.lexsort(self._places[:count].T[::-1]))

    def _run_kernels(self, reach: float, depth: float) -> int:
        s, v, found = self._surfaces, self._surfaces.volumes, self._found
        store = (
            self._count,
            self._places,
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
                2 * len(self._possible),
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
                3 * len(self._possible),
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


def bodies_of_key(key: int) -> tuple[int, int]:
    """The two bodies of a `ContactPairs.key`."""
    return divmod(key, MOST_BODIES)
