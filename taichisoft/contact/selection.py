"""Which of the contacts found become constraints: few and well-spread ones, and what they were in the last step."""

import numpy as np

from taichisoft.contact.detection import ContactPairs
from taichisoft.kernels import contact_selection as kernels
from taichisoft.state import State

FIRST_CAPACITY = 256
SAME_CONTACT = 0.5  # [mm] moved in a step
CLEARLY_CLOSER = 0.05  # [mm]
SHARE_OF_BODY = 0.2


class ContactSelection:
    """Chooses contacts; keeps its buffers between steps, since a launch with new arrays takes longer than its work."""

    def __init__(self, body_size: np.ndarray):
        """Prepare for bodies of these smallest extents [mm], infinite for those that do not count."""
        self._largest_spacing = SHARE_OF_BODY * np.minimum(body_size[:, None], body_size)
        self._kept_count = np.zeros(1, dtype=np.int32)
        self._make_room(FIRST_CAPACITY)
        self._make_room_for_last(FIRST_CAPACITY)

    def _make_room(self, capacity: int) -> None:
        self._key = np.zeros(capacity, dtype=np.int32)
        self._middle = np.zeros((capacity, 3))
        self._normal = np.zeros((capacity, 3))
        self._order = np.zeros(capacity, dtype=np.int32)
        self._matched = np.zeros(capacity, dtype=np.int32)
        self._spacing = np.zeros(capacity)
        self._kept = np.zeros(capacity, dtype=np.int32)

    def _make_room_for_last(self, capacity: int) -> None:
        self._last_key = np.zeros(capacity, dtype=np.int32)
        self._last_point = np.zeros((capacity, 3))
        self._used = np.zeros(capacity, dtype=np.int32)

    def spread_out(
        self, pairs: ContactPairs, spacing: float, last_key: np.ndarray, last_point: np.ndarray
    ) -> ContactPairs:
        """Of contacts between the same bodies, alike and closer together than `spacing` [mm], only the closest.

        Nearly equal contacts give nearly dependent constraints, on which a Gauss-Seidel converges slowly. The spacing
        is at most a share of the smaller body, which would tip over a missing one.

        What was a contact in the last step (`last_key` and `last_point`, see State) stays one unless another is
        clearly closer: at rest all distances are equal but for round-off, and contacts that change with it find no
        warm start.
        """
        count = pairs.count
        if count == 0:
            return pairs
        goes_on = self.match(pairs, last_key, last_point, SAME_CONTACT) >= 0
        self._order[:count] = np.argsort(pairs.distance - CLEARLY_CLOSER * goes_on, kind="stable")
        first, second = pairs.bodies.T
        np.minimum(spacing, self._largest_spacing[first, second], out=self._spacing[:count])
        self._normal[:count] = pairs.normal
        kernels.spread_out(
            count,
            self._order,
            self._key,
            self._middle,
            self._normal,
            self._spacing,
            self._kept_count,
            self._kept,
        )
        # In the order in which they were found, whichever is the closest.
        return pairs.take(np.sort(self._kept[: self._kept_count[0]]))

    def last_impulses(self, pairs: ContactPairs, state: State, radius: float) -> np.ndarray:
        """Impulses of the contacts in the step that led to `state` [mN s], shape (count, 3).

        They go on from the nearest contact within `radius` [mm] then; the impulse of a new one is 0.
        """
        result = np.zeros((pairs.count, 3))
        if pairs.count:
            matched = self.match(pairs, state.contact_key, state.contact_point, radius)
            known = np.flatnonzero(matched >= 0)
            result[known] = state.contact_impulse[matched[known]]
        return result

    def match(self, pairs: ContactPairs, last_key: np.ndarray, last_point: np.ndarray, radius: float) -> np.ndarray:
        """For each contact the index of the nearest one of the last step between the same bodies, -1 for none.

        Args:
            pairs: the contacts.
            last_key: pairs of bodies of the last step's contacts, shape (last_count,); each is matched once at most.
            last_point: where these were [mm], shape (last_count, 3).
            radius: [mm] beyond which they are different contacts.
        """
        count, last_count = pairs.count, len(last_key)
        if count > len(self._key):
            self._make_room(2 * count)
        if last_count > len(self._last_key):
            self._make_room_for_last(2 * last_count)
        self._key[:count] = pairs.key
        self._middle[:count] = pairs.middle
        self._last_key[:last_count] = last_key
        self._last_point[:last_count] = last_point
        kernels.match(
            count,
            self._key,
            self._middle,
            last_count,
            self._last_key,
            self._last_point,
            radius,
            self._used,
            self._matched,
        )
        return self._matched[:count].copy()
