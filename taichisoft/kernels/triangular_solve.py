"""Triangular solves with the factor of `kernels/cholesky.py` for one right-hand side."""

from typing import NamedTuple

from taichisoft.kernels.cholesky import BELOW, COLUMNS, FIRST_COLUMN, PANEL, ROWS, WIDTH, Factor, Fronts
from taichisoft.kernels.launch import Kernel, func, kernel
from taichisoft.kernels.runtime import CHUNK, THREADS, Integers, IntegerTable, Scalars, Vectors, ti, vec3
from taichisoft.kernels.tiles import TILE, Column, Columns, advance, opaque, tiles_in

# Columns of the table of trees: a range of supernodes, and where the work space of the tree begins.
FIRST, LAST, WORK = range(3)


class Solution(NamedTuple):
    """A right-hand side that becomes the solution.

    Attributes:
        trees: one row for each tree of supernodes; its columns stand above.
        order: the node at each place of the elimination order, shape (node_count,).
        given, found: right-hand side and solution by nodes, shape (node_count, 3).
        x: their entries in elimination order, shape (3 node_count + 8,).
        below: work space.
    """

    trees: IntegerTable
    order: Integers
    given: Vectors
    found: Vectors
    x: Scalars
    below: Columns


@ti.func
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
def solve_forward(s: ti.i32, fronts: Fronts, factor: Factor, x: Scalars, one: ti.i32):
    """Solve for a front's own entries of L^-1 b and subtract their share from those of its rows below."""
    front, tiles, scalars = ti.static(fronts.table, factor.tiles, factor.scalars)
    width, columns, start, first = front[s, WIDTH], front[s, COLUMNS], front[s, PANEL], front[s, FIRST_COLUMN]
    for b in range(columns // TILE):
        row = opaque(start + b * columns, one)
        d, i = row + TILE * b, first + TILE * b
        v = -multiply_row(tiles, row, TILE * b, x, first, one)
        for c in ti.static(range(TILE)):
            v[c] += x[i + c]
        for c in ti.static(range(TILE)):
            value = v[c] * scalars[TILE * (d + c) + c]
            for a in ti.static(range(c + 1, TILE)):
                v[a] -= scalars[TILE * (d + c) + a] * value
            if TILE * b + c < width:
                x[i + c] = value
    for t in range(tiles_in(front[s, BELOW])):
        v = multiply_row(tiles, opaque(start + (columns // TILE + t) * columns, one), columns, x, first, one)
        for a in ti.static(range(TILE)):
            i = fronts.rows[front[s, ROWS] + TILE * t + a]
            x[i] = x[i] - v[a]


@func
def solve_backward(s: ti.i32, fronts: Fronts, factor: Factor, solution: Solution, work: ti.i32, one: ti.i32):
    """Solve for a front's own entries of L^-T y from those of its rows below."""
    front, tiles, scalars = ti.static(fronts.table, factor.tiles, factor.scalars)
    x, below = ti.static(solution.x, solution.below)
    width, columns, start, first = front[s, WIDTH], front[s, COLUMNS], front[s, PANEL], front[s, FIRST_COLUMN]
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
def places(t: ti.i32, fronts: Fronts, solution: Solution) -> ti.math.ivec2:
    """First and last place of a tree, plus one: its columns stand side by side, three to a node."""
    tree, table = ti.static(solution.trees, fronts.table)
    last = tree[t, LAST] - 1
    return ti.math.ivec2(
        table[tree[t, FIRST], FIRST_COLUMN] // 3, (table[last, FIRST_COLUMN] + table[last, WIDTH]) // 3
    )


@func
def take_in(t: ti.i32, fronts: Fronts, solution: Solution):
    """Put the right-hand side of a tree in elimination order."""
    within = places(t, fronts, solution)
    for place in range(within[0], within[1]):
        given = solution.given[solution.order[place]]
        for d in ti.static(range(3)):
            solution.x[3 * place + d] = given[d]


@func
def hand_out(t: ti.i32, fronts: Fronts, solution: Solution):
    """Give the solution of a tree to its nodes."""
    within = places(t, fronts, solution)
    for place in range(within[0], within[1]):
        solution.found[solution.order[place]] = entries(solution.x, place)


@ti.func
def entries(x: Scalars, place: ti.i32) -> vec3:
    """The three entries of a place in elimination order."""
    return vec3(x[3 * place], x[3 * place + 1], x[3 * place + 2])


def make_solve_trees(workers: int) -> Kernel:
    """The kernel that solves on a number of threads; one does not wake any other."""

    @kernel
    def solve_trees(fronts: Fronts, factor: Factor, solution: Solution, one: ti.i32):
        """Solve L L^T x = b for one right-hand side, trees dealt out to threads."""
        ti.loop_config(serialize=workers == 1)
        for worker in range(workers * CHUNK):
            if worker % CHUNK == 0:
                tree = ti.static(solution.trees)
                t = worker // CHUNK
                while t < tree.shape[0]:
                    take_in(t, fronts, solution)
                    for s in range(tree[t, FIRST], tree[t, LAST]):
                        solve_forward(s, fronts, factor, solution.x, one)
                    for back in range(tree[t, LAST] - tree[t, FIRST]):
                        s = tree[t, LAST] - 1 - back
                        solve_backward(s, fronts, factor, solution, tree[t, WORK], one)
                    hand_out(t, fronts, solution)
                    t += workers

    return solve_trees


solve_trees, solve_trees_serially = make_solve_trees(THREADS), make_solve_trees(1)
