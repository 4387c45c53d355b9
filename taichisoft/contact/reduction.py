"""Which of the contacts found become constraints: few and well-spread ones, and what they were in the last step."""

import numpy as np

from taichisoft.kernels import contact_reduction as kernels
from taichisoft.kernels.contact_reduction import LastContacts, ReductionSpace
from taichisoft.kernels.contacts import Contacts
from taichisoft.state import State

SHARE_OF_BODY = 0.2
FIRST_CAPACITY = 256


class ContactReduction:
    """Chooses contacts; the work space of one simulation."""

    def __init__(self, body_size: np.ndarray, spacing: float):
        """Prepare for bodies of these sizes.

        Args:
            body_size: smallest extent of each body [mm], infinite for those that do not count, shape (body_count,).
            spacing: distance that contacts are to keep from each other [mm]. It is at most a share of the smaller body,
                which would tip over a missing contact.
        """
        self._spacing = np.minimum(spacing, SHARE_OF_BODY * np.minimum(body_size[:, None], body_size))
        self._make_room(0)
        self._make_room_for_last(FIRST_CAPACITY)

    def _make_room(self, capacity: int) -> None:
        self._kept = Contacts.with_room(capacity)
        self._impulse = np.zeros((capacity, 3))
        self._space = ReductionSpace(
            middle=np.zeros((capacity, 3)),
            matched=np.zeros(capacity, dtype=np.int32),
            key=np.zeros((capacity, 1)),
            order=np.zeros(capacity, dtype=np.int32),
            spare=np.zeros(capacity, dtype=np.int32),
            chosen=np.zeros(capacity, dtype=np.int32),
        )

    def _make_room_for_last(self, capacity: int) -> None:
        self._last = LastContacts(
            count=np.zeros(1, dtype=np.int32),
            bodies=np.zeros((capacity, 2), dtype=np.int32),
            point=np.zeros((capacity, 3)),
            impulse=np.zeros((capacity, 3)),
            used=np.zeros(capacity, dtype=np.int32),
        )

    def reduce(self, found: Contacts, state: State) -> Contacts:
        """Of contacts between the same bodies, alike and closer together than the spacing, only the closest.

        Nearly equal contacts give nearly dependent constraints, on which a Gauss-Seidel converges slowly.

        What was a contact in the step that led to `state` stays one unless another is clearly closer: at rest all
        distances are equal but for round-off, and contacts that change with it find no warm start.

        The result is in arrays that the next call uses again.
        """
        if not found.count[0]:
            self._kept.count[0] = 0
            return self._kept
        if len(found.distance) > len(self._kept.distance):
            self._make_room(len(found.distance))
        self._remember(state)
        kernels.reduce(found, self._last, self._spacing, self._space, self._kept)
        return self._kept

    def last_impulses(self, contacts: Contacts, state: State, radius: float) -> np.ndarray:
        """Impulses of contacts that `reduce` gave, in the step that led to `state` [mN s], shape (capacity, 3).

        They go on from the nearest contact within `radius` [mm] then; the impulse of a new one is 0. The array is used
        again by the next call.
        """
        if contacts.count[0]:
            self._remember(state)
            kernels.last_impulses(contacts, self._last, radius, self._space, self._impulse)
        return self._impulse

    def _remember(self, state: State) -> None:
        """Copy the contacts of the last step into arrays that stay in place."""
        count = len(state.contact_point)
        if count > len(self._last.point):
            self._make_room_for_last(2 * count)
        self._last.count[0] = count
        self._last.bodies[:count] = state.contact_body_pair
        self._last.point[:count] = state.contact_point
        self._last.impulse[:count] = state.contact_impulse
