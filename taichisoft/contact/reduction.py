"""Which contacts of the last step go on, and which others take part first: few and well-spread ones."""

import numpy as np

from taichisoft.contact.kernels import contact_reduction as kernels
from taichisoft.contact.kernels.contact_reduction import ADDED, BEFORE, Choice, LastContacts
from taichisoft.contact.kernels.contacts import Contacts
from taichisoft.state import State

SHARE_OF_BODY = 0.2
FIRST_CAPACITY = 256


class ContactReduction:
    """Chooses contacts; the work space of one simulation.

    Attributes:
        choice: which contacts take part, in arrays with room for more.
        impulse: of each contact in the last step, 0 where it is new [mN s], shape (capacity, 3).
    """

    def __init__(self, body_size: np.ndarray, spacing: float, contact_distance: float):
        """Prepare for bodies of these sizes.

        Args:
            body_size: smallest extent of each body [mm], infinite for those that do not count, shape (body_count,).
            spacing: distance within which only one contact is added at a time [mm]. It is at most a share of the
                smaller body, which would tip over a missing contact.
            contact_distance: distance that surfaces are kept apart [mm].
        """
        self._radius = max(spacing, contact_distance)
        self._spacing = np.minimum(spacing, SHARE_OF_BODY * np.minimum(body_size[:, None], body_size))
        self._make_room(0)
        self._make_room_for_last(FIRST_CAPACITY)

    def _make_room(self, capacity: int) -> None:
        self.choice = Choice(
            status=np.zeros(capacity, dtype=np.int32),
            wanted=np.zeros(capacity, dtype=np.int32),
            gap=np.zeros(capacity),
            count=np.zeros(2, dtype=np.int32),
        )
        self.impulse = np.zeros((capacity, 3))

    def _make_room_for_last(self, capacity: int) -> None:
        self._last = LastContacts(
            count=np.zeros(1, dtype=np.int32),
            bodies=np.zeros((capacity, 2), dtype=np.int32),
            point=np.zeros((capacity, 3)),
            normal=np.zeros((capacity, 3)),
            impulse=np.zeros((capacity, 3)),
        )

    @property
    def taking_part(self) -> np.ndarray:
        """Whether each contact does, shape (contact_count,)."""
        taking_part: np.ndarray = self.choice.status[: self._contacts.count[0]] >= BEFORE
        return taking_part

    def begin(self, contacts: Contacts, state: State) -> None:
        """Let those contacts take part that pushed in the step that led to `state`; the others not yet."""
        self._contacts = contacts
        if len(contacts.distance) > len(self.impulse):
            self._make_room(len(contacts.distance))
        self._remember(state)
        kernels.continue_contacts(contacts, self._last, self._radius, self.choice, self.impulse)

    def add(self, wanted: np.ndarray, gap: np.ndarray, beside: bool) -> bool:
        """Let the worst of the wanted contacts take part, one of each neighbourhood; was there any?

        Args:
            wanted: whether each contact is, shape (contact_count,).
            gap: at the end of the step [mm]: the least is the worst, shape (contact_count,).
            beside: whether also those in the neighbourhood of one that takes part already.
        """
        self.choice.wanted[: len(wanted)], self.choice.gap[: len(gap)] = wanted, gap
        return self.add_wanted(beside)

    def add_wanted(self, beside: bool) -> bool:
        """As `add`, for what `choice` says is wanted."""
        kernels.choose_worst(self._contacts, self._spacing, 0 if beside else 1, self.choice)
        return bool(self.choice.count[ADDED])

    def _remember(self, state: State) -> None:
        """Copy the contacts of the last step into arrays that stay in place."""
        count = len(state.contact_impulse)
        if count > len(self._last.point):
            self._make_room_for_last(2 * count)
        self._last.count[0] = count
        self._last.bodies[:count] = state.contact_body_pair
        self._last.point[:count] = state.contact_point
        self._last.normal[:count] = state.contact_normal
        self._last.impulse[:count] = state.contact_impulse
