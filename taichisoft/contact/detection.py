"""Contact detection: pairs of close points on two surfaces."""

import numpy as np

from taichisoft.contact.bounding_volumes import most_leaves
from taichisoft.contact.moving_surfaces import MovingSurfaces
from taichisoft.contact.surfaces import ContactSurfaces
from taichisoft.kernels.contacts import PLACE_COLUMNS, Contacts, put_in_order
from taichisoft.kernels.edge_contacts import edges_against_edges
from taichisoft.kernels.vertex_contacts import Nearby, vertices_against_planes, vertices_against_triangles

FIRST_CAPACITY = 1024


class ContactDetection:
    """Finds the contacts of a set of surfaces; the work space of one simulation."""

    def __init__(self, surfaces: ContactSurfaces, moving: MovingSurfaces):
        """Prepare for surfaces and where they are, now and when `find` is called."""
        self._surfaces = surfaces
        self._moved = moving.moved
        most_triangles = int(np.diff(surfaces.triangle_range).max())
        self._near = Nearby(
            leaf=np.zeros(most_leaves(surfaces.trees), dtype=np.int32),
            triangle=np.zeros(most_triangles, dtype=np.int32),
            weights=np.zeros((most_triangles, 3)),
            deepest=np.zeros(len(surfaces.possible_pairs)),
        )
        self._make_room(FIRST_CAPACITY)

    def _make_room(self, capacity: int) -> None:
        self._found, self._contacts = Contacts.with_room(capacity), Contacts.with_room(capacity)
        self._places = np.zeros((capacity, PLACE_COLUMNS))
        self._order, self._spare = np.zeros(capacity, dtype=np.int32), np.zeros(capacity, dtype=np.int32)

    @property
    def is_needed(self) -> bool:
        """Whether anything can touch anything."""
        return len(self._surfaces.possible_pairs) > 0 or len(self._surfaces.planes.body) > 0

    def find(self, reach: float, depth: float) -> Contacts:
        """All locally closest pairs nearer than `reach` [mm], and those slipped through by up to `depth` [mm].

        Vertices with triangles come first, then edges, then planes, each in the order of the surfaces' arrays. The
        result is in arrays that the next call uses again.
        """
        self._search(reach, depth)
        if self._found.count[0] > len(self._places):
            self._make_room(2 * int(self._found.count[0]))
            self._search(reach, depth)
        put_in_order(self._found, self._places, self._order, self._spare, self._contacts)
        return self._contacts

    def _search(self, reach: float, depth: float) -> None:
        surfaces, pairs = self._surfaces, self._surfaces.possible_pairs
        topology, trees, planes = surfaces.topology, surfaces.trees, surfaces.planes
        moved, near, found, places = self._moved, self._near, self._found, self._places
        found.count[0] = 0
        if len(pairs):
            vertices_against_triangles(pairs, reach, depth, topology, trees, moved, near, found, places)
            group, depth = 2 * len(pairs), min(depth, reach)
            edges_against_edges(pairs, reach, depth, group, topology, trees, moved, near, found, places)
        if len(planes.body):
            group = 3 * len(pairs)
            vertices_against_planes(surfaces.moving, reach, group, topology, planes, trees, moved, found, places)
