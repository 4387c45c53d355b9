"""Constraint rows and the compliance W = J A^-1 J^T by the forward half of the triangular solve.

Rows come in groups of eight, the columns of a panel: Y = L^-1 J^T, W = Y^T Y. Only supernodes that the elimination
tree leads to from a group's nodes are visited, and have room in Y.
"""

from typing import NamedTuple

import numpy as np

from taichisoft.kernels.actuators import Coordinates, Gradient
from taichisoft.kernels.constraint_rows import ACTUATORS, CONTACTS, MOMENTS, Rows
from taichisoft.kernels.fronts import BELOW, COLUMNS, FIRST_COLUMN, PANEL, ROWS, WIDTH, Factor, Fronts
from taichisoft.kernels.launch import Kernel, func, kernel
from taichisoft.kernels.runtime import CHUNK, THREADS, Integers, IntegerTable, Scalars, ti, vec3
from taichisoft.kernels.tiles import TILE, Column, Columns, advance, opaque, tiles_in
from taichisoft.kernels.waiting import BEGUN_LATER, COUNTERS, FINISHED, PATIENCE, reaches

GROUP = TILE
# In the place of entries that are zero.
NOWHERE = -(2**30)


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
        place: what is added to an entry's number in elimination order to find it in `y`, NOWHERE if the group does not
            reach the supernode, shape (group_capacity, supernode_count).
        y: the entries of the supernodes that are reached, group by group, shape (capacity, 8).
        size: how many they are, shape (1,).
        progress: counters of `waiting`, 0 at the start.
    """

    place: IntegerTable
    y: Columns
    size: Integers
    progress: Integers

    @classmethod
    def with_room(cls, group_count: int, supernode_count: int, entry_count: int) -> "SparseColumns":
        """Arrays with room for so many groups and entries."""
        return cls(
            place=np.empty((group_count, supernode_count), dtype=np.int32),
            y=np.empty((entry_count, GROUP)),
            size=np.zeros(1, dtype=np.int32),
            progress=np.zeros(COUNTERS, dtype=np.int32),
        )


@func
def eliminate(
    g: ti.i32, s: ti.i32, fronts: Fronts, factor: Factor, tree: EliminationTree, columns: SparseColumns, one: ti.i32
):
    """The part of a supernode in L^-1 J^T: solve for its own rows, subtract their share from the rows below."""
    front, panel, y = ti.static(fronts.table, factor.tiles, columns.y)
    width, own_columns, rest, start = front[s, WIDTH], front[s, COLUMNS], front[s, BELOW], front[s, PANEL]
    first = opaque(columns.place[g, s] + front[s, FIRST_COLUMN], one)
    for t in range(own_columns // TILE + tiles_in(rest)):
        row = opaque(start + t * own_columns, one)
        v = [Column(0.0) for _ in range(TILE)]
        k = 0
        while k < ti.min(TILE * t, width):
            factor_column, values = panel[row + k], y[first + k]
            for a in ti.static(range(TILE)):
                v[a] += factor_column[a] * values
            k = advance(k, 1, one)
        if TILE * t < own_columns:
            for c in ti.static(range(TILE)):
                i = TILE * t + c
                if i < width:
                    factor_column = panel[row + i]
                    value = (y[first + i] - v[c]) * factor_column[c]
                    y[first + i] = value
                    for a in ti.static(range(c + 1, TILE)):
                        v[a] += factor_column[a] * value
        else:
            for a in ti.static(range(TILE)):
                i = TILE * (t - own_columns // TILE) + a
                if i < rest:
                    target = fronts.rows[front[s, ROWS] + i]
                    above = columns.place[g, tree.supernode_of_position[target // 3]] + target
                    y[above] = y[above] - v[a]


@func
def mark_path(g: ti.i32, node: ti.i32, tree: EliminationTree, fronts: Fronts, columns: SparseColumns):
    """Give room to the supernodes from a node's own to the root."""
    table, place, size = ti.static(fronts.table, columns.place, columns.size)
    s = tree.supernode_of_position[tree.position_of_node[node]]
    ended = 0
    while s >= 0 and ended == 0:
        if place[g, s] != NOWHERE:
            ended = 1
        else:
            place[g, s] = size[0] - table[s, FIRST_COLUMN]
            size[0] = size[0] + table[s, WIDTH]
            s = tree.parent[s]


