"""Which contacts are kept, and which of the last step they continue."""

from typing import NamedTuple

from taichisoft.kernels.contacts import Contacts, copy_contact
from taichisoft.kernels.launch import func, kernel
from taichisoft.kernels.runtime import Integers, IntegerTable, ScalarTable, Vectors, ti, vec3
from taichisoft.kernels.sorting import sort_rows

ALIKE = 0.7  # cosine: the two walls of a groove each keep their contacts
SAME_CONTACT = 0.5  # [mm] moved in a step
CLEARLY_CLOSER = 0.05  # [mm]


class LastContacts(NamedTuple):
    """The contacts of the last step, in arrays with room for more.

    Attributes:
        count: number of contacts, shape (1,).
        bodies: numbers of the two bodies, shape (capacity, 2).
        point: midpoints [mm], shape (capacity, 3).
        impulse: impulses on the second body [mN s], shape (capacity, 3).
        used: whether a contact of this step continues them, shape (capacity,); work space.
    """

    count: Integers
    bodies: IntegerTable
    point: Vectors
    impulse: Vectors
    used: Integers


class ReductionSpace(NamedTuple):
    """Work space for as many contacts as can be found.

    Attributes:
        middle: midpoints [mm], shape (capacity, 3).
        matched: the contact of the last step that each one continues, -1 for none, shape (capacity,).
        key: what the contacts are sorted by, shape (capacity, 1).
        order, spare: their order, and work space to find it, shape (capacity,).
        chosen: whether each one is kept, shape (capacity,).
    """

    middle: Vectors
    matched: Integers
    key: ScalarTable
    order: Integers
    spare: Integers
    chosen: Integers


@func
def match(contacts: Contacts, last: LastContacts, radius: ti.f64, space: ReductionSpace):
    """Match each contact with the nearest one of the last step between the same bodies within `radius`.

    Each contact of the last step is matched once at most.
    """
    for k in range(last.count[0]):
        last.used[k] = 0
    for c in range(contacts.count[0]):
        middle = 0.5 * (contacts.points[c, 0] + contacts.points[c, 1])
        nearest = radius * radius
        matched = -1
        for k in range(last.count[0]):
            if (
                last.bodies[k, 0] == contacts.bodies[c, 0]
                and last.bodies[k, 1] == contacts.bodies[c, 1]
                and last.used[k] == 0
            ):
                distance = (last.point[k] - middle).norm_sqr()
                if distance < nearest:
                    nearest = distance
                    matched = k
        if matched >= 0:
            last.used[matched] = 1
        space.middle[c] = middle
        space.matched[c] = matched


@func
def choose(contacts: Contacts, spacing: ScalarTable, space: ReductionSpace):
    """Choose the contacts, in their order, that are alike in normal with no chosen one of the same bodies nearby."""
    chosen_count = 0
    for i in range(contacts.count[0]):
        c = space.order[i]
        first, second = contacts.bodies[c, 0], contacts.bodies[c, 1]
        apart = spacing[first, second]
        stands_alone = 1
        for j in range(chosen_count):
            other = space.spare[j]
            if (
                contacts.bodies[other, 0] == first
                and contacts.bodies[other, 1] == second
                and (space.middle[other] - space.middle[c]).norm_sqr() < apart * apart
                and contacts.normal[other].dot(contacts.normal[c]) > ALIKE
            ):
                stands_alone = 0
                break
        space.chosen[c] = stands_alone
        if stands_alone:
            space.spare[chosen_count] = c
            chosen_count += 1


@kernel
def reduce(found: Contacts, last: LastContacts, spacing: ScalarTable, space: ReductionSpace, kept: Contacts):
    """Of contacts alike in bodies and normal and closer together than their bodies' `spacing` [mm] keep the closest.

    What was a contact in the last step stays one unless another is clearly closer. Contacts are kept in the order in
    which they were found.
    """
    ti.loop_config(serialize=True)
    for _ in range(1):
        match(found, last, SAME_CONTACT, space)
        for c in range(found.count[0]):
            space.key[c, 0] = found.distance[c]
            if space.matched[c] >= 0:
                space.key[c, 0] = found.distance[c] - CLEARLY_CLOSER
        sort_rows(found.count[0], space.key, space.order, space.spare)
        choose(found, spacing, space)
        count = 0
        for c in range(found.count[0]):
            if space.chosen[c]:
                copy_contact(found, c, kept, count)
                count += 1
        kept.count[0] = count


@kernel
def last_impulses(contacts: Contacts, last: LastContacts, radius: ti.f64, space: ReductionSpace, impulse: Vectors):
    """Impulses of the contacts of the last step that these continue, 0 for new ones."""
    ti.loop_config(serialize=True)
    for _ in range(1):
        match(contacts, last, radius, space)
        for c in range(contacts.count[0]):
            impulse[c] = vec3(0.0)
            if space.matched[c] >= 0:
                impulse[c] = last.impulse[space.matched[c]]
