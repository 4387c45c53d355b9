"""Constraint rows and the compliance W = J A^-1 J^T by the forward half of the triangular solve.

Rows come in groups of eight, the columns of a panel: Y = L^-1 J^T, W = Y^T Y. Only supernodes that the elimination
tree leads to from a group's nodes are visited.
"""

from taichisoft.kernels.launch import kernel
from taichisoft.kernels.runtime import (
    CHUNK,
    THREADS,
    Integers,
    IntegerTable,
    Matrices,
    ScalarTable,
    Vectors,
    ti,
    vec3,
)
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


@kernel
def forward_solve(
    contact_node: IntegerTable,
    contact_weight: ScalarTable,
    basis: Matrices,
    cavity_of_row: Integers,
    cavity_start: Integers,
    cavity_node: Integers,
    cavity_gradient: Vectors,
    row_count: ti.i32,
    position_of: Integers,
    supernode_of_position: Integers,
    parent: Integers,
    front: IntegerTable,
    rows: Integers,
    panel: Columns,
    active: IntegerTable,
    y: Panels,
):
    """Y = L^-1 J^T, one task per group of eight rows; y has shape (group, scalar position)."""
    for g_ in range(y.shape[0] * CHUNK):
        if g_ % CHUNK == 0:
            g = y.shape[0] - 1 - g_ // CHUNK  # cavities, at the end, have most to do
            contact_rows = 3 * contact_node.shape[0]
            supernode_count = parent.shape[0]
            one = ti.min(row_count, 1)
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
                    cavity = cavity_of_row[r - contact_rows]
                    for k in range(cavity_start[cavity], cavity_start[cavity + 1]):
                        s = supernode_of_position[position_of[cavity_node[k]]]
                        while s >= 0 and active[g, s] == 0:
                            active[g, s] = 1
                            s = parent[s]
            for s in range(supernode_count):
                if active[g, s] != 0:
                    for i in range(front[s, 8], front[s, 8] + front[s, 0]):
                        y[g, i] = Column(0.0)
            for column in range(GROUP):
                r = GROUP * g + column
                if r < contact_rows:
                    c = r // 3
                    direction = vec3(basis[c][r % 3, 0], basis[c][r % 3, 1], basis[c][r % 3, 2])
                    for slot in range(contact_node.shape[1]):
                        if contact_node[c, slot] >= 0:
                            i = 3 * position_of[contact_node[c, slot]]
                            for d in ti.static(range(3)):
                                y[g, i + d][column] = y[g, i + d][column] + contact_weight[c, slot] * direction[d]
                elif r < row_count:
                    cavity = cavity_of_row[r - contact_rows]
                    for k in range(cavity_start[cavity], cavity_start[cavity + 1]):
                        i = 3 * position_of[cavity_node[k]]
                        for d in ti.static(range(3)):
                            y[g, i + d][column] = cavity_gradient[k][d]
            for s in range(supernode_count):
                if active[g, s] != 0:
                    eliminate(g, s, front, rows, panel, y, one)


@kernel
def soft_compliance(
    front: IntegerTable,
    active: IntegerTable,
    y: Panels,
    w: ScalarTable,
):
    """W = Y^T Y for every pair of groups, shared out among the workers; the upper triangle is mirrored."""
    for worker_ in range(THREADS * CHUNK):
        if worker_ % CHUNK == 0:
            group_count = y.shape[0]
            one = ti.min(w.shape[0], 1)
            for pair in range(group_count * group_count):
                g, h = pair // group_count, pair % group_count
                if g >= h and (g + h) % THREADS == worker_ // CHUNK:
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
