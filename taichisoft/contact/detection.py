"""Contact detection, the table of a step's contacts, and their thinning."""

from typing import NamedTuple

import numpy as np

from taichisoft.contact.kernels import separation as kernels
from taichisoft.contact.kernels import shape_surface_contacts
from taichisoft.contact.kernels.box_trees import FAR
from taichisoft.contact.kernels.contacts import PLACE_COLUMNS, Contacts, Search, SearchSpace, SelfTouching
from taichisoft.contact.kernels.separation import ADDED, BEFORE, TAKING_PART, Choice, LastContacts, Separation
from taichisoft.contact.kernels.smooth_contacts import smooth_against_planes, smooth_against_surfaces
from taichisoft.contact.kernels.vertex_contacts import find_contacts, find_self_contacts, order_contacts
from taichisoft.contact.surfaces import ContactSurfaces, MovingSurfaces, most_leaves
from taichisoft.mechanics.state import State

# The contacts of a step in one table: a contact keeps its number from the search to the report.


class ContactTable(NamedTuple):
    """One row per contact; each column is written by one stage of the step only.

    All arrays have spare capacity, and are reused from step to step as long as they are large enough.

    Attributes:
        found: stage 1, search (`ContactPrediction`): the pairs of points, each measured at a time of the step under the
            assumption that all bodies keep their velocities.
        fraction: stage 1: fraction of the step after which each pair was measured [-], shape (capacity,).
        separation: stage 2, start of the step (`ActiveSet`): arms, depths, gap rates and speeds.
        choice: stage 3, active set: the contacts that take part in the constraint problem.
        impulse: stage 4, solution: impulse on the second body [mN s], shape (capacity, 3); until then the impulse of
            the last step.
    """

    found: Contacts
    fraction: np.ndarray
    separation: Separation
    choice: Choice
    impulse: np.ndarray

    @classmethod
    def with_room(cls, found: Contacts, fraction: np.ndarray) -> "ContactTable":
        """A table of the contacts `found`, with empty columns for the later stages."""
        capacity = len(fraction)
        choice = Choice(
            status=np.zeros(capacity, dtype=np.int32),
            wanted=np.zeros(capacity, dtype=np.int32),
            gap=np.zeros(capacity),
            count=np.zeros(2, dtype=np.int32),
        )
        return cls(found, fraction, Separation.with_room(capacity), choice, np.zeros((capacity, 3)))

    def holding(self, found: Contacts, fraction: np.ndarray) -> "ContactTable":
        """A table of the contacts `found`, in the same columns if their capacity suffices."""
        if len(fraction) > len(self.impulse):
            return ContactTable.with_room(found, fraction)
        return self._replace(found=found, fraction=fraction)

    @property
    def contact_count(self) -> int:
        """Number of contacts."""
        return int(self.found.count[0])

    @property
    def chosen_count(self) -> int:
        """Number of contacts that take part in the constraint problem."""
        return int(self.choice.count[TAKING_PART])

    @property
    def is_chosen(self) -> np.ndarray:
        """Whether each contact takes part in the constraint problem, shape (contact_count,)."""
        chosen: np.ndarray = self.choice.status[: self.contact_count] >= BEFORE
        return chosen

    @property
    def gap(self) -> np.ndarray:
        """Gaps at the end of the step by the last measured velocities [mm], shape (contact_count,)."""
        return self.choice.gap[: self.contact_count]

    @property
    def depth(self) -> float:
        """Largest intrusion into the contact distance at the start of the step [mm]."""
        return -float(self.separation.depth[self._deepest]) if self._deepest >= 0 else 0.0

    @property
    def deepest(self) -> tuple[int, ...]:
        """Numbers of the two bodies with the deepest intrusion at the start; empty if all kept the contact distance."""
        return tuple(self.found.bodies[self._deepest].tolist()) if self._deepest >= 0 else ()

    @property
    def _deepest(self) -> int:
        return int(self.separation.deepest[0]) if self.contact_count else -1


NO_CONTACTS = ContactTable.with_room(Contacts.with_room(0), np.zeros(0))


# Choice of few and well-spread contacts: those that continue from the last step, and the worst of the others.

SHARE_OF_BODY = 0.2
LAST_STEP_CAPACITY = 256


