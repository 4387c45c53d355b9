"""Arms, gap rates and velocities of the contacts of a step, and which contacts may push."""

from typing import NamedTuple

import numpy as np

from taichisoft.bodies.kernels.rigid_integration import RigidState
from taichisoft.contact.kernels.contact_reduction import BEFORE, Choice
from taichisoft.contact.kernels.contacts import Contacts
from taichisoft.contact.kernels.surface_vertices import Carriers
from taichisoft.runtime.language import SOFT, Integers, Scalars, ScalarTable, Vectors, VectorTable, func, ti, vec3
from taichisoft.runtime.launch import kernel

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
            if is_corner(c, side, contacts, is_round):
                body = contacts.bodies[c, side] - first_rigid
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
