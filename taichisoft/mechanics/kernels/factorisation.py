"""Supernodal multifrontal Cholesky factorisation (Liu 1992), in tiles.

A front is a supernode's panel (its columns of the factor, all its rows) and an update matrix (its rows below, lower
triangle) that the parent adds in. The panel is stored by rows of tiles, each with all columns one after the other;
the update matrix likewise, each row up to the diagonal. Columns are padded to whole tiles with an identity matrix and
rows with zeros, so that no tile is special. The diagonal of the factor is stored inverted. A right-hand side is
substituted forward in passing, as if it were one more row of the matrix.

A thread takes the first task of the list for which all is there: `done` counts the finished pieces of each front. Every
front is computed from its children in a fixed order, so the result does not depend on the threads. A thread that finds
nothing to do for longer than any task takes leaves the rest to the others: one of them has lost its core to another
program, and gets it back the sooner.

Half a tile is computed at a time: its columns and a factor take 10 of the 16 vector registers of a processor with
AVX2, and a whole tile more than there are. Columns that others of the same half need are read back from memory, by an
index that the compiler cannot see through: so it keeps each of them a vector.
"""

from taichisoft.mechanics.kernels.sparse_columns import (
    AWAITED,
    BELOW,
    BLOCKS,
    CHILDREN,
    COLUMNS,
    FIRST_COLUMN,
    FIRST_FRONT,
    FIRST_ROW,
    FIRST_UPDATE,
    IN_PARENT,
    LAST_FRONT,
    LAST_ROW,
    LAST_UPDATE,
    PANEL,
    ROWS,
    UPDATE,
    WIDTH,
    Factor,
    Fronts,
)
from taichisoft.mechanics.kernels.substitution import Substitution, gather, substitute_forward
from taichisoft.runtime.arithmetic import HALF, SHIFT, TILE, Column, advance, load, opaque, tiles_in, triangle
from taichisoft.runtime.language import CHUNK, Matrices, func, ti
from taichisoft.runtime.launch import kernel


@func
def is_ready(t: ti.i32, fronts: Fronts, factor: Factor) -> ti.i32:
    """Whether all is finished that a task needs; one of several fronts is a whole subtree and needs nothing."""
    task, children = ti.static(fronts.tasks, fronts.children)
    ready, s = 1, task[t, FIRST_FRONT]
    if task[t, LAST_FRONT] == s + 1:
        if load(factor.done, s) < task[t, AWAITED]:
            ready = 0
        for k in range(fronts.table[s, CHILDREN], fronts.table[s + 1, CHILDREN]):
            if load(factor.done, children[k]) < fronts.pieces[children[k]]:
                ready = 0
    return ready


@func
def fill_panel(s: ti.i32, fronts: Fronts, blocks: Matrices, factor: Factor):
    """Put the matrix's blocks, zeros and the identity of the padding into a panel."""
    front, scalars = ti.static(fronts.table, factor.scalars)
    width, columns, start = front[s, WIDTH], front[s, COLUMNS], front[s, PANEL]
    for i in range(front[s + 1, PANEL] - start):
        factor.tiles[start + i] = Column(0.0)
    for k in range(width, columns):
        scalars[TILE * (start + (k >> SHIFT) * columns + k) + (k & TILE - 1)] = 1.0
    for k in range(front[s, BLOCKS], front[s + 1, BLOCKS]):
        for i in ti.static(range(3)):
            for j in ti.static(range(3)):
                scalars[fronts.block_place[k, i] + TILE * j] = blocks[k][i, j]


