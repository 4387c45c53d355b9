"""Rows of the constraint problem: what they act on, the velocities along them, and impulses through them."""

from typing import NamedTuple

import numpy as np

from taichisoft.kernels.actuators import Coordinates, Gradient
from taichisoft.kernels.contacts import Contacts
from taichisoft.kernels.launch import func, kernel
from taichisoft.kernels.rigid_motion import RigidState
from taichisoft.kernels.runtime import (
    SOFT,
    Integers,
    IntegerTable,
    Matrices,
    ScalarBlocks,
    Scalars,
    ScalarTable,
    Vectors,
    VectorTable,
    mat3,
    ti,
    vec3,
)
from taichisoft.kernels.surfaces import Carriers

# Entries of `Rows.size`.
CONTACTS, ACTUATORS = range(2)


class Rows(NamedTuple):
    """Three rows for each contact and then one for each coordinate of an actuator, in arrays with room for more.

    Attributes:
        size: number of contacts and of actuator rows, shape (2,).
        contact: index of each row's contact in `Contacts`, shape (contact_capacity,).
        basis: normal and two tangents of each contact, as rows, shape (contact_capacity, 3, 3).
        node, weight: soft nodes that a contact acts on and their weights, -1 and 0 in empty slots, shape
            (contact_capacity, slots); the weights are those of the second point's velocity less the first's.
        rigid: rigid body on each side of a contact, or -1, shape (contact_capacity, 2).
        rigid_jacobian: derivative of the rows by these bodies' velocities, shape (3 contact_capacity, 2, 6).
        friction: coefficient of each contact, shape (contact_capacity,).
        gap_rate: normal velocity at which each contact closes in the step [mm/s], shape (contact_capacity,).
        coordinate: the coordinate of each actuator row, shape (coordinate_count,).
        target_rate: rate of each that reaches its lower end in this step [mm/s or mm^3/s], shape (coordinate_count,).
        free: velocities without impulses, of actuators less the target rate [mm/s or mm^3/s], shape (row_capacity,).
    """

    size: Integers
    contact: Integers
    basis: Matrices
    node: IntegerTable
    weight: ScalarTable
    rigid: IntegerTable
    rigid_jacobian: ScalarBlocks
    friction: Scalars
    gap_rate: Scalars
    coordinate: Integers
    target_rate: Scalars
    free: Scalars


class Separation(NamedTuple):
    """All contacts of a step as the active set sees them, in arrays with room for more.

    Attributes:
        arm: from the centre of mass of the rigid body on each side to the point there, when the contact was measured
            [mm], shape (capacity, 2, 3).
        gap_rate: normal velocity at which the gap closes in the step, negative where it must open [mm/s], shape
            (capacity,).
        speed: normal velocity of the second point relative to the first [mm/s], shape (capacity,).
    """

    arm: VectorTable
    gap_rate: Scalars
    speed: Scalars

    @classmethod
    def with_room(cls, capacity: int) -> "Separation":
        """Arrays for so many contacts."""
        return cls(np.zeros((capacity, 2, 3)), np.zeros(capacity), np.zeros(capacity))


@ti.func
def contact_basis(normal: vec3) -> mat3:
    """Normal and two tangents as rows; the first tangent is normal to the axis that is least along the normal."""
    axis = vec3(1.0, 0.0, 0.0)
    if ti.abs(normal[1]) < ti.abs(normal[0]) and ti.abs(normal[1]) <= ti.abs(normal[2]):
        axis = vec3(0.0, 1.0, 0.0)
    elif ti.abs(normal[2]) < ti.abs(normal[0]):
        axis = vec3(0.0, 0.0, 1.0)
    first = normal.cross(axis).normalized()
    return ti.Matrix.rows([normal, first, normal.cross(first)])


@func
def turned(vector: vec3, turn: vec3) -> vec3:
    """A vector turned by a rotation vector [rad] (Rodrigues)."""
    angle = turn.norm()
    result = vector
    if angle > 0.0:
        axis = turn / angle
        across = axis.cross(vector)
        result = vector + ti.sin(angle) * across + (1.0 - ti.cos(angle)) * axis.cross(across)
    return result


