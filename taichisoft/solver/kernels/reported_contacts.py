"""The contacts that a step reports, with their impulses and sliding velocities."""

from typing import NamedTuple

import numpy as np

from taichisoft.contact.kernels.contact_reduction import BEFORE, Choice
from taichisoft.contact.kernels.contacts import Contacts
from taichisoft.runtime.language import Integers, IntegerTable, Vectors, ti, vec3
from taichisoft.runtime.launch import kernel
from taichisoft.solver.kernels.constraint_problem import Iterate
from taichisoft.solver.kernels.row_velocities import contact_basis

# Values of `closest` for a pair of bodies without a closest contact to report.
NONE, TAKES_PART = -1, -2


class ReportedContacts(NamedTuple):
    """The contacts that take part, and the closest contact of other bodies near each other, with spare capacity.

    Attributes:
        count: number of contacts, shape (1,).
        bodies: numbers of the two bodies, shape (capacity, 2).
        point: middle of the two points [mm], shape (capacity, 3).
        normal: unit vector from the first body to the second, shape (capacity, 3).
        impulse: impulse on the second body [mN s], shape (capacity, 3).
        slip: sliding velocity of the second body on the first if pressed, else 0 [mm/s], shape (capacity, 3).
        closest: work space: the closest contact of each pair of bodies, shape (body_count, body_count).
    """

    count: Integers
    bodies: IntegerTable
    point: Vectors
    normal: Vectors
    impulse: Vectors
    slip: Vectors
    closest: IntegerTable

    @classmethod
    def with_room(cls, capacity: int, body_count: int) -> "ReportedContacts":
        """Empty arrays for `capacity` contacts."""
        return cls(
            count=np.zeros(1, dtype=np.int32),
            bodies=np.zeros((capacity, 2), dtype=np.int32),
            point=np.zeros((capacity, 3)),
            normal=np.zeros((capacity, 3)),
            impulse=np.zeros((capacity, 3)),
            slip=np.zeros((capacity, 3)),
            closest=np.zeros((body_count, body_count), dtype=np.int32),
        )


@kernel
def report_contacts(
    alarm_distance: ti.f64,
    contacts: Contacts,
    choice: Choice,
    contact_impulse: Vectors,
    solved: Iterate,
    reported: ReportedContacts,
):
    """Fill in the contacts in their order; bodies are near each other within `alarm_distance` [mm]."""
    ti.loop_config(serialize=True)
    for _ in range(1):
        for first in range(reported.closest.shape[0]):
            for second in range(reported.closest.shape[1]):
                reported.closest[first, second] = NONE
        for c in range(contacts.count[0]):
            first, second = contacts.bodies[c, 0], contacts.bodies[c, 1]
            best = reported.closest[first, second]
            if choice.status[c] >= BEFORE:
                reported.closest[first, second] = TAKES_PART
            elif best != TAKES_PART:
                closest = alarm_distance
                if best != NONE:
                    closest = contacts.distance[best]
                if contacts.distance[c] < closest:
                    reported.closest[first, second] = c
        reported.count[0] = 0
        row = 0
        for c in range(contacts.count[0]):
            takes_part = choice.status[c] >= BEFORE
            if takes_part or reported.closest[contacts.bodies[c, 0], contacts.bodies[c, 1]] == c:
                k = reported.count[0]
                reported.count[0] = k + 1
                reported.bodies[k, 0] = contacts.bodies[c, 0]
                reported.bodies[k, 1] = contacts.bodies[c, 1]
                reported.point[k] = 0.5 * (contacts.points[c, 0] + contacts.points[c, 1])
                reported.normal[k] = contacts.normal[c]
                reported.impulse[k] = vec3(0.0)
                reported.slip[k] = vec3(0.0)
                if takes_part:
                    reported.impulse[k] = contact_impulse[c]
                    if solved.impulse[3 * row] > 0.0:
                        along_first, along_second = solved.velocity[3 * row + 1], solved.velocity[3 * row + 2]
                        basis = contact_basis(contacts.normal[c])
                        for d in ti.static(range(3)):
                            reported.slip[k][d] = along_first * basis[1, d] + along_second * basis[2, d]
            if takes_part:
                row += 1
