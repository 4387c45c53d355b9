"""L^-T (L^-1 b + Y lambda): the solution with a right-hand side b + J^T lambda.

Of the rows J^T there is Y = L^-1 J^T from their compliance, and of b what the forward substitution has left, so that
impulses in the rows cost no further solve. One thread begins with the supernodes above all branches, then threads take
the branches in turn.
"""

from taichisoft.cholesky.kernels.forward_substitution import Substitution, take_branch
from taichisoft.cholesky.kernels.front_layout import BELOW, COLUMNS, FIRST_COLUMN, PANEL, ROWS, WIDTH, Factor, Fronts
from taichisoft.cholesky.kernels.sparse_columns import GROUP, NOWHERE, SparseColumns
from taichisoft.runtime.language import CHUNK, Scalars, func, ti, vec3
from taichisoft.runtime.launch import kernel
from taichisoft.runtime.tiles import TILE, Column, advance, opaque, tiles_in
from taichisoft.runtime.waiting import BEGUN, BEGUN_LATER, FINISHED, reaches


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
