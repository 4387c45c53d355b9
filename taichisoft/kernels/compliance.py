"""Constraint rows and the compliance W = J A^-1 J^T by the forward half of the triangular solve.

Rows come in groups of eight, the columns of a panel: Y = L^-1 J^T, W = Y^T Y. Only supernodes that the elimination
tree leads to from a group's nodes are visited.
"""

from taichisoft.kernels.runtime import (
    CHUNK,
    Integers,
    IntegerTable,
    Matrices,
    Scalars,
    ScalarTable,
    Vectors,
    ti,
    vec3,
)

GROUP = 8

Table3 = ti.types.ndarray(dtype=ti.i32, ndim=3)
Panels = ti.types.ndarray(dtype=ti.f64, ndim=3)
Columns = ti.types.vector(GROUP, ti.f64)


@ti.kernel
def soft_entries(
    sign: Vectors,
    vertices: Table3,
    weights: ti.types.ndarray(dtype=vec3, ndim=2),
    vertex_nodes: IntegerTable,
    vertex_weights: ScalarTable,
    owner: Integers,
    node: IntegerTable,
    weight: ScalarTable,
):
    """Soft nodes and signed weights of both points of each contact, in slots of fixed number; -1 for no node."""
    per_vertex = vertex_nodes.shape[1]
    for c in range(node.shape[0]):
        for side in range(2):
            for k in ti.static(range(3)):
                v = vertices[c, side, k]
                for m in range(per_vertex):
                    slot = (side * 3 + k) * per_vertex + m
                    node[c, slot] = -1
                    weight[c, slot] = 0.0
                    if v >= 0 and owner[v] == -2 and weights[c, side][k] != 0.0:
                        node[c, slot] = vertex_nodes[v, m]
                        weight[c, slot] = sign[side][0] * weights[c, side][k] * vertex_weights[v, m]


@ti.kernel
def contact_velocity(
    node: IntegerTable,
    weight: ScalarTable,
    basis: Matrices,
    rigid: IntegerTable,
    rigid_linear: ti.types.ndarray(dtype=ti.f64, ndim=3),
    node_velocity: Vectors,
    rigid_velocity: ScalarTable,
    result: Vectors,
):
    """Relative velocity of each contact's second point to its first, in the contact's basis [mm/s]."""
    for c in range(node.shape[0]):
        soft = vec3(0.0)
        for slot in range(node.shape[1]):
            if node[c, slot] >= 0:
                soft += weight[c, slot] * node_velocity[node[c, slot]]
        total = basis[c] @ soft
        for side in range(2):
            if rigid[c, side] >= 0:
                for i in ti.static(range(3)):
                    for d in range(6):
                        total[i] += rigid_linear[3 * c + i, side, d] * rigid_velocity[rigid[c, side], d]
        result[c] = total


