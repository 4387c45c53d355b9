"""Arms, gap rates and velocities of the contacts of a step, and which contacts may push."""

from typing import NamedTuple

import numpy as np

from taichisoft.contact.kernels.contacts import ROUND, SMOOTH, Carriers, Contacts
from taichisoft.mechanics.kernels.rigid_integration import RigidState
from taichisoft.runtime.arithmetic import rotation_of_vector
from taichisoft.runtime.language import (
    SOFT,
    Integers,
    IntegerTable,
    Scalars,
    ScalarTable,
    Vectors,
    VectorTable,
    func,
    mat3,
    ti,
    vec3,
)
from taichisoft.runtime.launch import kernel

# Choice of the contacts in the constraint problem of a step, and their match with contacts of the last step.

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


# A contact is expected to push if it would close, or touch, within this number of steps at its present velocity.
STEPS_AHEAD = 2.0
# Entries of `terms`, common to all contacts: time step [s]; contact distance [mm]; tolerance of velocities [mm/s];
# 1 if penetrations at the start are kept and moved out later, else 0; 1 if any contact has restitution, else 0; theta;
# 1 if a contact may push at a gap that is larger than its row's, else 0.
TIME_STEP, CONTACT_DISTANCE, TOLERANCE, KEEPS_DEPTH, HAS_RESTITUTION, THETA, MAY_LIFT, TERM_COUNT = range(8)


class Separation(NamedTuple):
    """Quantities of all contacts of a step for the active set, in arrays with spare capacity.

    Attributes:
        arm: from the centre of mass of the rigid body on each side to the point on that side, at the time of the
            measurement [mm], shape (capacity, 2, 3).
        gap_rate: normal velocity at which the gap closes in the step, negative if the gap must open [mm/s], shape
            (capacity,).
        unhurried: part of `gap_rate` that moves nothing in the step, see `begin_separation` [mm/s], shape (capacity,).
        speed: normal velocity of the second point relative to the first [mm/s], shape (capacity,).
        touching: tolerated intrusion into the contact distance [mm], shape (capacity,).
        depth: distance less the contact distance at the start of the step if negative, else 0 [mm], shape (capacity,).
        kept_depth: part of `depth` that remains at the end of the step [mm], shape (capacity,).
        deepest: index of the contact with the smallest depth, -1 without one, shape (1,).
    """

    arm: VectorTable
    gap_rate: Scalars
    unhurried: Scalars
    speed: Scalars
    touching: Scalars
    depth: Scalars
    kept_depth: Scalars
    deepest: Integers

    @classmethod
    def with_room(cls, capacity: int) -> "Separation":
        """Arrays for `capacity` contacts."""
        numbers = (np.zeros(capacity) for _ in range(6))
        return cls(np.zeros((capacity, 2, 3)), *numbers, np.zeros(1, dtype=np.int32))


@func
def turned(vector: vec3, turn: vec3) -> vec3:
    """Rotate a vector by the rotation vector `turn` [rad] (Rodrigues)."""
    angle = turn.norm()
    result = vector
    if angle > 0.0:
        axis = turn / angle
        across = axis.cross(vector)
        result = vector + ti.sin(angle) * across + (1.0 - ti.cos(angle)) * axis.cross(across)
    return result