@func
def add_update(c: ti.i32, first: ti.i32, last: ti.i32, s: ti.i32, fronts: Fronts, factor: Factor, one: ti.i32):
    """Add a child's update matrix to the columns first..last of its parent's front, all of the panel or none."""
    front, relative, tiles, scalars = ti.static(fronts.table, fronts.relative, factor.tiles, factor.scalars)
    rest, row_start, columns = front[c, BELOW], front[c, ROWS], front[s, COLUMNS]
    begin = ti.select(first < columns, 0, front[c, IN_PARENT])
    while begin < rest and relative[row_start + begin] < first:
        begin += 1
    end = ti.max(begin, front[c, IN_PARENT])
    while end < rest and relative[row_start + end] < last:
        end += 1
    for t in range(begin >> SHIFT, tiles_in(rest)):
        place = ti.Vector.zero(ti.i32, TILE)  # of the tile's rows in the parent's column 0
        for a in ti.static(range(TILE)):
            row = relative[row_start + TILE * t + a]
            below = ti.max(row - columns, 0)
            place[a] = TILE * (front[s, PANEL] + (row >> SHIFT) * columns) + (row & TILE - 1)
            if first >= columns:
                place[a] = TILE * (front[s, UPDATE] + triangle(below >> SHIFT) - columns) + (below & TILE - 1)
        source = front[c, UPDATE] + triangle(t)
        j = begin
        while j < ti.min(end, TILE * t):
            column = TILE * relative[row_start + j]
            values = tiles[source + j]
            for a in ti.static(range(TILE)):
                scalars[place[a] + column] = scalars[place[a] + column] + values[a]
            j = advance(j, 1, one)
        for b in ti.static(range(TILE)):
            k = TILE * t + b
            if begin <= k and k < end:
                column = TILE * relative[row_start + k]
                values = tiles[source + k]
                for a in ti.static(range(b, TILE)):
                    scalars[place[a] + column] = scalars[place[a] + column] + values[a]


@func
def subtract_products(
    v: ti.template(), first: ti.i32, row: ti.i32, y: ti.i32, count: ti.i32, factor: Factor, one: ti.i32
):
    """Subtract from half a tile, from column `first` on, the products of the first columns of two tile rows."""
    tiles, scalars = ti.static(factor.tiles, factor.scalars)
    k = 0
    while k < count:
        a = tiles[row + k]
        for c in ti.static(range(HALF)):
            v[c] -= scalars[TILE * (y + k) + first + c] * a
        k = advance(k, 1, one)


@func
def factorise_tile(d: ti.i32, row: ti.i32, pivots: ti.i32, factor: Factor, one: ti.i32) -> ti.i32:
    """Finish a tile on the diagonal, at `d`; returns its first column without a positive pivot, or -1."""
    tiles, scalars = ti.static(factor.tiles, factor.scalars)
    failed, first = -1, 0
    while first < TILE:
        x = opaque(d + first, one)
        v = [tiles[x + c] for c in range(HALF)]
        subtract_products(v, first, row, row, pivots + first, factor, one)
        finished = opaque(x, one)
        for c in ti.static(range(HALF)):
            for e in ti.static(range(c)):
                v[c] -= scalars[TILE * (finished + e) + first + c] * tiles[finished + e]
            tiles[x + c] = v[c]
            pivot = scalars[TILE * (finished + c) + first + c]
            if not pivot > 0.0 and failed < 0:
                failed = first + c
            inverse = 1.0 / ti.sqrt(pivot)
            tiles[x + c] = v[c] * inverse
            scalars[TILE * (finished + c) + first + c] = inverse
        first = advance(first, HALF, one)
    return failed


@func
def solve_tile(start: ti.i32, row: ti.i32, y: ti.i32, pivots: ti.i32, factor: Factor, one: ti.i32):
    """Finish a tile left of the diagonal: subtract products of tile rows `row` and `y`, divide by the diagonal's."""
    tiles, scalars = ti.static(factor.tiles, factor.scalars)
    first = 0
    while first < TILE:
        d, x = y + pivots + first, opaque(start + first, one)
        v = [tiles[x + c] for c in range(HALF)]
        subtract_products(v, first, row, y, pivots + first, factor, one)
        finished = opaque(x, one)
        for c in ti.static(range(HALF)):
            for e in ti.static(range(c)):
                v[c] -= scalars[TILE * (d + e) + first + c] * tiles[finished + e]
            tiles[x + c] = v[c] * scalars[TILE * (d + c) + first + c]
        first = advance(first, HALF, one)


@func
def multiply_tile(start: ti.i32, row: ti.i32, y: ti.i32, pivots: ti.i32, factor: Factor, one: ti.i32):
    """A tile of the update matrix: minus the product of the tile row at `row` and the transpose of that at `y`."""
    first = 0
    while first < TILE:
        x = opaque(start + first, one)
        v = [Column(0.0) for _ in range(HALF)]
        subtract_products(v, first, row, y, pivots, factor, one)
        for c in ti.static(range(HALF)):
            factor.tiles[x + c] = v[c]
        first = advance(first, HALF, one)


