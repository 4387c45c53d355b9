"""Constraint rows and the compliance W = J A^-1 J^T by the forward half of the triangular solve.

Rows come in groups of eight, the columns of a panel: Y = L^-1 J^T, W = Y^T Y. Only supernodes that the elimination
tree leads to from a group's nodes are visited.
"""

from taichisoft.kernels.launch import Kernel, kernel
from taichisoft.kernels.runtime import CHUNK, THREADS, Integers, IntegerTable, Matrices, ScalarTable, Vectors, ti, vec3
from taichisoft.kernels.tiles import TILE, Column, Columns, advance, opaque, tiles_in

GROUP = TILE

Panels = ti.types.ndarray(dtype=Column, ndim=2)


@ti.func
def eliminate(g: ti.i32, s: ti.i32, front: IntegerTable, position: Integers, panel: Columns, y: Panels, one: ti.i32):
    """The part of a supernode in L^-1 J^T: solve for its own rows, subtract their share from the rows below."""
    width, columns, rest, start, first = front[s, 0], front[s, 1], front[s, 2], front[s, 3], front[s, 8]
    for t in range(columns // TILE + tiles_in(rest)):
        row = opaque(start + t * columns, one)
        v = [Column(0.0) for _ in range(TILE)]
        k = 0
        while k < ti.min(TILE * t, width):
            factor, values = panel[row + k], y[g, first + k]
            for a in ti.static(range(TILE)):
                v[a] += factor[a] * values
            k = advance(k, 1, one)
        if TILE * t < columns:
            for c in ti.static(range(TILE)):
                i = TILE * t + c
                if i < width:
                    factor_column = panel[row + i]
                    value = (y[g, first + i] - v[c]) * factor_column[c]
                    y[g, first + i] = value
                    for a in ti.static(range(c + 1, TILE)):
                        v[a] += factor_column[a] * value
        else:
            for a in ti.static(range(TILE)):
                i = TILE * (t - columns // TILE) + a
                if i < rest:
                    target = position[front[s, 7] + i]
                    y[g, target] = y[g, target] - v[a]


@ti.func
def mark_path(
    g: ti.i32,
    node: ti.i32,
    position_of: Integers,
    supernode_of_position: Integers,
    parent: Integers,
    active: IntegerTable,
):
    """Mark the supernodes from a node's own to the root."""
    s = supernode_of_position[position_of[node]]
    while s >= 0 and active[g, s] == 0:
        active[g, s] = 1
        s = parent[s]


@ti.func
def fill_group(
    g: ti.i32,
    contact_node: IntegerTable,
    contact_weight: ScalarTable,
    basis: Matrices,
    cavity_of_row: Integers,
    cavity_start: Integers,
    cavity_node: Integers,
    cavity_gradient: Vectors,
    position_of: Integers,
    supernode_of_position: Integers,
    parent: Integers,
    front: IntegerTable,
    active: IntegerTable,
    y: Panels,
):
    """A group's columns of J^T, on the supernodes that it leads to."""
    contact_rows = 3 * contact_node.shape[0]
    last = ti.min(GROUP * (g + 1), contact_rows + cavity_of_row.shape[0])
    for s in range(parent.shape[0]):
        active[g, s] = 0
    for r in range(GROUP * g, last):
        if r < contact_rows:
            for slot in range(contact_node.shape[1]):
                if contact_node[r // 3, slot] >= 0:
                    mark_path(g, contact_node[r // 3, slot], position_of, supernode_of_position, parent, active)
        else:
            cavity = cavity_of_row[r - contact_rows]
            for k in range(cavity_start[cavity], cavity_start[cavity + 1]):
                mark_path(g, cavity_node[k], position_of, supernode_of_position, parent, active)
    for s in range(parent.shape[0]):
        if active[g, s] != 0:
            for i in range(front[s, 8], front[s, 8] + front[s, 0]):
                y[g, i] = Column(0.0)
    for r in range(GROUP * g, last):
        column = r - GROUP * g
        if r < contact_rows:
            c = r // 3
            direction = vec3(basis[c][r % 3, 0], basis[c][r % 3, 1], basis[c][r % 3, 2])
            for slot in range(contact_node.shape[1]):
                if contact_node[c, slot] >= 0:
                    i = 3 * position_of[contact_node[c, slot]]
                    for d in ti.static(range(3)):
                        y[g, i + d][column] = y[g, i + d][column] + contact_weight[c, slot] * direction[d]
        else:
            cavity = cavity_of_row[r - contact_rows]
            for k in range(cavity_start[cavity], cavity_start[cavity + 1]):
                i = 3 * position_of[cavity_node[k]]
                for d in ti.static(range(3)):
                    y[g, i + d][column] = cavity_gradient[k][d]


@ti.func
def multiply_groups(
    g: ti.i32, h: ti.i32, front: IntegerTable, active: IntegerTable, y: Panels, w: ScalarTable, one: ti.i32
):
    """The block of W = Y^T Y of two groups, and its mirror image."""
    total = [Column(0.0) for _ in range(GROUP)]
    for s in range(active.shape[1]):
        if active[g, s] != 0 and active[h, s] != 0:
            i, end = front[s, 8], front[s, 8] + front[s, 0]
            while i < end:
                left, right = y[g, i], y[h, i]
                for a in ti.static(range(GROUP)):
                    total[a] += left[a] * right
                i = advance(i, 1, one)
    for a in ti.static(range(GROUP)):
        r = GROUP * g + a
        if r < w.shape[0]:
            for b in ti.static(range(GROUP)):
                q = GROUP * h + b
                if q < w.shape[0]:
                    w[r, q] = total[a][b]
                    w[q, r] = total[a][b]


def make_soft_compliance(workers: int) -> Kernel:
    """The kernel on a number of threads; one does not wake any other."""

    @kernel
    def soft_compliance(
        contact_node: IntegerTable,
        contact_weight: ScalarTable,
        basis: Matrices,
        cavity_of_row: Integers,
        cavity_start: Integers,
        cavity_node: Integers,
        cavity_gradient: Vectors,
        position_of: Integers,
        supernode_of_position: Integers,
        parent: Integers,
        front: IntegerTable,
        rows: Integers,
        panel: Columns,
        active: IntegerTable,
        y: Panels,
        w: ScalarTable,
        done: Integers,
        one: ti.i32,
    ):
        """Y = L^-1 J^T, of shape (group, scalar position), and W = Y^T Y; `done` must be 0 and counts the threads.

        Neighbouring groups, which act on the same body, go to the same thread: they share what is in its cache.
        """
        ti.loop_config(serialize=workers == 1)
        for worker_ in range(workers * CHUNK):
            if worker_ % CHUNK == 0:
                worker, group_count = worker_ // CHUNK, y.shape[0]
                for g in range(worker * group_count // workers, (worker + 1) * group_count // workers):
                    fill_group(
                        g, contact_node, contact_weight, basis, cavity_of_row, cavity_start, cavity_node,
                        cavity_gradient, position_of, supernode_of_position, parent, front, active, y,
                    )  # fmt: skip
                    for s in range(parent.shape[0]):
                        if active[g, s] != 0:
                            eliminate(g, s, front, rows, panel, y, one)
                ti.atomic_add(done[0], 1)
                while ti.atomic_max(done[0], 0) < workers:  # a load that the compiler may not move
                    pass
                for pair in range(group_count * group_count):
                    g, h = pair // group_count, pair % group_count
                    if g >= h and (g + h) % workers == worker:
                        multiply_groups(g, h, front, active, y, w, one)

    return soft_compliance


soft_compliance, soft_compliance_serially = make_soft_compliance(THREADS), make_soft_compliance(1)