@kernel
def begin_separation(
    first_rigid: ti.i32,
    terms: Scalars,
    contacts: Contacts,
    fraction: Scalars,
    gap_tolerance: ScalarTable,
    is_round: Integers,
    carriers: Carriers,
    node_velocity: Vectors,
    rigid: RigidState,
    separation: Separation,
    choice: Choice,
):
    """Measure arms, speeds, depths and gap rates at the start of a step, and mark the contacts expected to push.

    The velocities are those before the step; each contact was measured after a `fraction` of the step.

    Bodies move along u = (1 - theta) v0 + theta v, and the law of a contact is on v, the velocity after the step
    (Moreau 1999, Numerical aspects of the sweeping process; Jean 1999, The non-smooth contact dynamics method). What
    closes under v0 gets v_n >= -gap / h, which makes an impact inelastic: v_n = 0 from the step on in which it has
    closed. One that v0 leaves open is not struck, and may close just so far: u_n >= -gap / h, which is
    v_n >= -gap / h - (1 - theta) / theta (gap / h + v0_n). So p_n u_n is never positive, and contacts give no energy.
    """
    ti.loop_config(serialize=True)
    for _ in range(1):
        time_step, fastest, least_depth = terms[TIME_STEP], 0.0, 0.0
        separation.deepest[0] = -1
        for c in range(contacts.count[0]):
            touching = gap_tolerance[contacts.bodies[c, 0], contacts.bodies[c, 1]]
            separation.touching[c] = touching
            passed, gap = time_step * fraction[c], contacts.distance[c] - terms[CONTACT_DISTANCE]
            place_arms(c, first_rigid, passed, gap, contacts, is_round, rigid, separation)
            speed = relative_speed(c, first_rigid, contacts, carriers, node_velocity, rigid, separation)
            fastest = ti.min(fastest, speed)
            at_start = gap
            if fraction[c] > 0.0:
                at_start = ti.max(gap - passed * speed, -touching)
            depth = ti.min(ti.max(gap, at_start), 0.0)
            separation.depth[c] = depth
            if depth < least_depth:
                least_depth = depth
                separation.deepest[0] = c
            separation.speed[c] = speed
            separation.kept_depth[c] = terms[KEEPS_DEPTH] * depth
            separation.gap_rate[c] = (gap - separation.kept_depth[c] - passed * speed) / time_step
        for c in range(contacts.count[0]):
            rate, speed = separation.gap_rate[c], separation.speed[c]
            choice.gap[c] = time_step * (rate + speed) + separation.kept_depth[c]
            choice.wanted[c] = time_step * (rate + STEPS_AHEAD * speed) <= separation.touching[c]
            # An impact may throw a body at its neighbours as fast as the fastest approach.
            closes = time_step * (rate + speed + 2.0 * fastest) < separation.touching[c]
            if terms[HAS_RESTITUTION] != 0.0 and closes:
                choice.wanted[c] = 1
            separation.unhurried[c] = 0.0
            if terms[THETA] < 1.0:
                separation.unhurried[c] = (1.0 - terms[THETA]) / terms[THETA] * ti.max(rate + speed, 0.0)
                separation.gap_rate[c] = rate + separation.unhurried[c]


@kernel
def find_violated(
    first_rigid: ti.i32,
    terms: Scalars,
    contacts: Contacts,
    carriers: Carriers,
    node_velocity: Vectors,
    rigid: RigidState,
    separation: Separation,
    choice: Choice,
    wanted_count: Integers,
):
    """Update speeds and gaps to new velocities; mark and count the excluded contacts that would close."""
    ti.loop_config(serialize=True)
    for _ in range(1):
        wanted_count[0] = 0
        time_step = terms[TIME_STEP]
        for c in range(contacts.count[0]):
            speed = relative_speed(c, first_rigid, contacts, carriers, node_velocity, rigid, separation)
            separation.speed[c] = speed
            kept = separation.kept_depth[c]
            choice.gap[c] = time_step * (separation.gap_rate[c] + speed) + kept
            least = ti.min(kept - time_step * terms[TOLERANCE], -separation.touching[c])
            choice.wanted[c] = 0
            if choice.gap[c] < least and choice.status[c] < BEFORE:
                choice.wanted[c] = 1
                wanted_count[0] = wanted_count[0] + 1


