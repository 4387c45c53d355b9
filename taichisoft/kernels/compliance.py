"""Constraint rows and the compliance W = J A^-1 J^T by the forward half of the triangular solve.

Rows come in groups of eight, the columns of a panel: Y = L^-1 J^T, W = Y^T Y. Only supernodes that the elimination
tree leads to from a group's nodes are visited.
"""

from typing import NamedTuple

from taichisoft.kernels.actuators import Coordinates, Gradient
from taichisoft.kernels.cholesky import BELOW, COLUMNS, FIRST_COLUMN, PANEL, ROWS, WIDTH, Factor, Fronts
from taichisoft.kernels.constraint_rows import ACTUATORS, CONTACTS, MOMENTS, Rows
from taichisoft.kernels.launch import Kernel, func, kernel
from taichisoft.kernels.runtime import CHUNK, THREADS, Integers, IntegerTable, Scalars, ti, vec3
from taichisoft.kernels.tiles import TILE, Column, advance, opaque, tiles_in

GROUP = TILE

Panels = ti.types.ndarray(dtype=Column, ndim=2)


class EliminationTree(NamedTuple):
    """The way from a node up the tree of supernodes.

    Attributes:
        position_of_node: where each node stands in elimination order, shape (node_count,).
        supernode_of_position: shape (node_count,).
        parent: of each supernode, -1 for a root, shape (supernode_count,).
    """

    position_of_node: Integers
    supernode_of_position: Integers
    parent: Integers


class SparseColumns(NamedTuple):
    """Work space: L^-1 J^T, eight of its columns a group.

    Attributes:
        active: whether a group reaches a supernode, shape (group_capacity, supernode_count).
        y: entries in elimination order, shape (group_capacity, 3 node_count, 8).
        done: threads that have finished their groups, 0 at the start, shape (1,).
    """

    active: IntegerTable
    y: Panels
    done: Integers


