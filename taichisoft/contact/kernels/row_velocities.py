"""Rows of the constraint problem: the bodies on which they act, their velocities, and their impulses."""

from typing import NamedTuple

from taichisoft.contact.kernels.contacts import Carriers, Contacts
from taichisoft.contact.kernels.separation import BEFORE, Choice, Separation
from taichisoft.mechanics.kernels.actuator_coordinates import Coordinates, Gradient
from taichisoft.mechanics.kernels.rigid_integration import RigidState
from taichisoft.runtime.language import (
    SOFT,
    Integers,
    IntegerTable,
    Matrices,
    ScalarBlocks,
    Scalars,
    ScalarTable,
    Vectors,
    func,
    mat3,
    ti,
    vec3,
)
from taichisoft.runtime.launch import kernel

# Entries of `Rows.size`.
CONTACTS, ACTUATORS, MOMENTS = range(3)
# Columns of `Rows.moment_length`.
SPINNING, ROLLING = range(2)


class PairLaws(NamedTuple):
    """Friction between two bodies, by body number; each of shape (body_count, body_count).

    Attributes:
        friction: Coulomb's coefficient [-].
        spinning, rolling: lengths of spinning and of rolling friction [mm].
    """

    friction: ScalarTable
    spinning: ScalarTable
    rolling: ScalarTable


class Rows(NamedTuple):
    """Three rows per contact, one per actuator coordinate, three per contact with rolling or spinning friction.

    All arrays have spare capacity.

    Attributes:
        size: number of contacts, of actuator rows, and of contacts with moments, shape (3,).
        contact: index of each row's contact in `Contacts`, shape (contact_capacity,).
        on_rigid: contacts, by their rows, between rigid bodies only, shape (contact_capacity,).
        on_rigid_count: number of these contacts, shape (1,).
        basis: normal and two tangents of each contact, as rows, shape (contact_capacity, 3, 3).
        node, weight: soft nodes on which a contact acts, and their weights in the second point's velocity less the
            first's, -1 and 0 in empty slots, shape (contact_capacity, slots).
        rigid: rigid body on each side of a contact, or -1, shape (contact_capacity, 2).
        rigid_jacobian: derivative of the rows by the velocities of `rigid`, shape (3 contact_capacity, 2, 6).
        friction: coefficient of each contact, shape (contact_capacity,).
        gap_rate: normal velocity at which each contact closes in the step [mm/s], shape (contact_capacity,).
        coordinate: the coordinate of each actuator row, shape (coordinate_count,).
        target_rate: rate at which it reaches its lower end in this step [mm/s or mm^3/s], shape (coordinate_count,).
        moment_contact: the contact of each moment, by its rows, shape (moment_capacity,).
        moment_length: largest moment about the normal and about the tangents over the normal impulse [mm], shape
            (moment_capacity, 2).
        free: velocities without impulses, of actuators less the target rate [mm/s or mm^3/s], of moments [rad/s], shape
            (row_capacity,).
    """

    size: Integers
    contact: Integers
    on_rigid: Integers
    on_rigid_count: Integers
    basis: Matrices
    node: IntegerTable
    weight: ScalarTable
    rigid: IntegerTable
    rigid_jacobian: ScalarBlocks
    friction: Scalars
    gap_rate: Scalars
    coordinate: Integers
    target_rate: Scalars
    moment_contact: Integers
    moment_length: ScalarTable
    free: Scalars


@func
def contact_basis(normal: vec3) -> mat3:
    """Normal and two tangents as rows; the first tangent is across the axis least aligned with the normal."""
    axis = vec3(1.0, 0.0, 0.0)
    if ti.abs(normal[1]) < ti.abs(normal[0]) and ti.abs(normal[1]) <= ti.abs(normal[2]):
        axis = vec3(0.0, 1.0, 0.0)
    elif ti.abs(normal[2]) < ti.abs(normal[0]):
        axis = vec3(0.0, 0.0, 1.0)
    first = normal.cross(axis).normalized()
    return ti.Matrix.rows([normal, first, normal.cross(first)])