@func
def place_arms(
    c: ti.i32,
    first_rigid: ti.i32,
    passed: ti.f64,
    gap: ti.f64,
    contacts: Contacts,
    is_round: Integers,
    rigid: RigidState,
    separation: Separation,
):
    """Fill in the arms of a contact measured a time `passed` [s] after the start with the velocities before the step.

    The arms, like the `gap` [mm], are taken at the time of the measurement. For a corner or an edge that already
    touches at the start, with a gap below `touching`, they are taken at half that time: then the work of the impulse
    matches the change of the gap, and a body that topples over a corner gains no energy. A round surface passes its
    contact on from vertex to vertex instead.
    """
    turns = 0
    start_gap = gap
    for side in ti.static(range(2)):
        body = contacts.bodies[c, side] - first_rigid
        separation.arm[c, side] = vec3(0.0)
        if body >= 0 and body < rigid.position.shape[0]:
            arm = contacts.points[c, side] - rigid.position[body] - passed * rigid.linear[body]
            separation.arm[c, side] = arm
            if is_corner(c, side, contacts, is_round):
                turns = 1
                arm = turned(arm, -0.5 * passed * rigid.angular[body])
            speed = contacts.normal[c].dot(rigid.linear[body] + rigid.angular[body].cross(arm))
            start_gap -= (2.0 * side - 1.0) * passed * speed
    if turns != 0 and start_gap < separation.touching[c]:
        for side in ti.static(range(2)):
            body = contacts.bodies[c, side] - first_rigid
            if body >= 0 and body < rigid.position.shape[0] and is_corner(c, side, contacts, is_round):
                back = -0.5 * passed * rigid.angular[body]
                separation.arm[c, side] = turned(separation.arm[c, side], back)


@func
def is_corner(c: ti.i32, side: ti.i32, contacts: Contacts, is_round: Integers) -> ti.i32:
    """Whether a contact is at a sharp corner or edge of a rigid body, not at one that represents a round surface."""
    sharp = 0
    weights = contacts.weights[c, side]
    if contacts.vertices[c, side, 0] >= 0 and weights[0] * weights[1] * weights[2] == 0.0:
        for k in ti.static(range(3)):
            if weights[k] > 0.0 and is_round[contacts.vertices[c, side, k]] == 0:
                sharp = 1
    return sharp


@func
def relative_speed(
    c: ti.i32,
    first_rigid: ti.i32,
    contacts: Contacts,
    carriers: Carriers,
    node_velocity: Vectors,
    rigid: RigidState,
    separation: Separation,
) -> ti.f64:
    """Normal velocity of a contact's second point relative to its first [mm/s]."""
    total = 0.0
    for side in range(2):
        v = vec3(0.0)
        for k in ti.static(range(3)):
            vertex = contacts.vertices[c, side, k]
            if vertex >= 0 and carriers.owner[vertex] == SOFT and contacts.weights[c, side][k] != 0.0:
                for m in range(carriers.nodes.shape[1]):
                    weight = contacts.weights[c, side][k] * carriers.weights[vertex, m]
                    v += weight * node_velocity[carriers.nodes[vertex, m]]
        body = contacts.bodies[c, side] - first_rigid
        if body >= 0 and body < rigid.position.shape[0]:
            v = rigid.linear[body] + rigid.angular[body].cross(separation.arm[c, side])
        total += (2.0 * side - 1.0) * contacts.normal[c].dot(v)
    return total


# Rows of contacts that lead to where bodies really are after a step that turns them.
#
# A row is linear in the velocities, and what is on a turning body goes on an arc. In a step with the velocities v and w
# a point at r from the centre of mass moves by h (v + w x m), exactly, with the mean m of r along the arc:
#
#     m = integral of exp(s h w) r over s from 0 to 1.
#
# So a row with the arm m knows the gap at the end of the step, and an impulse over it does the work of the gap's
# change: what tumbles gains no energy (a discrete gradient; Gonzalez 1996, Time integration and discrete Hamiltonian
# systems). The mean depends on w: rows are renewed, and the problem is solved again, until the gaps are as found. Where
# several contacts hold a body, that may lead nowhere: then only rows whose contacts overlap are renewed further.

