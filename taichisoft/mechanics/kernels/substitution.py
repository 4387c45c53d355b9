"""L^-1 b with the factor of `mechanics/kernels/factorisation.py`, front by front.

As the factorisation does with matrices, a front adds up what its children leave of the right-hand side for its rows,
so that branches of the elimination tree need nothing of one another and sums have a fixed order. Threads take the
branches in turn, and the one that finishes the last of them continues with the supernodes above.
"""

from typing import NamedTuple

from taichisoft.mechanics.kernels.sparse_columns import (
    BELOW,
    CHILDREN,
    COLUMNS,
    FIRST_COLUMN,
    GROUP,
    IN_PARENT,
    NOWHERE,
    PANEL,
    ROWS,
    WIDTH,
    Factor,
    Fronts,
    SparseColumns,
)
from taichisoft.runtime.arithmetic import (
    BEGUN,
    BEGUN_LATER,
    FINISHED,
    TILE,
    Column,
    Columns,
    advance,
    opaque,
    reaches,
    tiles_in,
)
from taichisoft.runtime.language import CHUNK, Integers, Scalars, Vectors, func, ti, vec3
from taichisoft.runtime.launch import kernel


class Substitution(NamedTuple):
    """A right-hand side on its way to the solution.

    Attributes:
        supernodes: all of them, branch by branch, and at the end those above the branches, shape (supernode_count,).
        branch_start: where each branch begins in `supernodes`, and those above, shape (branch_count + 2,).
        order: the node at each place of the elimination order, shape (node_count,).
        given, found: right-hand side b and solution by nodes, shape (node_count, 3).
        forward: L^-1 b in elimination order, shape (3 node_count + 8,).
        x: the solution in elimination order, of the same shape.
        left: what the rows below each front are left, at the places of `Fronts.rows`.
        left_tiles: the same memory in columns of tiles.
        progress: counters of `waiting`, 0 at the start.
    """

    supernodes: Integers
    branch_start: Integers
    order: Integers
    given: Vectors
    found: Vectors
    forward: Scalars
    x: Scalars
    left: Scalars
    left_tiles: Columns
    progress: Integers


@func
def multiply_row(tiles: Columns, row: ti.i32, columns: ti.i32, x: Scalars, first: ti.i32, one: ti.i32):
    """A row of tiles, of a number of columns divisible by 4, times the entries of x from `first`."""
    s = [Column(0.0) for _ in range(4)]
    k = 0
    while k < columns:
        for i in ti.static(range(4)):
            s[i] += tiles[row + k + i] * x[first + k + i]
        k = advance(k, 4, one)
    return (s[0] + s[1]) + (s[2] + s[3])


