"""Choice of few and well-spread contacts: those that continue from the last step, and the worst of the others."""

import numpy as np

from taichisoft.contact.contact_table import ContactTable
from taichisoft.contact.kernels import contact_reduction as kernels
from taichisoft.contact.kernels.contact_reduction import ADDED, LastContacts
from taichisoft.state import State

SHARE_OF_BODY = 0.2
FIRST_CAPACITY = 256


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
        self._make_room_for_last(FIRST_CAPACITY)

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