@kernel
def build_rows(
    first_rigid: ti.i32,
    contacts: Contacts,
    choice: Choice,
    separation: Separation,
    carriers: Carriers,
    laws: PairLaws,
    rigid: RigidState,
    contact_impulse: Vectors,
    rows: Rows,
    impulse: Scalars,
):
    """Fill in bases, soft nodes and rigid bodies of the contacts that take part.

    `impulse` gets the initial guess of the solver: the present impulses of these contacts, without pulling ones.
    """
    ti.loop_config(serialize=True)
    for _ in range(1):
        r = 0
        rows.on_rigid_count[0] = 0
        rows.size[MOMENTS] = 0
        for c in range(contacts.count[0]):
            if choice.status[c] >= BEFORE:
                rows.contact[r] = c
                fill_contact(r, c, first_rigid, contacts, separation, carriers, rigid, rows)
                first, second = contacts.bodies[c, 0], contacts.bodies[c, 1]
                rows.friction[r] = laws.friction[first, second]
                spinning, rolling = laws.spinning[first, second], laws.rolling[first, second]
                if spinning > 0.0 or rolling > 0.0:
                    m = rows.size[MOMENTS]
                    rows.size[MOMENTS] = m + 1
                    rows.moment_contact[m] = r
                    rows.moment_length[m, SPINNING] = spinning
                    rows.moment_length[m, ROLLING] = rolling
                local = rows.basis[r] @ contact_impulse[c]
                if local[0] < 0.0:
                    local = vec3(0.0)
                for i in ti.static(range(3)):
                    impulse[3 * r + i] = local[i]
                r += 1


@func
def fill_contact(
    r: ti.i32,
    c: ti.i32,
    first_rigid: ti.i32,
    contacts: Contacts,
    separation: Separation,
    carriers: Carriers,
    rigid: RigidState,
    rows: Rows,
):
    """Fill in the soft nodes and rigid bodies of contact c as number r of the rows."""
    frame = contact_basis(contacts.normal[c])
    rows.basis[r] = frame
    rows.gap_rate[r] = separation.gap_rate[c]
    soft_nodes = 0
    for side in range(2):
        sign = 2.0 * side - 1.0
        for k in ti.static(range(3)):
            v = contacts.vertices[c, side, k]
            for m in range(carriers.nodes.shape[1]):
                slot = (side * 3 + k) * carriers.nodes.shape[1] + m
                rows.node[r, slot] = -1
                rows.weight[r, slot] = 0.0
                carried = v >= 0 and carriers.owner[v] == SOFT
                if carried and contacts.weights[c, side][k] * carriers.weights[v, m] != 0.0:
                    soft_nodes += 1
                    rows.node[r, slot] = carriers.nodes[v, m]
                    rows.weight[r, slot] = sign * contacts.weights[c, side][k] * carriers.weights[v, m]
        body = contacts.bodies[c, side] - first_rigid
        rows.rigid[r, side] = -1
        if body >= 0 and body < rigid.position.shape[0]:
            rows.rigid[r, side] = body
            arm = separation.arm[c, side]
            for i in ti.static(range(3)):
                direction = sign * vec3(frame[i, 0], frame[i, 1], frame[i, 2])
                moment = arm.cross(direction)
                for d in ti.static(range(3)):
                    rows.rigid_jacobian[3 * r + i, side, d] = direction[d]
                    rows.rigid_jacobian[3 * r + i, side, 3 + d] = moment[d]
    if soft_nodes == 0:
        rows.on_rigid[rows.on_rigid_count[0]] = r
        rows.on_rigid_count[0] = rows.on_rigid_count[0] + 1