@func
def gather(s: ti.i32, fronts: Fronts, solution: Substitution):
    """What a front's right-hand side is: the given one, and what the children leave."""
    front, b, left = ti.static(fronts.table, solution.forward, solution.left)
    columns, first, rows = front[s, COLUMNS], front[s, FIRST_COLUMN], front[s, ROWS]
    for place in range(first // 3, (first + front[s, WIDTH]) // 3):
        given = solution.given[solution.order[place]]
        for d in ti.static(range(3)):
            b[3 * place + d] = given[d]
    for t in range(tiles_in(front[s, BELOW])):
        solution.left_tiles[rows // TILE + t] = Column(0.0)
    for k in range(front[s, CHILDREN], front[s + 1, CHILDREN]):
        child = fronts.children[k]
        start, in_panel = front[child, ROWS], front[child, IN_PARENT]
        for i in range(in_panel):
            target = first + fronts.relative[start + i]
            b[target] = b[target] + left[start + i]
        for i in range(in_panel, front[child, BELOW]):
            target = rows + fronts.relative[start + i] - columns
            left[target] = left[target] + left[start + i]


@func
def substitute_forward(
    s: ti.i32, first_row: ti.i32, last_row: ti.i32, fronts: Fronts, factor: Factor, solution: Substitution, one: ti.i32
):
    """In rows of tiles of a panel solve for the own entries of L^-1 b, or subtract their share from those below."""
    front, tiles, scalars = ti.static(fronts.table, factor.tiles, factor.scalars)
    b, left = ti.static(solution.forward, solution.left_tiles)
    width, columns, start, first = front[s, WIDTH], front[s, COLUMNS], front[s, PANEL], front[s, FIRST_COLUMN]
    for t in range(first_row, ti.min(last_row, columns // TILE)):
        row = opaque(start + t * columns, one)
        d, i = row + TILE * t, first + TILE * t
        v = -multiply_row(tiles, row, TILE * t, b, first, one)
        for c in ti.static(range(TILE)):
            v[c] += b[i + c]
        for c in ti.static(range(TILE)):
            value = v[c] * scalars[TILE * (d + c) + c]
            for a in ti.static(range(c + 1, TILE)):
                v[a] -= scalars[TILE * (d + c) + a] * value
            if TILE * t + c < width:
                b[i + c] = value
    for t in range(ti.max(first_row, columns // TILE), last_row):
        row = opaque(start + t * columns, one)
        place = opaque(front[s, ROWS] // TILE + t - columns // TILE, one)
        left[place] = left[place] - multiply_row(tiles, row, columns, b, first, one)


@func
def take_branch(counters: Integers, i: ti.i32, branch_count: ti.i32) -> ti.i32:
    """The next branch that no thread has begun, or a number over branch_count if there is none.

    Never branch_count itself, which stands for what is above all branches: that they are taken does not mean finished.
    """
    t = ti.atomic_add(counters[i], 1)
    return t + ti.select(t == branch_count, 1, 0)


@kernel
def forward(fronts: Fronts, factor: Factor, solution: Substitution, workers: ti.i32, one: ti.i32):
    """Fill `solution.forward`, which is 0 at the start."""
    for worker in range(workers * CHUNK):
        if worker % CHUNK == 0:
            start, progress = ti.static(solution.branch_start, solution.progress)
            branch_count = start.shape[0] - 2
            t = take_branch(progress, BEGUN, branch_count)
            while t < branch_count + 1:
                for i in range(start[t], start[t + 1]):
                    s = solution.supernodes[i]
                    row_count = fronts.table[s, COLUMNS] // TILE + tiles_in(fronts.table[s, BELOW])
                    gather(s, fronts, solution)
                    substitute_forward(s, 0, row_count, fronts, factor, solution, one)
                if ti.atomic_add(progress[FINISHED], 1) == branch_count - 1:
                    t = branch_count
                else:
                    t = take_branch(progress, BEGUN, branch_count)


# The same for small problems: it wakes no other thread.
forward_alone = forward.serial()


# L^-T (L^-1 b + Y lambda): the solution with a right-hand side b + J^T lambda.
#
# Of the rows J^T there is Y = L^-1 J^T from their compliance, and of b what the forward substitution has left, so that
# impulses in the rows cost no further solve. One thread begins with the supernodes above all branches, then threads
# take the branches in turn.


@func
def combine(
    s: ti.i32, row_count: ti.i32, impulse: Scalars, columns: SparseColumns, fronts: Fronts, solution: Substitution
):
    """The part of a supernode in L^-1 b + Y lambda."""
    y, x, table = ti.static(columns.y, solution.x, fronts.table)
    first, width = table[s, FIRST_COLUMN], table[s, WIDTH]
    for i in range(first, first + width):
        x[i] = solution.forward[i]
    for g in range((row_count + GROUP - 1) // GROUP):
        place = columns.place[g, s]
        if place != NOWHERE:
            share = Column(0.0)
            for a in ti.static(range(GROUP)):
                if GROUP * g + a < row_count:
                    share[a] = impulse[GROUP * g + a]
            for i in range(first, first + width):
                x[i] = x[i] + (y[place + i] * share).sum()


@func
def substitute_back(s: ti.i32, fronts: Fronts, factor: Factor, solution: Substitution, one: ti.i32):
    """Solve for a front's own entries of L^-T y from the entries of its rows below."""
    front, tiles, scalars = ti.static(fronts.table, factor.tiles, factor.scalars)
    x, below = ti.static(solution.x, solution.left_tiles)
    width, columns, start, first = front[s, WIDTH], front[s, COLUMNS], front[s, PANEL], front[s, FIRST_COLUMN]
    work = front[s, ROWS] // TILE
    for t in range(tiles_in(front[s, BELOW])):
        for a in ti.static(range(TILE)):
            below[work + t][a] = x[fronts.rows[front[s, ROWS] + TILE * t + a]]
    for back in range(columns // TILE):
        b = columns // TILE - 1 - back
        sums = [Column(0.0) for _ in range(TILE)]
        for t in range(b + 1, columns // TILE):
            values = Column(0.0)
            for a in ti.static(range(TILE)):
                values[a] = x[first + TILE * t + a]
            column = opaque(start + t * columns + TILE * b, one)
            for c in ti.static(range(TILE)):
                sums[c] += tiles[column + c] * values
        k = 0
        while k < tiles_in(front[s, BELOW]):
            values_below = below[work + k]
            column_below = start + (columns // TILE + k) * columns + TILE * b
            for c in ti.static(range(TILE)):
                sums[c] += tiles[column_below + c] * values_below
            k = advance(k, 1, one)
        d, i = start + b * columns + TILE * b, first + TILE * b
        v = Column(0.0)
        for c in ti.static(range(TILE)):
            v[c] = x[i + c] - sums[c].sum()
        for c in ti.static(range(TILE - 1, -1, -1)):
            for a in ti.static(range(c + 1, TILE)):
                v[c] -= scalars[TILE * (d + c) + a] * v[a]
            v[c] *= scalars[TILE * (d + c) + c]
            if TILE * b + c < width:
                x[i + c] = v[c]


@func
def hand_out(s: ti.i32, fronts: Fronts, solution: Substitution):
    """Give a supernode's part of the solution to its nodes."""
    x, table = ti.static(solution.x, fronts.table)
    first = table[s, FIRST_COLUMN]
    for place in range(first // 3, (first + table[s, WIDTH]) // 3):
        solution.found[solution.order[place]] = vec3(x[3 * place], x[3 * place + 1], x[3 * place + 2])


@kernel
def back(
    row_count: ti.i32,
    impulse: Scalars,
    columns: SparseColumns,
    fronts: Fronts,
    factor: Factor,
    solution: Substitution,
    workers: ti.i32,
    one: ti.i32,
):
    """Fill `solution.found`."""
    for worker in range(workers * CHUNK):
        if worker % CHUNK == 0:
            start, progress = ti.static(solution.branch_start, solution.progress)
            above = start.shape[0] - 2
            t = above
            if ti.atomic_add(progress[BEGUN], 1) > 0:
                t = above + 1
                if reaches(progress, FINISHED, 1, fronts.patience[0]):  # tasks of the factorisation take longer
                    t = take_branch(progress, BEGUN_LATER, above)
            while t < above + 1:
                for i in range(start[t + 1] - start[t]):
                    s = solution.supernodes[start[t + 1] - 1 - i]
                    combine(s, row_count, impulse, columns, fronts, solution)
                    substitute_back(s, fronts, factor, solution, one)
                    hand_out(s, fronts, solution)
                if t == above:
                    ti.atomic_add(progress[FINISHED], 1)
                t = take_branch(progress, BEGUN_LATER, above)


# The same for small problems: it wakes no other thread.
back_alone = back.serial()