@func
def eliminate_rows(s: ti.i32, first: ti.i32, last: ti.i32, fronts: Fronts, factor: Factor, one: ti.i32) -> ti.i32:
    """Finish rows of tiles of a panel, those above being finished; returns its first bad pivot's column, or -1."""
    columns, start = fronts.table[s, COLUMNS], fronts.table[s, PANEL]
    failed = -1
    for b in range(columns >> SHIFT):
        y = opaque(start + b * columns, one)
        if first <= b and b < last:
            failed_in_tile = factorise_tile(y + TILE * b, y, TILE * b, factor, one)
            if failed_in_tile >= 0 and failed < 0:
                failed = TILE * b + failed_in_tile
        for t in range(ti.max(first, b + 1), last):  # neighbours in a column do not wait for each other
            row = opaque(start + t * columns, one)
            solve_tile(row + TILE * b, row, y, TILE * b, factor, one)
    return failed


@func
def multiply_columns(s: ti.i32, first: ti.i32, last: ti.i32, fronts: Fronts, factor: Factor, one: ti.i32):
    """Set columns of tiles of an update matrix to minus the product of the panel with its transpose."""
    front = ti.static(fronts.table)
    columns = front[s, COLUMNS]
    start = front[s, PANEL] + (columns >> SHIFT) * columns
    for b in range(first, last):
        y = opaque(start + b * columns, one)
        for t in range(b, tiles_in(front[s, BELOW])):
            x = opaque(front[s, UPDATE] + triangle(t) + TILE * b, one)
            multiply_tile(x, opaque(start + t * columns, one), y, front[s, WIDTH], factor, one)


@func
def work_on(
    t: ti.i32, s: ti.i32, fronts: Fronts, blocks: Matrices, factor: Factor, solution: Substitution, one: ti.i32
):
    """Do what a task says to one of its fronts."""
    front, task = ti.static(fronts.table, fronts.tasks)
    columns = front[s, COLUMNS]
    first_row = task[t, FIRST_ROW]
    last_row = ti.min(task[t, LAST_ROW], (columns >> SHIFT) + tiles_in(front[s, BELOW]))
    first_tile, last_tile = task[t, FIRST_UPDATE], ti.min(task[t, LAST_UPDATE], tiles_in(front[s, BELOW]))
    assembles = first_row == 0 and last_row > 0
    for part in range(2):  # the panel's columns, then the update matrix's columns
        first = ti.select(part == 0, 0, columns + TILE * first_tile)
        last = ti.select(part == 0, ti.select(assembles, columns, 0), columns + TILE * last_tile)
        if part == 0 and assembles:
            fill_panel(s, fronts, blocks, factor)
            gather(s, fronts, solution)
        if part == 1:
            failed = eliminate_rows(s, first_row, last_row, fronts, factor, one)
            if failed >= 0:
                ti.atomic_min(factor.failed_column[0], front[s, FIRST_COLUMN] + failed)
            substitute_forward(s, first_row, last_row, fronts, factor, solution, one)  # while the cache has the rows
            multiply_columns(s, first_tile, last_tile, fronts, factor, one)
        if first < last:
            for k in range(front[s, CHILDREN], front[s + 1, CHILDREN]):
                child = fronts.children[k]
                add_update(child, first, last, s, fronts, factor, one)
    ti.atomic_add(factor.done[s], 1)


@kernel
def factorise(fronts: Fronts, blocks: Matrices, factor: Factor, solution: Substitution, workers: ti.i32, one: ti.i32):
    """Factorise all fronts, and fill `solution.forward`, which is 0 at the start.

    Each worker, a thread, takes tasks until none is left, or it has lost patience.
    """
    for worker in range(workers * CHUNK):
        if worker % CHUNK == 0:
            first, t, looks, leaves = 0, 0, 0, 0
            while first < fronts.tasks.shape[0] and leaves == 0:
                looks += 1
                takes = 0
                if load(factor.taken, t) != 0:
                    first += ti.select(t == first, 1, 0)
                else:
                    takes = is_ready(t, fronts, factor)
                if takes != 0:
                    takes = 1 - ti.atomic_max(factor.taken[t], 1)
                t += 1
                if takes != 0:
                    for s in range(fronts.tasks[t - 1, FIRST_FRONT], fronts.tasks[t - 1, LAST_FRONT]):
                        work_on(t - 1, s, fronts, blocks, factor, solution, one)
                    t, looks = first, 0
                elif t == fronts.tasks.shape[0]:  # having seen the whole list: alone, it finds something in it
                    t, leaves = first, ti.select(looks < fronts.patience[0], 0, 1)


# The same for small problems: it wakes no other thread.
factorise_alone = factorise.serial()