@func
def give_places(rows: Rows, coordinates: Coordinates, tree: EliminationTree, fronts: Fronts, columns: SparseColumns):
    """Fill `columns.place` and `columns.size`: what each group reaches; moments reach no soft body."""
    contact_rows, row_count = 3 * rows.size[CONTACTS], 3 * (rows.size[CONTACTS] + rows.size[MOMENTS])
    columns.size[0] = 0
    for g in range((row_count + rows.size[ACTUATORS] + GROUP - 1) // GROUP):
        for s in range(tree.parent.shape[0]):
            columns.place[g, s] = NOWHERE
        for r in range(GROUP * g, ti.min(GROUP * (g + 1), contact_rows + rows.size[ACTUATORS])):
            if r < contact_rows:
                for slot in range(rows.node.shape[1]):
                    if rows.node[r // 3, slot] >= 0:
                        mark_path(g, rows.node[r // 3, slot], tree, fronts, columns)
            else:
                coordinate = rows.coordinate[r - contact_rows]
                for k in range(coordinates.entry_start[coordinate], coordinates.entry_start[coordinate + 1]):
                    mark_path(g, coordinates.entry_node[k], tree, fronts, columns)


@kernel
def lay_out_columns(
    rows: Rows, coordinates: Coordinates, tree: EliminationTree, fronts: Fronts, columns: SparseColumns
):
    """Find out how much room the columns need, before `soft_compliance`."""
    ti.loop_config(serialize=True)
    for _ in range(1):  # without a loop around them Taichi would share out the groups
        give_places(rows, coordinates, tree, fronts, columns)


@func
def first_entry(g: ti.i32, node: ti.i32, tree: EliminationTree, columns: SparseColumns) -> ti.i32:
    """Where the first of a node's three entries stands in `columns.y`."""
    position = tree.position_of_node[node]
    return columns.place[g, tree.supernode_of_position[position]] + 3 * position


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
    place, y = ti.static(columns.place, columns.y)
    contact_rows = 3 * rows.size[CONTACTS]
    for s in range(tree.parent.shape[0]):
        if place[g, s] != NOWHERE:
            first = place[g, s] + fronts.table[s, FIRST_COLUMN]
            for i in range(first, first + fronts.table[s, WIDTH]):
                y[i] = Column(0.0)
    for r in range(GROUP * g, ti.min(GROUP * (g + 1), contact_rows + rows.size[ACTUATORS])):
        column = r - GROUP * g
        if r < contact_rows:
            c = r // 3
            direction = vec3(rows.basis[c][r % 3, 0], rows.basis[c][r % 3, 1], rows.basis[c][r % 3, 2])
            for slot in range(rows.node.shape[1]):
                if rows.node[c, slot] >= 0:
                    i = first_entry(g, rows.node[c, slot], tree, columns)
                    for d in ti.static(range(3)):
                        y[i + d][column] = y[i + d][column] + rows.weight[c, slot] * direction[d]
        else:
            coordinate = rows.coordinate[r - contact_rows]
            for k in range(coordinates.entry_start[coordinate], coordinates.entry_start[coordinate + 1]):
                i = first_entry(g, coordinates.entry_node[k], tree, columns)
                for d in ti.static(range(3)):
                    y[i + d][column] = gradient.soft[k][d]


@func
def multiply_groups(
    g: ti.i32, h: ti.i32, row_count: ti.i32, fronts: Fronts, columns: SparseColumns, w: Scalars, one: ti.i32
):
    """The block of W = Y^T Y of two groups, and its mirror image; W is stored by rows."""
    front, place, y = ti.static(fronts.table, columns.place, columns.y)
    total = [Column(0.0) for _ in range(GROUP)]
    for s in range(place.shape[1]):
        if place[g, s] != NOWHERE and place[h, s] != NOWHERE:
            one_row = opaque(place[g, s] + front[s, FIRST_COLUMN], one)
            other_row = opaque(place[h, s] + front[s, FIRST_COLUMN], one)
            i = 0
            while i < front[s, WIDTH]:
                left, right = y[one_row + i], y[other_row + i]
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


@func
def add_begun(g: ti.i32, row_count: ti.i32, begun: Scalars, fronts: Fronts, columns: SparseColumns, velocity: Scalars):
    """Add Y^T L^-1 b, what the right-hand side b does to a group's rows, to their velocities."""
    front, y = ti.static(fronts.table, columns.y)
    total = Column(0.0)
    for s in range(columns.place.shape[1]):
        if columns.place[g, s] != NOWHERE:
            for i in range(front[s, FIRST_COLUMN], front[s, FIRST_COLUMN] + front[s, WIDTH]):
                total += y[columns.place[g, s] + i] * begun[i]
    for a in ti.static(range(GROUP)):
        if GROUP * g + a < row_count:
            velocity[GROUP * g + a] = velocity[GROUP * g + a] + total[a]


@func
def patience(group_count: ti.i32, fronts: Fronts) -> ti.i32:
    """How often a thread looks for the others' groups: each needs nanoseconds for a column of tiles of the factor."""
    columns_of_tiles = fronts.table[fronts.table.shape[0] - 1, PANEL]
    return PATIENCE + ti.cast(ti.min(0.25 * group_count * columns_of_tiles, 1e8), ti.i32)


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
        begun: Scalars,
        w: Scalars,
        one: ti.i32,
    ):
        """Y = L^-1 J^T and W = Y^T Y, with the places of `lay_out_columns`, or on one thread its own.

        To the rows' velocities, `rows.free`, is added what the right-hand side does to them of which L^-1 b is begun.
        Neighbouring groups, which act on the same body, go to the same thread: they share what is in its cache.
        """
        ti.loop_config(serialize=workers == 1)
        for worker_ in range(workers * CHUNK):
            if worker_ % CHUNK == 0:
                row_count = 3 * (rows.size[CONTACTS] + rows.size[MOMENTS]) + rows.size[ACTUATORS]
                worker, group_count = worker_ // CHUNK, (row_count + GROUP - 1) // GROUP
                if ti.static(workers == 1):
                    give_places(rows, coordinates, tree, fronts, columns)
                for g in range(worker * group_count // workers, (worker + 1) * group_count // workers):
                    fill_group(g, rows, coordinates, gradient, tree, fronts, columns)
                    for s in range(tree.parent.shape[0]):
                        if columns.place[g, s] != NOWHERE:
                            eliminate(g, s, fronts, factor, tree, columns, one)
                    add_begun(g, row_count, begun, fronts, columns, rows.free)
                ti.atomic_add(columns.progress[FINISHED], 1)
                if reaches(columns.progress, FINISHED, workers, patience(group_count, fronts)):
                    share = ti.atomic_add(columns.progress[BEGUN_LATER], 1)
                    while share < workers:
                        for pair in range(group_count * group_count):
                            g, h = pair // group_count, pair % group_count
                            if g >= h and (g + h) % workers == share:
                                multiply_groups(g, h, row_count, fronts, columns, w, one)
                        share = ti.atomic_add(columns.progress[BEGUN_LATER], 1)

    return soft_compliance


soft_compliance, soft_compliance_serially = make_soft_compliance(THREADS), make_soft_compliance(1)
