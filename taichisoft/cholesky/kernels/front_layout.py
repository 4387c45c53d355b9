"""Where the fronts of a factorisation lie in memory, and the factor that `factorisation.py` computes."""

from typing import NamedTuple

from taichisoft.runtime.language import Integers, IntegerTable, Scalars
from taichisoft.runtime.tiles import Columns

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
