"""Contact detection: broad phase on boxes, narrow phase in kernels, and a choice of few, well-spread contacts."""

from dataclasses import dataclass

import numpy as np

from taichisoft.contact_surfaces import ContactSurfaces
from taichisoft.kernels import collision as kernels
from taichisoft.kernels import contact_selection
from taichisoft.kernels.runtime import STATIC

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
        moving = surfaces.vertex_owner[surfaces.vertex_range[:, 0]] != STATIC
        first, second = np.triu_indices(surfaces.count, 1)
        possible = moving[first] | moving[second]
        self._possible = np.column_stack([first, second])[possible].astype(np.int32)
        self._near = np.zeros(max(len(surfaces.triangles), len(surfaces.edges)), dtype=np.int32)
        self._make_room(FIRST_CAPACITY)

    def _make_room(self, capacity: int) -> None:
        self._pairs = np.zeros(capacity, dtype=np.int32)
        self._vertices = np.zeros((capacity, 2, 3), dtype=np.int32)
        self._weights = np.zeros((capacity, 2, 3))
        self._normals = np.zeros((capacity, 3))
        self._distances = np.zeros(capacity)

    @property
    def is_needed(self) -> bool:
        """Whether anything can touch anything."""
        return len(self._possible) > 0 or len(self._surfaces.plane_body) > 0

    def find(self, reach: float, depth: float) -> ContactPairs:
        """All locally closest pairs nearer than `reach` [mm], and those slipped through by up to `depth` [mm]."""
        surfaces = self._surfaces
        lower, upper = surfaces.boxes()
        first, second = self._possible.T
        far = max(reach, depth)
        overlap = ((lower[first] <= upper[second] + far) & (lower[second] <= upper[first] + far)).all(axis=1)
        close = np.ascontiguousarray(self._possible[overlap])
        count = self._run_kernels(close, lower, upper, reach, depth)
        if count > len(self._pairs):
            self._make_room(2 * count)
            count = self._run_kernels(close, lower, upper, reach, depth)
        return _without_detours(self._collect(close, count))

    def _run_kernels(self, close: np.ndarray, lower: np.ndarray, upper: np.ndarray, reach: float, depth: float) -> int:
        s = self._surfaces
        count = np.zeros(1, dtype=np.int32)
        store = (count, self._pairs, self._vertices, self._weights, self._normals, self._distances)
        if len(close):
            kernels.vertices_against_triangles(
                close,
                lower,
                upper,
                reach,
                depth,
                s.vertex_range,
                s.triangle_range,
                s.vertex_is_feature,
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
                s.triangle_normal,
                self._near,
                *store,
            )
            kernels.edges_against_edges(
                close,
                lower,
                upper,
                reach,
                min(depth, reach),
                s.edge_range,
                s.edge_is_feature,
                s.edges,
                s.edge_triangles,
                s.triangles,
                s.position,
                s.triangle_normal,
                self._near,
                *store,
            )
        if len(s.plane_body):
            kernels.vertices_against_planes(
                s.plane_point,
                s.plane_normal,
                reach,
                len(close),
                s.count,
                s.vertex_range,
                s.vertex_is_feature,
                s.vertex_owner,
                s.position,
                *store,
            )
        return int(count[0])

    def _collect(self, close: np.ndarray, count: int) -> ContactPairs:
        s = self._surfaces
        pairs = self._pairs[:count]
        plane, surface = np.divmod(pairs - len(close), max(s.count, 1))
        on_plane = pairs >= len(close)
        bodies = np.empty((count, 2), dtype=np.int32)
        bodies[~on_plane] = s.body[close[pairs[~on_plane]]]
        bodies[on_plane, 0] = s.body[surface[on_plane]]
        bodies[on_plane, 1] = s.plane_body[plane[on_plane]]
        vertices, weights = self._vertices[:count].copy(), self._weights[:count].copy()
        normal, distance = self._normals[:count].copy(), self._distances[:count].copy()
        points = np.einsum("csk,cskd->csd", weights, s.position[vertices])
        points[on_plane, 1] = points[on_plane, 0] + distance[on_plane, None] * normal[on_plane]
        return ContactPairs(bodies, vertices, weights, points, normal, distance)


def _without_detours(pairs: ContactPairs) -> ContactPairs:
    """Drop crossed edges that are deeper than the deepest vertex inside, of the same two bodies.

    Where a block has sunk a little into the rim of a table, its vertical edge and the table's edge also look as if
    they had slipped through each other, sideways and by far more: that is not the way out.
    """
    if not pairs.count or pairs.distance.min() >= 0.0:
        return pairs
    key = pair_key(pairs.bodies)
    crossed = (pairs.vertices[:, :, 0] != pairs.vertices[:, :, 1]).all(axis=1)
    _, pair = np.unique(key, return_inverse=True)
    deepest = np.zeros(pair.max() + 1)
    inside = ~crossed & (pairs.distance < 0.0)
    np.minimum.at(deepest, pair[inside], pairs.distance[inside])
    detour = crossed & (deepest[pair] < 0.0) & (pairs.distance < deepest[pair])
    return pairs.take(np.flatnonzero(~detour))


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