# What a contact touches on a side, by the number of vertices; a round shape of a body has none either.
PLANE, VERTEX, EDGE, FACE = range(4)


@kernel
def renew_rows(
    first_rigid: ti.i32,
    terms: Scalars,
    contacts: Contacts,
    is_round: Integers,
    carriers: Carriers,
    node_position: Vectors,
    node_velocity: Vectors,
    rigid: RigidState,
    separation: Separation,
    choice: Choice,
    wanted_count: Integers,
    missed: Scalars,
):
    """Renew the rows whose gap after a step with these velocities is another, by more than `touching`.

    Follows `find_violated`, and corrects its gaps and what it wants. `missed` becomes the largest difference of gaps at
    a contact that takes part, and presses or overlaps [mm], shape (1,). What is round hands its contact on from place
    to place, which no arc describes, and keeps its row.
    """
    ti.loop_config(serialize=True)
    for _ in range(1):
        missed[0] = 0.0
        for c in range(contacts.count[0]):
            if is_turning(c, first_rigid, contacts, is_round, rigid):
                touching, kept = separation.touching[c], separation.kept_depth[c]
                gap = gap_after(
                    c, first_rigid, terms[TIME_STEP], contacts, carriers, node_position, node_velocity, rigid
                )
                gap -= terms[CONTACT_DISTANCE]
                difference = ti.abs(gap - choice.gap[c])
                if difference > touching and (gap < choice.gap[c] or terms[MAY_LIFT] == 0.0):
                    if choice.status[c] < BEFORE:
                        closes = ti.i32(gap < ti.min(kept - terms[TIME_STEP] * terms[TOLERANCE], -touching))
                        wanted_count[0] = wanted_count[0] + closes - choice.wanted[c]
                        choice.wanted[c] = closes
                    elif ti.min(gap, choice.gap[c]) - kept < touching:
                        missed[0] = ti.max(missed[0], difference)
                    choice.gap[c] = gap
                    take_mean_arms(c, first_rigid, terms[TIME_STEP], contacts, carriers, rigid, separation)
                    separation.gap_rate[c] = (gap - kept) / terms[TIME_STEP] - separation.speed[c]


@func
def is_turning(c: ti.i32, first_rigid: ti.i32, contacts: Contacts, is_round: Integers, rigid: RigidState) -> ti.i32:
    """Whether a side of a contact turns with a rigid body, and no side is round."""
    turning, round_sides = 0, 0
    for side in range(2):
        body, kind = contacts.bodies[c, side] - first_rigid, kind_of_side(c, side, contacts)
        if body >= 0 and body < rigid.position.shape[0]:
            if (rigid.angular[body] != 0.0).any():
                turning = 1
            if kind == PLANE:
                round_sides += 1
        if kind != PLANE:
            for k in range(3):
                roundness = is_round[contacts.vertices[c, side, k]]
                if contacts.weights[c, side][k] > 0.0 and roundness >= ti.select(kind == FACE, SMOOTH, ROUND):
                    round_sides += 1
    return turning != 0 and round_sides == 0


@func
def kind_of_side(c: ti.i32, side: ti.i32, contacts: Contacts) -> ti.i32:
    """What a contact touches on a side."""
    kind = PLANE
    if contacts.vertices[c, side, 0] >= 0:
        for k in range(3):
            if contacts.weights[c, side][k] != 0.0:
                kind += 1
    return kind