@kernel
def place_arms(
    first_rigid: ti.i32,
    contacts: Contacts,
    passed: Scalars,
    gap: Scalars,
    touching: Scalars,
    is_round: Integers,
    rigid: RigidState,
    separation: Separation,
):
    """Arms of contacts that were measured a time `passed` [s] after the start, with the velocities from before.

    They are those of that time, the `gap` [mm] too. But where a corner or an edge touches at the start already, by a
    gap below `touching`, and goes on to touch, the arms of the middle of that time: over them the impulse does the work
    that belongs to the change of the gap, and a body that topples over a corner gains no energy. A round surface passes
    its contact on from vertex to vertex instead.
    """
    ti.loop_config(serialize=True)
    for c in range(contacts.count[0]):
        turns = 0
        start_gap = gap[c]
        for side in ti.static(range(2)):
            body = contacts.bodies[c, side] - first_rigid
            separation.arm[c, side] = vec3(0.0)
            if body >= 0 and body < rigid.position.shape[0]:
                arm = contacts.points[c, side] - rigid.position[body] - passed[c] * rigid.linear[body]
                separation.arm[c, side] = arm
                if is_corner(c, side, contacts, is_round):
                    turns = 1
                    arm = turned(arm, -0.5 * passed[c] * rigid.angular[body])
                speed = contacts.normal[c].dot(rigid.linear[body] + rigid.angular[body].cross(arm))
                start_gap -= (2.0 * side - 1.0) * passed[c] * speed
        if turns != 0 and start_gap < touching[c]:
            for side in ti.static(range(2)):
                if is_corner(c, side, contacts, is_round):
                    body = contacts.bodies[c, side] - first_rigid
                    back = -0.5 * passed[c] * rigid.angular[body]
                    separation.arm[c, side] = turned(separation.arm[c, side], back)


@func
def is_corner(c: ti.i32, side: ti.i32, contacts: Contacts, is_round: Integers) -> ti.i32:
    """Whether a contact is at a corner or edge of a rigid body, which stands for no round surface."""
    sharp = 0
    weights = contacts.weights[c, side]
    if contacts.vertices[c, side, 0] >= 0 and weights[0] * weights[1] * weights[2] == 0.0:
        for k in ti.static(range(3)):
            if weights[k] > 0.0 and is_round[contacts.vertices[c, side, k]] == 0:
                sharp = 1
    return sharp


@kernel
def separation_speed(
    first_rigid: ti.i32,
    contacts: Contacts,
    carriers: Carriers,
    node_velocity: Vectors,
    rigid: RigidState,
    separation: Separation,
):
    """Normal velocity of each contact's second point relative to its first [mm/s]."""
    ti.loop_config(serialize=True)
    for c in range(contacts.count[0]):
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
        separation.speed[c] = total


@kernel
def build_rows(
    first_rigid: ti.i32,
    contacts: Contacts,
    separation: Separation,
    carriers: Carriers,
    friction: ScalarTable,
    rigid: RigidState,
    rows: Rows,
):
    """Bases of the contacts that `rows.contact` lists, and the soft nodes and rigid bodies that they act on."""
    ti.loop_config(serialize=True)
    for r in range(rows.size[CONTACTS]):
        c = rows.contact[r]
        frame = contact_basis(contacts.normal[c])
        rows.basis[r] = frame
        rows.friction[r] = friction[contacts.bodies[c, 0], contacts.bodies[c, 1]]
        rows.gap_rate[r] = separation.gap_rate[c]
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


@kernel
def free_contact_velocity(rows: Rows, node_velocity: Vectors, rigid: RigidState):
    """Fill `rows.free` of the contacts: relative velocity of the second point in the basis, the normal one plus the
    gap rate."""
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
    """Fill `rows.free` of the actuators: the rates of the coordinates less the target rates."""
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
        row_count = 3 * rows.size[CONTACTS] + rows.size[ACTUATORS]
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
    node_impulse: Vectors,
    rigid: RigidState,
):
    """J^T impulse on the soft nodes and the rigid bodies, and the impulses on second bodies in world axes."""
    ti.loop_config(serialize=True)
    for i in range(node_impulse.shape[0]):
        node_impulse[i] = vec3(0.0)
    ti.loop_config(serialize=True)
    for b in range(rigid.impulse.shape[0]):
        for d in range(6):
            rigid.impulse[b, d] = 0.0
    ti.loop_config(serialize=True)
    for c in range(rows.size[CONTACTS]):
        world = rows.basis[c].transpose() @ vec3(impulse[3 * c], impulse[3 * c + 1], impulse[3 * c + 2])
        contact_impulse[c] = world
        for slot in range(rows.node.shape[1]):
            if rows.node[c, slot] >= 0:
                node_impulse[rows.node[c, slot]] += rows.weight[c, slot] * world
        for side in range(2):
            if rows.rigid[c, side] >= 0:
                for i in range(3):
                    for d in range(6):
                        gain = rows.rigid_jacobian[3 * c + i, side, d] * impulse[3 * c + i]
                        rigid.impulse[rows.rigid[c, side], d] += gain
    ti.loop_config(serialize=True)
    for row in range(rows.size[ACTUATORS]):
        coordinate, own = rows.coordinate[row], impulse[3 * rows.size[CONTACTS] + row]
        for k in range(coordinates.entry_start[coordinate], coordinates.entry_start[coordinate + 1]):
            node_impulse[coordinates.entry_node[k]] += own * gradient.soft[k]
        for k in range(coordinates.rigid_start[coordinate], coordinates.rigid_start[coordinate + 1]):
            for d in range(6):
                rigid.impulse[coordinates.rigid_body[k], d] += own * gradient.rigid[k, d]