@kernel
def free_contact_velocity(rows: Rows, node_velocity: Vectors, rigid: RigidState):
    """Fill in `rows.free` of the contacts: relative velocity of the second point in the basis, plus the gap rate."""
    ti.loop_config(serialize=True)
    for c in range(rows.size[CONTACTS]):
        soft = vec3(0.0)
        for slot in range(rows.node.shape[1]):
            if rows.node[c, slot] >= 0:
                soft += rows.weight[c, slot] * node_velocity[rows.node[c, slot]]
        total = rows.basis[c] @ soft
        total[0] += rows.gap_rate[c]
        for side in range(2):
            if rows.rigid[c, side] >= 0:
                for i in ti.static(range(3)):
                    for d in range(6):
                        total[i] += rows.rigid_jacobian[3 * c + i, side, d] * rigid.free[rows.rigid[c, side], d]
        for i in ti.static(range(3)):
            rows.free[3 * c + i] = total[i]


@kernel
def add_rigid_compliance(row_count: ti.i32, rows: Rows, rigid: RigidState, compliance: Scalars):
    """Add J M^-1 J^T of the rigid bodies that two contacts share to W, which is stored by rows."""
    ti.loop_config(serialize=True)
    for r in range(3 * rows.size[CONTACTS]):
        for side in range(2):
            body = rows.rigid[r // 3, side]
            if body >= 0:
                change = ti.Vector.zero(ti.f64, 6)  # of the body's velocity by a unit impulse in the row
                for n in range(6):
                    for m in ti.static(range(6)):
                        change[m] += rigid.inverse_mass[body, m, n] * rows.rigid_jacobian[r, side, n]
                for c in range(rows.size[CONTACTS]):
                    for other_side in ti.static(range(2)):
                        if rows.rigid[c, other_side] == body:
                            gain = vec3(0.0)
                            for i, m in ti.static(ti.ndrange(3, 6)):
                                gain[i] += change[m] * rows.rigid_jacobian[3 * c + i, other_side, m]
                            for i in ti.static(range(3)):
                                entry = compliance[r * row_count + 3 * c + i]
                                compliance[r * row_count + 3 * c + i] = entry + gain[i]


@kernel
def free_actuator_velocity(
    rows: Rows, coordinates: Coordinates, gradient: Gradient, node_velocity: Vectors, rigid: RigidState
):
    """Fill in `rows.free` of the actuators: rates of the coordinates less the target rates."""
    ti.loop_config(serialize=True)
    for row in range(rows.size[ACTUATORS]):
        coordinate = rows.coordinate[row]
        rate = -rows.target_rate[row]
        for k in range(coordinates.entry_start[coordinate], coordinates.entry_start[coordinate + 1]):
            rate += gradient.soft[k].dot(node_velocity[coordinates.entry_node[k]])
        for k in range(coordinates.rigid_start[coordinate], coordinates.rigid_start[coordinate + 1]):
            for d in range(6):
                rate += gradient.rigid[k, d] * rigid.free[coordinates.rigid_body[k], d]
        rows.free[3 * rows.size[CONTACTS] + row] = rate


@kernel
def add_rigid_actuator_compliance(
    rows: Rows, coordinates: Coordinates, gradient: Gradient, rigid: RigidState, compliance: Scalars
):
    """Add J M^-1 J^T of the rigid bodies that an actuator shares with contacts and other actuators to W."""
    ti.loop_config(serialize=True)
    for row in range(rows.size[ACTUATORS]):
        row_count = 3 * (rows.size[CONTACTS] + rows.size[MOMENTS]) + rows.size[ACTUATORS]
        r, coordinate = 3 * rows.size[CONTACTS] + row, rows.coordinate[row]
        for k in range(coordinates.rigid_start[coordinate], coordinates.rigid_start[coordinate + 1]):
            body = coordinates.rigid_body[k]
            change = ti.Vector.zero(ti.f64, 6)  # of the body's velocity by a unit impulse in the row
            for n in range(6):
                for m in ti.static(range(6)):
                    change[m] += rigid.inverse_mass[body, m, n] * gradient.rigid[k, n]
            for c in range(rows.size[CONTACTS]):
                for side in range(2):
                    if rows.rigid[c, side] == body:
                        for i in range(3):
                            gain = 0.0
                            for m in ti.static(range(6)):
                                gain += change[m] * rows.rigid_jacobian[3 * c + i, side, m]
                            compliance[r * row_count + 3 * c + i] = compliance[r * row_count + 3 * c + i] + gain
                            compliance[(3 * c + i) * row_count + r] = compliance[(3 * c + i) * row_count + r] + gain
            for other in range(rows.size[ACTUATORS]):
                partner, q = rows.coordinate[other], 3 * rows.size[CONTACTS] + other
                for j in range(coordinates.rigid_start[partner], coordinates.rigid_start[partner + 1]):
                    if coordinates.rigid_body[j] == body:
                        gain = 0.0
                        for m in ti.static(range(6)):
                            gain += change[m] * gradient.rigid[j, m]
                        compliance[r * row_count + q] = compliance[r * row_count + q] + gain


@kernel
def apply_impulses(
    rows: Rows,
    coordinates: Coordinates,
    gradient: Gradient,
    impulse: Scalars,
    contact_impulse: Vectors,
    contact_node_impulse: Vectors,
    node_impulse: Vectors,
    rigid: RigidState,
):
    """Fill in J^T impulse on soft nodes and rigid bodies, and each contact's impulse on its second body, world axes.

    `contact_impulse` has an entry for every contact; only contacts with rows are filled in. `contact_node_impulse` is
    the part of `node_impulse` due to contacts.
    """
    ti.loop_config(serialize=True)
    for i in range(node_impulse.shape[0]):
        contact_node_impulse[i] = vec3(0.0)
    ti.loop_config(serialize=True)
    for b in range(rigid.impulse.shape[0]):
        for d in range(6):
            rigid.impulse[b, d] = 0.0
    ti.loop_config(serialize=True)
    for c in range(rows.size[CONTACTS]):
        world = rows.basis[c].transpose() @ vec3(impulse[3 * c], impulse[3 * c + 1], impulse[3 * c + 2])
        contact_impulse[rows.contact[c]] = world
        for slot in range(rows.node.shape[1]):
            if rows.node[c, slot] >= 0:
                node = rows.node[c, slot]  # in place Taichi would add atomically
                contact_node_impulse[node] = contact_node_impulse[node] + rows.weight[c, slot] * world
        for side in range(2):
            if rows.rigid[c, side] >= 0:
                for i in range(3):
                    for d in range(6):
                        gain = rows.rigid_jacobian[3 * c + i, side, d] * impulse[3 * c + i]
                        rigid.impulse[rows.rigid[c, side], d] += gain
    ti.loop_config(serialize=True)
    for i in range(node_impulse.shape[0]):
        node_impulse[i] = contact_node_impulse[i]
    ti.loop_config(serialize=True)
    for row in range(rows.size[ACTUATORS]):
        coordinate, own = rows.coordinate[row], impulse[3 * rows.size[CONTACTS] + row]
        for k in range(coordinates.entry_start[coordinate], coordinates.entry_start[coordinate + 1]):
            node = coordinates.entry_node[k]
            node_impulse[node] = node_impulse[node] + own * gradient.soft[k]
        for k in range(coordinates.rigid_start[coordinate], coordinates.rigid_start[coordinate + 1]):
            for d in range(6):
                rigid.impulse[coordinates.rigid_body[k], d] += own * gradient.rigid[k, d]


# Rows of moments: resistance of two rigid bodies in contact to spinning and rolling on each other.
#
# A contact has three such rows: the relative angular velocities about its normal and its two tangents. Their impulses l
# obey Coulomb's law with lengths as coefficients (Leine and Glocker 2003, A set-valued force law for spatial Coulomb-
# Contensou friction; Acary and Bourrier 2021, Coulomb friction with rolling resistance as a cone complementarity
# problem): |l_n| <= b_s p and |l_t| <= b_r p, where p is the contact's normal impulse; in case of equality l opposes
# the rotation.


@func
def axis(m: ti.i32, i: ti.i32, side: ti.i32, rows: Rows) -> vec3:
    """Signed axis about which row i of moment m acts on the body on this side."""
    c, sign = rows.moment_contact[m], 2.0 * side - 1.0
    return sign * vec3(rows.basis[c][i, 0], rows.basis[c][i, 1], rows.basis[c][i, 2])


@func
def turned_by(body: ti.i32, moment: vec3, rigid: RigidState) -> vec3:
    """Change of a body's angular velocity [rad/s] by an angular impulse [mN s mm]."""
    change = vec3(0.0)
    for i, j in ti.static(ti.ndrange(3, 3)):
        change[i] += rigid.inverse_mass[body, 3 + i, 3 + j] * moment[j]
    return change


@kernel
def free_moment_velocity(rows: Rows, rigid: RigidState):
    """Fill in `rows.free` of the moments: angular velocities of the second body relative to the first [rad/s]."""
    ti.loop_config(serialize=True)
    for m in range(rows.size[MOMENTS]):
        for i in range(3):
            total = 0.0
            for side in range(2):
                body = rows.rigid[rows.moment_contact[m], side]
                if body >= 0:
                    direction = axis(m, i, side, rows)
                    for d in ti.static(range(3)):
                        total += direction[d] * rigid.free[body, 3 + d]
            rows.free[3 * rows.size[CONTACTS] + rows.size[ACTUATORS] + 3 * m + i] = total


@kernel
def add_moment_compliance(
    row_count: ti.i32, rows: Rows, coordinates: Coordinates, gradient: Gradient, rigid: RigidState, w: Scalars
):
    """Add the coupling of the moments with themselves, with contacts and with actuators to W, stored by rows."""
    ti.loop_config(serialize=True)
    for m in range(rows.size[MOMENTS]):
        first_actuator = 3 * rows.size[CONTACTS]
        first = first_actuator + rows.size[ACTUATORS]
        for i in range(3):
            r = first + 3 * m + i
            for side in range(2):
                body = rows.rigid[rows.moment_contact[m], side]
                if body >= 0:
                    change = turned_by(body, axis(m, i, side, rows), rigid)
                    for q in range(first_actuator):
                        for other in range(2):
                            if rows.rigid[q // 3, other] == body:
                                gain = 0.0
                                for d in ti.static(range(3)):
                                    gain += change[d] * rows.rigid_jacobian[q, other, 3 + d]
                                w[r * row_count + q] = w[r * row_count + q] + gain
                                w[q * row_count + r] = w[q * row_count + r] + gain
                    for a in range(rows.size[ACTUATORS]):
                        q, coordinate = first_actuator + a, rows.coordinate[a]
                        for k in range(coordinates.rigid_start[coordinate], coordinates.rigid_start[coordinate + 1]):
                            if coordinates.rigid_body[k] == body:
                                gain = 0.0
                                for d in ti.static(range(3)):
                                    gain += change[d] * gradient.rigid[k, 3 + d]
                                w[r * row_count + q] = w[r * row_count + q] + gain
                                w[q * row_count + r] = w[q * row_count + r] + gain
                    for n in range(rows.size[MOMENTS]):
                        for other in range(2):
                            if rows.rigid[rows.moment_contact[n], other] == body:
                                for j in range(3):
                                    q = first + 3 * n + j
                                    gain = change.dot(axis(n, j, other, rows))
                                    w[r * row_count + q] = w[r * row_count + q] + gain


@kernel
def apply_moments(rows: Rows, impulse: Scalars, rigid: RigidState):
    """Add the impulses of the moments to the impulses on the rigid bodies."""
    ti.loop_config(serialize=True)
    for m in range(rows.size[MOMENTS]):
        for i in range(3):
            own = impulse[3 * rows.size[CONTACTS] + rows.size[ACTUATORS] + 3 * m + i]
            for side in range(2):
                body = rows.rigid[rows.moment_contact[m], side]
                if body >= 0:
                    direction = axis(m, i, side, rows)
                    for d in ti.static(range(3)):
                        rigid.impulse[body, 3 + d] = rigid.impulse[body, 3 + d] + own * direction[d]
