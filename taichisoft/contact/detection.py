"""Contact detection: pairs of close points on two surfaces."""

import numpy as np

from taichisoft.contact.bounding_volumes import most_leaves
from taichisoft.contact.kernels import shape_search
from taichisoft.contact.kernels.approach import FAR
from taichisoft.contact.kernels.contact_search import find_contacts, order_contacts
from taichisoft.contact.kernels.contacts import PLACE_COLUMNS, Contacts, SearchSpace
from taichisoft.contact.kernels.self_contacts import SelfTouching, find_self_contacts
from taichisoft.contact.kernels.smooth_contacts import smooth_against_planes, smooth_against_surfaces
from taichisoft.contact.moving_surfaces import MovingSurfaces
from taichisoft.contact.surfaces import ContactSurfaces

FIRST_CAPACITY = 1024
# Parts of a body closer to each other at rest than this number of contact distances do not touch each other.
NEIGHBOURHOOD = 2.0


class ContactDetection:
    """Finds the contacts of a set of surfaces; holds the work space of one simulation."""

    def __init__(self, surfaces: ContactSurfaces, moving: MovingSurfaces, contact_distance: float | None = None):
        """Allocate the work space.

        Args:
            surfaces: surfaces, round shapes and planes.
            moving: their current positions, read by every call of `find`.
            contact_distance: distance that surfaces are kept apart [mm]; None: no self-contact.
        """
        self._surfaces = surfaces
        self._extent = np.minimum(surfaces.body_size, FAR)
        self._touching_itself: SelfTouching | None = None
        if contact_distance is not None and len(surfaces.touching_itself):
            limits = np.array([NEIGHBOURHOOD * contact_distance, contact_distance])
            self._touching_itself = SelfTouching(surfaces.touching_itself, surfaces.carriers.local, limits)
        self._moved, self._shapes, self._smooth = moving.moved, moving.shapes, moving.smooth
        shapes = surfaces.shapes
        others = surfaces.topology.pairs, surfaces.planes.body, shapes.moving, shapes.surface_pairs
        with_others = any(map(len, others))
        self._is_needed = with_others or self._touching_itself is not None
        self._reach = np.zeros((len(surfaces.body_size), len(surfaces.body_size)))
        self._make_room(FIRST_CAPACITY)

    def _make_room(self, capacity: int) -> None:
        self._found, self._contacts = Contacts.with_room(capacity), Contacts.with_room(capacity)
        most_triangles = int(np.diff(self._surfaces.triangle_range).max(initial=0))
        self._space = SearchSpace(
            leaf=np.zeros(most_leaves(self._surfaces.trees), dtype=np.int32),
            triangle=np.zeros(most_triangles, dtype=np.int32),
            weights=np.zeros((most_triangles, 3)),
            deepest=np.zeros(len(self._surfaces.topology.pairs)),
            place=np.zeros((capacity, PLACE_COLUMNS)),
            order=np.zeros(capacity, dtype=np.int32),
            spare=np.zeros(capacity, dtype=np.int32),
        )

    def find(self, reach: float | np.ndarray, depth: float) -> Contacts:
        """Find all locally closest pairs of points on two surfaces.

        Contacts of vertices with triangles come first, then edges, planes, self-contacts and round shapes, each in the
        order of the surfaces' arrays. The next call overwrites the result.

        Args:
            reach: largest distance of a pair [mm], one for all or one for each two bodies, shape
                (body_count, body_count); negative: this pair of bodies is skipped.
            depth: largest penetration of a pair [mm].
        """
        self._reach[:] = reach
        if self._is_needed:
            self._search(depth)
            if self._found.count[0] > len(self._found.distance):
                self._make_room(2 * int(self._found.count[0]))
                self._search(depth)
        return self._contacts

    def _search(self, depth: float) -> None:
        s = self._surfaces
        space, found = self._space, self._found
        find_contacts(
            self._reach, depth, self._extent, s.topology, s.trees, s.planes, self._moved, space, found, self._contacts
        )
        if len(self._smooth.vertices):
            self._search_smooth(depth)
        if len(s.shapes.body):
            self._search_shapes(depth)
        if self._touching_itself is not None:
            find_self_contacts(self._reach, self._touching_itself, s.topology, s.trees, self._moved, space, found)
        if len(self._smooth.vertices) or len(s.shapes.body) or self._touching_itself is not None:
            order_contacts(self._space, self._found, self._contacts)

    def _search_smooth(self, depth: float) -> None:
        s, reach, space, found = self._surfaces, self._reach, self._space, self._found
        if len(self._smooth.pairs):
            smooth_against_surfaces(reach, depth, s.topology, s.trees, self._moved, self._smooth, space, found)
        if len(s.planes.body):
            smooth_against_planes(reach, s.topology, s.trees, s.planes, self._moved, self._smooth, space, found)

    def _search_shapes(self, depth: float) -> None:
        s, reach, there, space, found = self._surfaces, self._reach, self._shapes, self._space, self._found
        if len(s.shapes.surface_pairs):
            shape_search.find_on_surfaces(reach, depth, s.topology, s.trees, self._moved, s.shapes, there, space, found)
        if len(s.planes.body):
            shape_search.find_on_planes(reach, s.planes, s.shapes, there, space, found)
        if len(s.shapes.shape_pairs):
            shape_search.find_on_shapes(reach, s.shapes, there, space, found)