@func
def eliminate(g: ti.i32, s: ti.i32, fronts: Fronts, factor: Factor, y: Panels, one: ti.i32):
    """The part of a supernode in L^-1 J^T: solve for its own rows, subtract their share from the rows below."""
    front, panel = ti.static(fronts.table, factor.tiles)
    width, columns, rest, start, first = (
        front[s, WIDTH],
        front[s, COLUMNS],
        front[s, BELOW],
        front[s, PANEL],
        front[s, FIRST_COLUMN],
    )
    for t in range(columns // TILE + tiles_in(rest)):
        row = opaque(start + t * columns, one)
        v = [Column(0.0) for _ in range(TILE)]
        k = 0
        while k < ti.min(TILE * t, width):
            factor_column, values = panel[row + k], y[g, first + k]
            for a in ti.static(range(TILE)):
                v[a] += factor_column[a] * values
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
                    target = fronts.rows[front[s, ROWS] + i]
                    y[g, target] = y[g, target] - v[a]


@func
def mark_path(g: ti.i32, node: ti.i32, tree: EliminationTree, active: IntegerTable):
    """Mark the supernodes from a node's own to the root."""
    s = tree.supernode_of_position[tree.position_of_node[node]]
    while s >= 0 and active[g, s] == 0:
        active[g, s] = 1
        s = tree.parent[s]


@func
def fill_group(
    g: ti.i32,
    rows: Rows,
    coordinates: Coordinates,
    gradient: Gradient,
    tree: EliminationTree,
    fronts: Fronts,
    columns: SparseColumns,
):
    """A group's columns of J^T, on the supernodes that it leads to; those of moments have nothing there."""
    active, y, position_of = ti.static(columns.active, columns.y, tree.position_of_node)
    contact_rows = 3 * rows.size[CONTACTS]
    last = ti.min(GROUP * (g + 1), contact_rows + rows.size[ACTUATORS])
    for s in range(tree.parent.shape[0]):
        active[g, s] = 0
    for r in range(GROUP * g, last):
        if r < contact_rows:
            for slot in range(rows.node.shape[1]):
                if rows.node[r // 3, slot] >= 0:
                    mark_path(g, rows.node[r // 3, slot], tree, active)
        else:
            coordinate = rows.coordinate[r - contact_rows]
            for k in range(coordinates.entry_start[coordinate], coordinates.entry_start[coordinate + 1]):
                mark_path(g, coordinates.entry_node[k], tree, active)
    for s in range(tree.parent.shape[0]):
        if active[g, s] != 0:
            first = fronts.table[s, FIRST_COLUMN]
            for i in range(first, first + fronts.table[s, WIDTH]):
                y[g, i] = Column(0.0)
    for r in range(GROUP * g, last):
        column = r - GROUP * g
        if r < contact_rows:
            c = r // 3
            direction = vec3(rows.basis[c][r % 3, 0], rows.basis[c][r % 3, 1], rows.basis[c][r % 3, 2])
            for slot in range(rows.node.shape[1]):
                if rows.node[c, slot] >= 0:
                    i = 3 * position_of[rows.node[c, slot]]
                    for d in ti.static(range(3)):
                        y[g, i + d][column] = y[g, i + d][column] + rows.weight[c, slot] * direction[d]
        else:
            coordinate = rows.coordinate[r - contact_rows]
            for k in range(coordinates.entry_start[coordinate], coordinates.entry_start[coordinate + 1]):
                i = 3 * position_of[coordinates.entry_node[k]]
                for d in ti.static(range(3)):
                    y[g, i + d][column] = gradient.soft[k][d]


@func
def multiply_groups(
    g: ti.i32, h: ti.i32, row_count: ti.i32, fronts: Fronts, columns: SparseColumns, w: Scalars, one: ti.i32
):
    """The block of W = Y^T Y of two groups, and its mirror image; W is stored by rows."""
    front, active, y = ti.static(fronts.table, columns.active, columns.y)
    total = [Column(0.0) for _ in range(GROUP)]
    for s in range(active.shape[1]):
        if active[g, s] != 0 and active[h, s] != 0:
            i, end = front[s, FIRST_COLUMN], front[s, FIRST_COLUMN] + front[s, WIDTH]
            while i < end:
                left, right = y[g, i], y[h, i]
                for a in ti.static(range(GROUP)):
                    total[a] += left[a] * right
                i = advance(i, 1, one)
    for a in ti.static(range(GROUP)):
        r = GROUP * g + a
        if r < row_count:
            for b in ti.static(range(GROUP)):
                q = GROUP * h + b
                if q < row_count:
                    w[r * row_count + q] = total[a][b]
                    w[q * row_count + r] = total[a][b]


def make_soft_compliance(workers: int) -> Kernel:
    """The kernel on a number of threads; one does not wake any other."""

    @kernel
    def soft_compliance(
        rows: Rows,
        coordinates: Coordinates,
        gradient: Gradient,
        tree: EliminationTree,
        fronts: Fronts,
        factor: Factor,
        columns: SparseColumns,
        w: Scalars,
        one: ti.i32,
    ):
        """Y = L^-1 J^T and W = Y^T Y.

        Neighbouring groups, which act on the same body, go to the same thread: they share what is in its cache.
        """
        ti.loop_config(serialize=workers == 1)
        for worker_ in range(workers * CHUNK):
            if worker_ % CHUNK == 0:
                row_count = 3 * (rows.size[CONTACTS] + rows.size[MOMENTS]) + rows.size[ACTUATORS]
                worker, group_count = worker_ // CHUNK, (row_count + GROUP - 1) // GROUP
                for g in range(worker * group_count // workers, (worker + 1) * group_count // workers):
                    fill_group(g, rows, coordinates, gradient, tree, fronts, columns)
                    for s in range(tree.parent.shape[0]):
                        if columns.active[g, s] != 0:
                            eliminate(g, s, fronts, factor, columns.y, one)
                ti.atomic_add(columns.done[0], 1)
                while ti.atomic_max(columns.done[0], 0) < workers:  # a load that the compiler may not move
                    pass
                for pair in range(group_count * group_count):
                    g, h = pair // group_count, pair % group_count
                    if g >= h and (g + h) % workers == worker:
                        multiply_groups(g, h, row_count, fronts, columns, w, one)

    return soft_compliance


soft_compliance, soft_compliance_serially = make_soft_compliance(THREADS), make_soft_compliance(1)
