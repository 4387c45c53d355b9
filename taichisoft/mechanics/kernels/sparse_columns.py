"""Columns of L^-1 J^T for sparse J: which supernodes they reach, where these lie in memory, and their elimination.

Columns come in groups of eight, the columns of a panel. Only supernodes that the elimination tree leads to from a
group's nodes are visited, and have room.
"""

from typing import NamedTuple

import numpy as np

from taichisoft.runtime.arithmetic import COUNTERS, TILE, Column, Columns, advance, opaque, tiles_in
from taichisoft.runtime.language import Integers, IntegerTable, Scalars, func, ti

# Where the fronts of a factorisation lie in memory, and the factor that `factorisation.py` computes.

# Columns of the table of fronts: number of own columns, the same padded, number of rows below; start of the panel and
# of the update matrix in columns of tiles; where the lists of matrix blocks, of children and of rows begin; the first
# column in elimination order; and how many of the rows below are own columns of the parent.
WIDTH, COLUMNS, BELOW, PANEL, UPDATE, BLOCKS, CHILDREN, ROWS, FIRST_COLUMN, IN_PARENT = range(10)
# Columns of the table of tasks: a range of supernodes, the pieces that must be finished before, a range of rows of
# tiles of the panel, and one of columns of tiles of the update matrix.
FIRST_FRONT, LAST_FRONT, AWAITED, FIRST_ROW, LAST_ROW, FIRST_UPDATE, LAST_UPDATE = range(7)


class Fronts(NamedTuple):
    """How the fronts lie in memory, and the tasks that compute them; all indices count scalars, three for a node.

    Attributes:
        table: a row for each supernode, and one that closes the ranges; its columns stand above.
        rows: rows below of every supernode in elimination order, each list padded to whole tiles with the number of
            rows of the matrix.
        relative: the same rows in the parent's panel and the update matrix that follows it. Padding repeats the last
            row, so that the zeros which it adds go to no entry of another task.
        children: children of every supernode, ascending, shape (count - number of roots + 1,).
        block_place: where each row of each block begins in the memory of all fronts, shape (block_count, 3).
        tasks: in the order in which threads take them; its columns stand above.
        pieces: number of pieces that each front is computed in, shape (count,).
        patience: how often a thread looks in vain at tasks before it may leave, shape (1,).
    """

    table: IntegerTable
    rows: Integers
    relative: Integers
    children: Integers
    block_place: IntegerTable
    tasks: IntegerTable
    pieces: Integers
    patience: Integers


class Factor(NamedTuple):
    """The factor and the update matrices.

    Attributes:
        tiles: columns of tiles, shape (count, 8).
        scalars: the same memory number by number.
        done: finished pieces of each front, 0 at the start, shape (supernode_count,).
        failed_column: first column without a positive pivot, lowered from the number of rows, shape (1,).
        taken: 1 for tasks that a thread has begun, 0 at the start, shape (task_count,).
    """

    tiles: Columns
    scalars: Scalars
    done: Integers
    failed_column: Integers
    taken: Integers


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
