"""Choice of the contacts in the constraint problem of a step, and their match with contacts of the last step."""

from typing import NamedTuple

from taichisoft.contact.kernels.contacts import Contacts
from taichisoft.runtime.language import Integers, IntegerTable, Scalars, ScalarTable, Vectors, func, ti, vec3
from taichisoft.runtime.launch import kernel

ALIKE = 0.7  # least cosine between normals of one neighbourhood: the two walls of a groove are two
NONE, WANTED, BEFORE, NEW = range(4)
# Entries of `Choice.count`.
TAKING_PART, ADDED = range(2)


class LastContacts(NamedTuple):
    """The contacts of the last step, in arrays with spare capacity.

    Attributes:
        count: number of contacts, shape (1,).
        bodies: numbers of the two bodies, shape (capacity, 2).
        point: midpoints [mm], shape (capacity, 3).
        normal: unit vectors from the first body to the second, shape (capacity, 3).
        impulse: impulses on the second body [mN s], shape (capacity, 3).
    """

    count: Integers
    bodies: IntegerTable
    point: Vectors
    normal: Vectors
    impulse: Vectors


class Choice(NamedTuple):
    """The contacts that take part in the constraint problem, in arrays with spare capacity.

    Attributes:
        status: NONE: left out; WANTED: candidate, of which the worst of each neighbourhood will take part; BEFORE, NEW:
            takes part since earlier or since the last call, shape (capacity,).
        wanted: 1 for contacts that should take part, whether or not they do already, shape (capacity,).
        gap: gap at the end of the step [mm]; the smallest is the worst, shape (capacity,).
        count: number of contacts that take part (TAKING_PART), and number added last (ADDED), shape (2,).
    """

    status: Integers
    wanted: Integers
    gap: Scalars
    count: Integers


@kernel
def continue_contacts(contacts: Contacts, last: LastContacts, radius: ti.f64, choice: Choice, impulse: Vectors):
    """Continue each contact of the last step that pushed: the nearest new contact takes part with its impulse.

    The new contact has the same bodies and a similar normal, lies within `radius` [mm], and continues one contact at
    most. The impulses of all other contacts become 0.
    """
    ti.loop_config(serialize=True)
    for _ in range(1):
        for c in range(contacts.count[0]):
            impulse[c] = vec3(0.0)
            choice.status[c] = NONE
        choice.count[TAKING_PART] = 0
        for k in range(last.count[0]):
            nearest = radius * radius
            if (last.impulse[k] == 0.0).all():
                nearest = 0.0
            match = -1
            for c in range(contacts.count[0]):
                if (
                    contacts.bodies[c, 0] == last.bodies[k, 0]
                    and contacts.bodies[c, 1] == last.bodies[k, 1]
                    and choice.status[c] == NONE
                ):
                    middle = 0.5 * (contacts.points[c, 0] + contacts.points[c, 1])
                    distance = (last.point[k] - middle).norm_sqr()
                    if distance < nearest and contacts.normal[c].dot(last.normal[k]) > ALIKE:
                        nearest = distance
                        match = c
            if match >= 0:
                choice.status[match] = BEFORE
                choice.count[TAKING_PART] = choice.count[TAKING_PART] + 1
                impulse[match] = last.impulse[k]


@kernel
def choose_worst(contacts: Contacts, spacing: ScalarTable, all_count: ti.i32, choice: Choice):
    """Add the worst wanted contact of each neighbourhood.

    A neighbourhood consists of contacts of the same bodies with similar normals, closer to each other than `spacing`
    [mm] of their bodies. If `all_count` is not 0, no contact is added in the neighbourhood of one that takes part.
    """
    ti.loop_config(serialize=True)
    for _ in range(1):
        choice.count[ADDED] = 0
        for c in range(contacts.count[0]):
            if choice.status[c] == NEW:
                choice.status[c] = BEFORE
            elif choice.status[c] != BEFORE:
                choice.status[c] = NONE
                if choice.wanted[c] != 0:
                    choice.status[c] = WANTED
        if all_count != 0:
            for c in range(contacts.count[0]):
                if choice.status[c] == BEFORE:
                    for other in range(contacts.count[0]):
                        if choice.status[other] == WANTED and is_near(c, other, contacts, spacing):
                            choice.status[other] = NONE
        worst = 0
        while worst >= 0:
            worst = -1
            for c in range(contacts.count[0]):
                if choice.status[c] == WANTED and (worst < 0 or choice.gap[c] < choice.gap[ti.max(worst, 0)]):
                    worst = c
            if worst >= 0:
                choice.status[worst] = NEW
                choice.count[ADDED] = choice.count[ADDED] + 1
                for other in range(contacts.count[0]):
                    if choice.status[other] == WANTED and is_near(worst, other, contacts, spacing):
                        choice.status[other] = NONE
        choice.count[TAKING_PART] = choice.count[TAKING_PART] + choice.count[ADDED]


@func
def is_near(c: ti.i32, other: ti.i32, contacts: Contacts, spacing: ScalarTable) -> ti.i32:
    """Whether two contacts belong to one neighbourhood."""
    near = 0
    if contacts.bodies[c, 0] == contacts.bodies[other, 0] and contacts.bodies[c, 1] == contacts.bodies[other, 1]:
        apart = spacing[contacts.bodies[c, 0], contacts.bodies[c, 1]]
        first = 0.5 * (contacts.points[c, 0] + contacts.points[c, 1])
        second = 0.5 * (contacts.points[other, 0] + contacts.points[other, 1])
        if (first - second).norm_sqr() < apart * apart and contacts.normal[c].dot(contacts.normal[other]) > ALIKE:
            near = 1
    return near