@ti.kernel
def forward_solve(
    contact_node: IntegerTable,
    contact_weight: ScalarTable,
    basis: Matrices,
    cavity_start: Integers,
    cavity_node: Integers,
    cavity_gradient: Vectors,
    row_count: ti.i32,
    position_of: Integers,
    supernode_of_position: Integers,
    parent: Integers,
    front: IntegerTable,
    rows: Integers,
    panel: Scalars,
    active: IntegerTable,
    y: Panels,
):
    """Y = L^-1 J^T, one task per group of eight rows; y has shape (group, scalar position, column)."""
    for g_ in range(y.shape[0] * CHUNK):
        if g_ % CHUNK == 0:
            g = g_ // CHUNK
            contact_rows = 3 * contact_node.shape[0]
            supernode_count = parent.shape[0]
            for s in range(supernode_count):
                active[g, s] = 0
            for column in range(GROUP):
                r = GROUP * g + column
                if r < contact_rows:
                    for slot in range(contact_node.shape[1]):
                        if contact_node[r // 3, slot] >= 0:
                            s = supernode_of_position[position_of[contact_node[r // 3, slot]]]
                            while s >= 0 and active[g, s] == 0:
                                active[g, s] = 1
                                s = parent[s]
                elif r < row_count:
                    cavity = r - contact_rows
                    for k in range(cavity_start[cavity], cavity_start[cavity + 1]):
                        s = supernode_of_position[position_of[cavity_node[k]]]
                        while s >= 0 and active[g, s] == 0:
                            active[g, s] = 1
                            s = parent[s]
            for s in range(supernode_count):
                if active[g, s] != 0:
                    for i in range(3 * front[s, 7], 3 * (front[s, 7] + front[s, 0])):
                        for column in range(GROUP):
                            y[g, i, column] = 0.0
            for column in range(GROUP):
                r = GROUP * g + column
                if r < contact_rows:
                    c = r // 3
                    direction = vec3(basis[c][r % 3, 0], basis[c][r % 3, 1], basis[c][r % 3, 2])
                    for slot in range(contact_node.shape[1]):
                        if contact_node[c, slot] >= 0:
                            i = 3 * position_of[contact_node[c, slot]]
                            for d in ti.static(range(3)):
                                y[g, i + d, column] = y[g, i + d, column] + contact_weight[c, slot] * direction[d]
                elif r < row_count:
                    cavity = r - contact_rows
                    for k in range(cavity_start[cavity], cavity_start[cavity + 1]):
                        i = 3 * position_of[cavity_node[k]]
                        for d in ti.static(range(3)):
                            y[g, i + d, column] = cavity_gradient[k][d]
            for s in range(supernode_count):
                if active[g, s] != 0:
                    width, height, p, first = 3 * front[s, 0], 3 * front[s, 1], front[s, 2], 3 * front[s, 7]
                    for k in range(width):
                        inverse = 1.0 / panel[p + k * height + k]
                        pivot = Columns(0.0)
                        for column in ti.static(range(GROUP)):
                            pivot[column] = y[g, first + k, column] * inverse
                            y[g, first + k, column] = pivot[column]
                        for i in range(k + 1, width):
                            factor = panel[p + k * height + i]
                            for column in ti.static(range(GROUP)):
                                y[g, first + i, column] = y[g, first + i, column] - factor * pivot[column]
                    for node in range(front[s, 0], front[s, 1]):
                        target = 3 * rows[front[s, 6] + node]
                        for a in ti.static(range(3)):
                            total = Columns(0.0)
                            for k in range(width):
                                factor = panel[p + k * height + 3 * node + a]
                                for column in ti.static(range(GROUP)):
                                    total[column] += factor * y[g, first + k, column]
                            for column in ti.static(range(GROUP)):
                                y[g, target + a, column] = y[g, target + a, column] - total[column]


@ti.kernel
def soft_compliance(
    front: IntegerTable,
    active: IntegerTable,
    y: Panels,
    w: ScalarTable,
):
    """W = Y^T Y for every pair of groups, one task per pair; the upper triangle is mirrored."""
    group_count = y.shape[0]
    for t_ in range(group_count * group_count * CHUNK):
        if t_ % CHUNK == 0:
            g, h = t_ // CHUNK // group_count, t_ // CHUNK % group_count
            if g >= h:
                for a in range(GROUP):
                    total = Columns(0.0)
                    for s in range(active.shape[1]):
                        if active[g, s] != 0 and active[h, s] != 0:
                            for i in range(3 * front[s, 7], 3 * (front[s, 7] + front[s, 0])):
                                factor = y[g, i, a]
                                for b in ti.static(range(GROUP)):
                                    total[b] += factor * y[h, i, b]
                    for b in ti.static(range(GROUP)):
                        r, q = GROUP * g + a, GROUP * h + b
                        if r < w.shape[0] and q < w.shape[0]:
                            w[r, q] = total[b]
                            w[q, r] = total[b]


@ti.kernel
def rigid_compliance(
    rigid: IntegerTable,
    jacobian: ti.types.ndarray(dtype=ti.f64, ndim=3),
    inverse_mass: ti.types.ndarray(dtype=ti.f64, ndim=3),
    w: ScalarTable,
):
    """Add J M^-1 J^T of the rigid bodies that two contacts share, M^-1 of shape (body, 6, 6)."""
    contact_count = rigid.shape[0]
    for c in range(contact_count):
        for other in range(contact_count):
            for side, other_side in ti.ndrange(2, 2):
                body = rigid[c, side]
                if body >= 0 and body == rigid[other, other_side]:
                    for i in range(3):
                        for j in range(3):
                            total = 0.0
                            for m in range(6):
                                for n in range(6):
                                    total += (
                                        jacobian[3 * c + i, side, m]
                                        * inverse_mass[body, m, n]
                                        * jacobian[3 * other + j, other_side, n]
                                    )
                            w[3 * c + i, 3 * other + j] = w[3 * c + i, 3 * other + j] + total


@ti.kernel
def scatter_impulses(
    contact_node: IntegerTable,
    contact_weight: ScalarTable,
    basis: Matrices,
    impulse: Vectors,
    cavity_start: Integers,
    cavity_node: Integers,
    cavity_gradient: Vectors,
    cavity_impulse: Scalars,
    node_impulse: Vectors,
):
    """J^T lambda on the soft nodes, in a fixed order."""
    ti.loop_config(serialize=True)
    for c in range(contact_node.shape[0]):
        world = basis[c].transpose() @ impulse[c]
        for slot in range(contact_node.shape[1]):
            if contact_node[c, slot] >= 0:
                node_impulse[contact_node[c, slot]] += contact_weight[c, slot] * world
    for cavity in range(cavity_impulse.shape[0]):
        for k in range(cavity_start[cavity], cavity_start[cavity + 1]):
            node_impulse[cavity_node[k]] += cavity_impulse[cavity] * cavity_gradient[k]
