"""What contacts act on: their rows of the Jacobian, the velocities along the rows, and impulses through them."""

from taichisoft.kernels.launch import kernel
from taichisoft.kernels.runtime import (
    SOFT,
    IntegerBlocks,
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


@kernel
def separation_speed(
    first_rigid: ti.i32,
    rigid_count: ti.i32,
    bodies: IntegerTable,
    vertices: IntegerBlocks,
    vertex_weights: VectorTable,
    points: VectorTable,
    normal: Vectors,
    carrier_nodes: IntegerTable,
    carrier_weights: ScalarTable,
    owner: Integers,
    node_velocity: Vectors,
    rigid_position: Vectors,
    linear: Vectors,
    angular: Vectors,
    speed: Scalars,
):
    """Normal velocity of each contact's second point relative to its first [mm/s]."""
    ti.loop_config(serialize=True)
    for c in range(bodies.shape[0]):
        total = 0.0
        for side in range(2):
            v = vec3(0.0)
            for k in ti.static(range(3)):
                vertex = vertices[c, side, k]
                if vertex >= 0 and owner[vertex] == SOFT and vertex_weights[c, side][k] != 0.0:
                    for m in range(carrier_nodes.shape[1]):
                        weight = vertex_weights[c, side][k] * carrier_weights[vertex, m]
                        v += weight * node_velocity[carrier_nodes[vertex, m]]
            body = bodies[c, side] - first_rigid
            if body >= 0 and body < rigid_count:
                v = linear[body] + angular[body].cross(points[c, side] - rigid_position[body])
            total += (2.0 * side - 1.0) * normal[c].dot(v)
        speed[c] = total


@kernel
def lay_out(
    first_rigid: ti.i32,
    rigid_count: ti.i32,
    bodies: IntegerTable,
    vertices: IntegerBlocks,
    vertex_weights: VectorTable,
    points: VectorTable,
    normal: Vectors,
    carrier_nodes: IntegerTable,
    carrier_weights: ScalarTable,
    owner: Integers,
    rigid_position: Vectors,
    basis: Matrices,
    node: IntegerTable,
    weight: ScalarTable,
    rigid: IntegerTable,
    rigid_jacobian: ScalarBlocks,
):
    """Bases of the contacts, the soft nodes and rigid bodies they act on, and with which weights.

    A contact's slots hold the nodes that carry its vertices, -1 where there is none; the weights are those of the
    second point's velocity less the first's. Rows of rigid bodies stand one after the other, (3 contact + i, side, 6).
    """
    ti.loop_config(serialize=True)
    for c in range(bodies.shape[0]):
        frame = contact_basis(normal[c])
        basis[c] = frame
        for side in range(2):
            sign = 2.0 * side - 1.0
            for k in ti.static(range(3)):
                v = vertices[c, side, k]
                for m in range(carrier_nodes.shape[1]):
                    slot = (side * 3 + k) * carrier_nodes.shape[1] + m
                    node[c, slot] = -1
                    weight[c, slot] = 0.0
                    if v >= 0 and owner[v] == SOFT and vertex_weights[c, side][k] * carrier_weights[v, m] != 0.0:
                        node[c, slot] = carrier_nodes[v, m]
                        weight[c, slot] = sign * vertex_weights[c, side][k] * carrier_weights[v, m]
            body = bodies[c, side] - first_rigid
            rigid[c, side] = -1
            if body >= 0 and body < rigid_count:
                rigid[c, side] = body
                arm = points[c, side] - rigid_position[body]
                for i in ti.static(range(3)):
                    direction = sign * vec3(frame[i, 0], frame[i, 1], frame[i, 2])
                    moment = arm.cross(direction)
                    for d in ti.static(range(3)):
                        rigid_jacobian[3 * c + i, side, d] = direction[d]
                        rigid_jacobian[3 * c + i, side, 3 + d] = moment[d]


@kernel
def contact_velocity(
    node: IntegerTable,
    weight: ScalarTable,
    basis: Matrices,
    rigid: IntegerTable,
    rigid_jacobian: ScalarBlocks,
    node_velocity: Vectors,
    rigid_velocity: ScalarTable,
    approach: Scalars,
    free: Scalars,
):
    """Relative velocity of each contact's second point to its first in its basis, the normal one plus `approach`."""
    ti.loop_config(serialize=True)
    for c in range(node.shape[0]):
        soft = vec3(0.0)
        for slot in range(node.shape[1]):
            if node[c, slot] >= 0:
                soft += weight[c, slot] * node_velocity[node[c, slot]]
        total = basis[c] @ soft
        total[0] += approach[c]
        for side in range(2):
            if rigid[c, side] >= 0:
                for i in ti.static(range(3)):
                    for d in range(6):
                        total[i] += rigid_jacobian[3 * c + i, side, d] * rigid_velocity[rigid[c, side], d]
        for i in ti.static(range(3)):
            free[3 * c + i] = total[i]


@kernel
def add_rigid_compliance(
    rigid: IntegerTable,
    rigid_jacobian: ScalarBlocks,
    inverse_mass: ScalarBlocks,
    compliance: ScalarTable,
):
    """Add J M^-1 J^T of the rigid bodies that two contacts share, M^-1 of shape (body, 6, 6)."""
    ti.loop_config(serialize=True)
    for r in range(3 * rigid.shape[0]):
        for side in range(2):
            body = rigid[r // 3, side]
            if body >= 0:
                change = ti.Vector.zero(ti.f64, 6)  # of the body's velocity by a unit impulse in the row
                for n in range(6):
                    for m in ti.static(range(6)):
                        change[m] += inverse_mass[body, m, n] * rigid_jacobian[r, side, n]
                for c in range(rigid.shape[0]):
                    for other_side in ti.static(range(2)):
                        if rigid[c, other_side] == body:
                            gain = vec3(0.0)
                            for i, m in ti.static(ti.ndrange(3, 6)):
                                gain[i] += change[m] * rigid_jacobian[3 * c + i, other_side, m]
                            for i in ti.static(range(3)):
                                compliance[r, 3 * c + i] = compliance[r, 3 * c + i] + gain[i]


@kernel
def apply_impulses(
    node: IntegerTable,
    weight: ScalarTable,
    basis: Matrices,
    rigid: IntegerTable,
    rigid_jacobian: ScalarBlocks,
    cavity_of_row: Integers,
    cavity_start: Integers,
    cavity_node: Integers,
    cavity_gradient: Vectors,
    impulse: Scalars,
    contact_impulse: Vectors,
    node_impulse: Vectors,
    rigid_impulse: ScalarTable,
):
    """J^T impulse on the soft nodes and the rigid bodies, and the impulses on second bodies in world axes."""
    ti.loop_config(serialize=True)
    for i in range(node_impulse.shape[0]):
        node_impulse[i] = vec3(0.0)
    ti.loop_config(serialize=True)
    for b in range(rigid_impulse.shape[0]):
        for d in range(6):
            rigid_impulse[b, d] = 0.0
    ti.loop_config(serialize=True)
    for c in range(node.shape[0]):
        world = basis[c].transpose() @ vec3(impulse[3 * c], impulse[3 * c + 1], impulse[3 * c + 2])
        contact_impulse[c] = world
        for slot in range(node.shape[1]):
            if node[c, slot] >= 0:
                node_impulse[node[c, slot]] += weight[c, slot] * world
        for side in range(2):
            if rigid[c, side] >= 0:
                for i in range(3):
                    for d in range(6):
                        rigid_impulse[rigid[c, side], d] += rigid_jacobian[3 * c + i, side, d] * impulse[3 * c + i]
    ti.loop_config(serialize=True)
    for row in range(cavity_of_row.shape[0]):
        cavity = cavity_of_row[row]
        for k in range(cavity_start[cavity], cavity_start[cavity + 1]):
            node_impulse[cavity_node[k]] += impulse[3 * node.shape[0] + row] * cavity_gradient[k]
