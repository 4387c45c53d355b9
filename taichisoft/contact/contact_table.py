"""The contacts of a step in one table: a contact keeps its number from the search to the report."""

from typing import NamedTuple

import numpy as np

from taichisoft.contact.kernels.contact_reduction import BEFORE, TAKING_PART, Choice
from taichisoft.contact.kernels.contacts import Contacts
from taichisoft.contact.kernels.separation import Separation


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