@func
def gap_after(
    c: ti.i32,
    first_rigid: ti.i32,
    time_step: ti.f64,
    contacts: Contacts,
    carriers: Carriers,
    node_position: Vectors,
    node_velocity: Vectors,
    rigid: RigidState,
) -> ti.f64:
    """Distance of the features of a contact after the step, along the normal that they then have [mm].

    A face turns it, as two edges do. It stays, as the half-space through a corner, at other features, and where a side
    is soft, whose places go straight ways.
    """
    apart, normal = vec3(0.0), contacts.normal[c]
    first_kind, first_line = PLANE, vec3(0.0)
    for side in range(2):
        point, line, kind = contacts.points[c, side], vec3(0.0), kind_of_side(c, side, contacts)
        if kind != PLANE:
            place = mat3(0.0)
            for k in ti.static(range(3)):
                v = contacts.vertices[c, side, k]
                x = carriers.local[v]
                if carriers.owner[v] == SOFT:
                    x = vec3(0.0)
                    for m in range(carriers.nodes.shape[1]):
                        node = carriers.nodes[v, m]
                        x += carriers.weights[v, m] * (node_position[node] + time_step * node_velocity[node])
                elif carriers.owner[v] >= 0:
                    body = contacts.bodies[c, side] - first_rigid
                    turn = rotation_of_vector(time_step * rigid.angular[body])
                    x = turn @ (rigid.rotation[body] @ x) + rigid.position[body] + time_step * rigid.linear[body]
                for i in ti.static(range(3)):
                    place[k, i] = x[i]
            weights = contacts.weights[c, side]
            point = place.transpose() @ weights
            corner = vec3(place[0, 0], place[0, 1], place[0, 2])
            one = vec3(place[1, 0], place[1, 1], place[1, 2]) - corner
            other = vec3(place[2, 0], place[2, 1], place[2, 2]) - corner
            line = one.cross(other)
            if kind == EDGE:
                line = one
                if weights[0] == 0.0:
                    line = other - one
                elif weights[1] == 0.0:
                    line = other
        if side == 0:
            apart, first_kind, first_line = -point, kind, line
        else:
            apart += point
            turned = vec3(0.0)
            if first_kind == EDGE and kind == EDGE:
                turned = first_line.cross(line)
            elif first_kind == FACE and kind == VERTEX:
                turned = first_line
            elif first_kind == VERTEX and kind == FACE:
                turned = line
            if turned.norm_sqr() > 0.0 and contacts.bodies[c, 0] >= first_rigid:
                turned = turned.normalized()
                normal = turned * ti.select(turned.dot(normal) < 0.0, -1.0, 1.0)
    return apart.dot(normal)


@func
def take_mean_arms(
    c: ti.i32,
    first_rigid: ti.i32,
    time_step: ti.f64,
    contacts: Contacts,
    carriers: Carriers,
    rigid: RigidState,
    separation: Separation,
):
    """Give a contact the mean arms of its points along the step, and its speed with them."""
    for side in range(2):
        body = contacts.bodies[c, side] - first_rigid
        if body >= 0 and body < rigid.position.shape[0]:
            local = vec3(0.0)
            for k in range(3):
                local += contacts.weights[c, side][k] * carriers.local[contacts.vertices[c, side, k]]
            arm = mean_turn(time_step * rigid.angular[body]) @ (rigid.rotation[body] @ local)
            faster = rigid.angular[body].cross(arm - separation.arm[c, side])
            separation.speed[c] += (2.0 * side - 1.0) * contacts.normal[c].dot(faster)
            separation.arm[c, side] = arm


@func
def mean_turn(turn: vec3) -> mat3:
    """Mean of the rotations by s `turn` [rad] over s from 0 to 1, of which turn x mean = R(turn) - 1."""
    angle = turn.norm()
    first, second = 0.5 - angle**2 / 24.0, 1.0 / 6.0 - angle**2 / 120.0  # (1 - cos a) / a^2, (a - sin a) / a^3
    if angle > 1e-2:
        first, second = (1.0 - ti.cos(angle)) / angle**2, (angle - ti.sin(angle)) / angle**3
    skew = ti.Matrix([[0.0, -turn[2], turn[1]], [turn[2], 0.0, -turn[0]], [-turn[1], turn[0], 0.0]])
    return ti.Matrix.identity(ti.f64, 3) + first * skew + second * (skew @ skew)