class ContactReduction:
    """Chooses the contacts of a table that take part; holds the work space of one simulation."""

    def __init__(self, body_size: np.ndarray, spacing: float, contact_distance: float):
        """Allocate the work space.

        Args:
            body_size: smallest extent of each body [mm], infinite for bodies without a size, shape (body_count,).
            spacing: distance within which only one contact is added at a time [mm], limited to a fraction of the
                smaller body, which would tip over a missing contact.
            contact_distance: distance that surfaces are kept apart [mm].
        """
        self._radius = max(spacing, contact_distance)
        self._spacing = np.minimum(spacing, SHARE_OF_BODY * np.minimum(body_size[:, None], body_size))
        self._make_room_for_last(LAST_STEP_CAPACITY)

    def _make_room_for_last(self, capacity: int) -> None:
        self._last = LastContacts(
            count=np.zeros(1, dtype=np.int32),
            bodies=np.zeros((capacity, 2), dtype=np.int32),
            point=np.zeros((capacity, 3)),
            normal=np.zeros((capacity, 3)),
            impulse=np.zeros((capacity, 3)),
        )

    def begin(self, table: ContactTable, state: State) -> None:
        """Choose only the contacts that pushed in the step that led to `state`, with their impulses."""
        self._remember(state)
        kernels.continue_contacts(table.found, self._last, self._radius, table.choice, table.impulse)

    def add(self, table: ContactTable, wanted: np.ndarray, gap: np.ndarray, beside: bool) -> bool:
        """Add the worst wanted contact of each neighbourhood; returns whether any was added.

        Args:
            table: all contacts.
            wanted: whether each contact should take part, shape (contact_count,).
            gap: gap at the end of the step [mm]; the smallest is the worst, shape (contact_count,).
            beside: whether a contact may be added in the neighbourhood of one that takes part already.
        """
        table.choice.wanted[: len(wanted)], table.choice.gap[: len(gap)] = wanted, gap
        return self.add_wanted(table, beside)

    def add_wanted(self, table: ContactTable, beside: bool) -> bool:
        """Call `add` for the contacts marked as wanted in the table."""
        kernels.choose_worst(table.found, self._spacing, 0 if beside else 1, table.choice)
        return bool(table.choice.count[ADDED])

    def _remember(self, state: State) -> None:
        """Copy the contacts of the last step into reused arrays."""
        count = len(state.contact_impulse)
        if count > len(self._last.point):
            self._make_room_for_last(2 * count)
        self._last.count[0] = count
        self._last.bodies[:count] = state.contact_body_pair
        self._last.point[:count] = state.contact_point
        self._last.normal[:count] = state.contact_normal
        self._last.impulse[:count] = state.contact_impulse


# Contact detection: pairs of close points on two surfaces.

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
        touching = surfaces.touching_itself if contact_distance is not None else np.zeros(0, dtype=np.int32)
        limits = (contact_distance or 0.0) * np.array([NEIGHBOURHOOD, 1.0])
        self._touching = SelfTouching(touching, surfaces.carriers.local, limits)
        self._moving = moving
        shapes = surfaces.shapes
        others = surfaces.topology.pairs, surfaces.planes.body, shapes.moving, shapes.surface_pairs
        with_others = any(map(len, others))
        self._is_needed = with_others or len(touching) > 0
        self._reach = np.zeros((len(surfaces.body_size), len(surfaces.body_size)))
        self._make_room(FIRST_CAPACITY)

    def _make_room(self, capacity: int) -> None:
        most_triangles = int(np.diff(self._surfaces.triangle_range).max(initial=0))
        s = self._surfaces
        space = SearchSpace(
            leaf=np.zeros(most_leaves(s.trees), dtype=np.int32),
            triangle=np.zeros(most_triangles, dtype=np.int32),
            weights=np.zeros((most_triangles, 3)),
            place=np.zeros((capacity, PLACE_COLUMNS)),
            order=np.zeros(capacity, dtype=np.int32),
            spare=np.zeros(capacity, dtype=np.int32),
        )
        moving = self._moving
        self._search = Search(
            reaches=self._reach,
            surfaces=s.topology,
            trees=s.trees,
            planes=s.planes,
            moved=moving.moved,
            smooth=moving.smooth,
            shapes=s.shapes,
            there=moving.shapes,
            touching=self._touching,
            space=space,
            found=Contacts.with_room(capacity),
        )
        self._contacts = Contacts.with_room(capacity)

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
            self._search_all(depth)
            found = self._search.found
            if found.count[0] > len(found.distance):
                self._make_room(2 * int(found.count[0]))
                self._search_all(depth)
        return self._contacts

    def _search_all(self, depth: float) -> None:
        search = self._search
        find_contacts(search, depth, self._extent, self._contacts)
        if len(search.smooth.pairs):
            smooth_against_surfaces(search, depth)
        if len(search.smooth.vertices) and len(search.planes.body):
            smooth_against_planes(search)
        if len(search.shapes.surface_pairs):
            shape_surface_contacts.find_on_surfaces(search, depth)
        if len(search.shapes.body) and len(search.planes.body):
            shape_surface_contacts.find_on_planes(search)
        if len(search.shapes.shape_pairs):
            shape_surface_contacts.find_on_shapes(search)
        if len(search.touching.surface):
            find_self_contacts(search)
        if len(search.smooth.vertices) or len(search.shapes.body) or len(search.touching.surface):
            order_contacts(search, self._contacts)
