"""Which contacts take part in the constraint problem of a step, and which of the last step they continue."""

from typing import NamedTuple

from taichisoft.contact.kernels.contacts import Contacts
from taichisoft.runtime.launch import func, kernel
from taichisoft.runtime.taichi_start import Integers, IntegerTable, Scalars, ScalarTable, Vectors, ti, vec3

ALIKE = 0.7  # cosine: the two walls of a groove each keep their contacts
NONE, WANTED, BEFORE, NEW = range(4)
# Entries of `Choice.count`.
TAKING_PART, ADDED = range(2)


class LastContacts(NamedTuple):
    """The contacts of the last step, of which some pushed, in arrays with room for more.

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
    """Which contacts take part, in arrays with room for more.

    Attributes:
        status: NONE; WANTED, of which the worst of each neighbourhood is to take part; BEFORE and NEW for those that
            take part already, shape (capacity,).
        wanted: 1 for contacts that should take part, those that do already too, shape (capacity,).
        gap: at the end of the step [mm]; the least is the worst, shape (capacity,).
        count: of contacts that take part, and of those that were added last, shape (2,).
    """

    status: Integers
    wanted: Integers
    gap: Scalars
    count: Integers


@kernel
def continue_contacts(contacts: Contacts, last: LastContacts, radius: ti.f64, choice: Choice, impulse: Vectors):
    """Let the contact nearest to each one that pushed take part, with its impulse; those of all others are 0.

    It has the same bodies, a normal that is alike, and lies within `radius` [mm]; each is taken once at most.
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
    """Let the worst of the wanted contacts of each neighbourhood take part.

    A neighbourhood are contacts of the same bodies, alike in normal, closer to each other than their bodies' `spacing`
    [mm]. With `all_count` those that took part before count as well: none is wanted next to them.
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
