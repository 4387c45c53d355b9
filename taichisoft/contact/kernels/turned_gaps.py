"""Rows of contacts that lead to where bodies really are after a step that turns them.

A row is linear in the velocities, and what is on a turning body goes on an arc. In a step with the velocities v and w a
point at r from the centre of mass moves by h (v + w x m), exactly, with the mean m of r along the arc:

    m = integral of exp(s h w) r over s from 0 to 1.

So a row with the arm m knows the gap at the end of the step, and an impulse over it does the work of the gap's change:
what tumbles gains no energy (a discrete gradient; Gonzalez 1996, Time integration and discrete Hamiltonian systems).
The mean depends on w: rows are renewed, and the problem is solved again, until the gaps are as found. Where several
contacts hold a body, that may lead nowhere: then only rows whose contacts overlap are renewed further.
"""

from taichisoft.bodies.kernels.rigid_integration import RigidState
from taichisoft.contact.kernels.contact_reduction import BEFORE, Choice
from taichisoft.contact.kernels.contacts import Contacts
from taichisoft.contact.kernels.separation import CONTACT_DISTANCE, MAY_LIFT, TIME_STEP, TOLERANCE, Separation
from taichisoft.contact.kernels.surface_vertices import ROUND, SMOOTH, Carriers
from taichisoft.runtime.language import SOFT, Integers, Scalars, Vectors, func, mat3, ti, vec3
from taichisoft.runtime.launch import kernel
from taichisoft.runtime.rotation_matrices import rotation_of_vector

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
