"""Supernodal multifrontal Cholesky factorisation (Liu 1992), in tiles.

A front is a supernode's panel (its columns of the factor, all its rows) and an update matrix (its rows below, lower
triangle) that the parent adds in. The panel is stored by rows of tiles, each with all columns one after the other;
the update matrix likewise, each row up to the diagonal. Columns are padded to whole tiles with an identity matrix and
rows with zeros, so that no tile is special. The diagonal of the factor is stored inverted.

Tasks, and parts of tasks, wait for what they need: `done` counts the finished pieces of each front. A thread takes
tasks in order, and what a task waits for comes before it. Every front is computed from its children in a fixed order,
so the result does not depend on the threads.
"""

from taichisoft.kernels.launch import kernel
from taichisoft.kernels.runtime import CHUNK, Integers, IntegerTable, Matrices, Scalars, ti
from taichisoft.kernels.tiles import SHIFT, TILE, Column, Columns, advance, opaque, tiles_in, triangle


@ti.func
def await_pieces(done: Integers, s: ti.i32, pieces: ti.i32):
    """Wait until that many pieces of a front are finished."""
    while ti.atomic_max(done[s], 0) < pieces:  # a load that the compiler may not move
        pass


@ti.func
def fill_panel(
    s: ti.i32,
    front: IntegerTable,
    block_place: IntegerTable,
    blocks: Matrices,
    tiles: Columns,
    scalars: Scalars,
):
    """Put the matrix's blocks, zeros and the identity of the padding into a panel."""
    width, columns, start = front[s, 0], front[s, 1], front[s, 3]
    for i in range(front[s + 1, 3] - start):
        tiles[start + i] = Column(0.0)
    for k in range(width, columns):
        scalars[TILE * (start + (k >> SHIFT) * columns + k) + (k & TILE - 1)] = 1.0
    for k in range(front[s, 5], front[s + 1, 5]):
        for i in ti.static(range(3)):
            for j in ti.static(range(3)):
                scalars[block_place[k, i] + TILE * j] = blocks[k][i, j]


@ti.func
def add_update(
    c: ti.i32,
    first: ti.i32,
    last: ti.i32,
    s: ti.i32,
    front: IntegerTable,
    relative: Integers,
    tiles: Columns,
    scalars: Scalars,
    one: ti.i32,
):
    """Add a child's update matrix to the columns first..last of its parent's front, all of the panel or none."""
    rest, row_start, columns = front[c, 2], front[c, 7], front[s, 1]
    begin = ti.select(first < columns, 0, front[c, 9])
    while begin < rest and relative[row_start + begin] < first:
        begin += 1
    end = ti.max(begin, front[c, 9])
    while end < rest and relative[row_start + end] < last:
        end += 1
    for t in range(begin >> SHIFT, tiles_in(rest)):
        place = ti.Vector.zero(ti.i32, TILE)  # of the tile's rows in the parent's column 0
        for a in ti.static(range(TILE)):
            row = relative[row_start + TILE * t + a]
            below = ti.max(row - columns, 0)
            place[a] = TILE * (front[s, 3] + (row >> SHIFT) * columns) + (row & TILE - 1)
            if first >= columns:
                place[a] = TILE * (front[s, 4] + triangle(below >> SHIFT) - columns) + (below & TILE - 1)
        source = front[c, 4] + triangle(t)
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


@ti.func
def factorise_tile(d: ti.i32, row: ti.i32, pivots: ti.i32, tiles: Columns, one: ti.i32) -> ti.i32:
    """Finish a tile on the diagonal, at `d`; returns its first column without a positive pivot, or -1."""
    failed = -1
    v = [tiles[d + c] for c in range(TILE)]
    k = 0
    while k < pivots:
        x = tiles[row + k]
        for c in ti.static(range(TILE)):
            v[c] -= x[c] * x
        k = advance(k, 1, one)
    for c in ti.static(range(TILE)):
        for e in ti.static(range(c)):
            v[c] -= v[e][c] * v[e]
        pivot = v[c][c]
        if not pivot > 0.0 and failed < 0:
            failed = c
        inverse = 1.0 / ti.sqrt(pivot)
        v[c] *= inverse
        v[c][c] = inverse
    for c in ti.static(range(TILE)):
        tiles[d + c] = v[c]
    return failed


@ti.func
def solve_tile(x: ti.i32, row: ti.i32, y: ti.i32, pivots: ti.i32, tiles: Columns, scalars: Scalars, one: ti.i32):
    """Finish a tile left of the diagonal: subtract products of tile rows `row` and `y`, divide by the diagonal's."""
    d = y + pivots
    v = [tiles[x + c] for c in range(TILE)]
    k = 0
    while k < pivots:
        a, b = tiles[row + k], tiles[y + k]
        for c in ti.static(range(TILE)):
            v[c] -= b[c] * a
        k = advance(k, 1, one)
    for c in ti.static(range(TILE)):
        for e in ti.static(range(c)):
            v[c] -= scalars[TILE * (d + e) + c] * v[e]
        v[c] *= scalars[TILE * (d + c) + c]
    for c in ti.static(range(TILE)):
        tiles[x + c] = v[c]


@ti.func
def multiply_tile(x: ti.i32, row: ti.i32, y: ti.i32, pivots: ti.i32, tiles: Columns, one: ti.i32):
    """A tile of the update matrix: minus the product of the tile row at `row` and the transpose of that at `y`."""
    v = [Column(0.0) for _ in range(TILE)]
    k = 0
    while k < pivots:
        a, b = tiles[row + k], tiles[y + k]
        for c in ti.static(range(TILE)):
            v[c] -= b[c] * a
        k = advance(k, 1, one)
    for c in ti.static(range(TILE)):
        tiles[x + c] = v[c]


@ti.func
def eliminate_rows(
    s: ti.i32, first: ti.i32, last: ti.i32, front: IntegerTable, tiles: Columns, scalars: Scalars, one: ti.i32
) -> ti.i32:
    """Finish rows of tiles of a panel, those above being finished; returns its first bad pivot's column, or -1."""
    columns, start = front[s, 1], front[s, 3]
    failed = -1
    for b in range(columns >> SHIFT):
        y = opaque(start + b * columns, one)
        if first <= b and b < last:
            failed_in_tile = factorise_tile(y + TILE * b, y, TILE * b, tiles, one)
            if failed_in_tile >= 0 and failed < 0:
                failed = TILE * b + failed_in_tile
        for t in range(ti.max(first, b + 1), last):  # neighbours in a column do not wait for each other
            row = opaque(start + t * columns, one)
            solve_tile(row + TILE * b, row, y, TILE * b, tiles, scalars, one)
    return failed


@ti.func
def multiply_columns(s: ti.i32, first: ti.i32, last: ti.i32, front: IntegerTable, tiles: Columns, one: ti.i32):
    """Set columns of tiles of an update matrix to minus the product of the panel with its transpose."""
    columns = front[s, 1]
    start = front[s, 3] + (columns >> SHIFT) * columns
    for b in range(first, last):
        y = opaque(start + b * columns, one)
        for t in range(b, tiles_in(front[s, 2])):
            x = opaque(front[s, 4] + triangle(t) + TILE * b, one)
            multiply_tile(x, opaque(start + t * columns, one), y, front[s, 0], tiles, one)


@ti.func
def work_on(
    t: ti.i32,
    s: ti.i32,
    task: IntegerTable,
    front: IntegerTable,
    pieces: Integers,
    block_place: IntegerTable,
    blocks: Matrices,
    child: Integers,
    relative: Integers,
    tiles: Columns,
    scalars: Scalars,
    done: Integers,
    failed_column: Integers,
    one: ti.i32,
):
    """Do what a task asks for on one of its fronts."""
    columns = front[s, 1]
    await_pieces(done, s, task[t, 2])
    first_row, last_row = task[t, 3], ti.min(task[t, 4], (columns >> SHIFT) + tiles_in(front[s, 2]))
    first_tile, last_tile = task[t, 5], ti.min(task[t, 6], tiles_in(front[s, 2]))
    assembles = first_row == 0 and last_row > 0
    for part in range(2):  # the panel's columns, then those of the update matrix
        first = ti.select(part == 0, 0, columns + TILE * first_tile)
        last = ti.select(part == 0, ti.select(assembles, columns, 0), columns + TILE * last_tile)
        if part == 0 and assembles:
            fill_panel(s, front, block_place, blocks, tiles, scalars)
        if part == 1:
            failed = eliminate_rows(s, first_row, last_row, front, tiles, scalars, one)
            if failed >= 0:
                ti.atomic_min(failed_column[0], front[s, 8] + failed)
            multiply_columns(s, first_tile, last_tile, front, tiles, one)
        if first < last:
            for k in range(front[s, 6], front[s + 1, 6]):
                await_pieces(done, child[k], pieces[child[k]])
                add_update(child[k], first, last, s, front, relative, tiles, scalars, one)
    ti.atomic_add(done[s], 1)


@kernel
def factorise(
    task: IntegerTable,
    front: IntegerTable,
    pieces: Integers,
    block_place: IntegerTable,
    blocks: Matrices,
    child: Integers,
    relative: Integers,
    tiles: Columns,
    scalars: Scalars,
    done: Integers,
    failed_column: Integers,
    next_task: Integers,
    workers: ti.i32,
    one: ti.i32,
):
    """Factorise all fronts; `failed_column[0]` is lowered to the first column without a positive pivot.

    Each worker, a thread, takes the next task until none is left.
    """
    for worker in range(workers * CHUNK):
        if worker % CHUNK == 0:
            t = ti.atomic_add(next_task[0], 1)
            while t < task.shape[0]:
                for s in range(task[t, 0], task[t, 1]):
                    work_on(
                        t,
                        s,
                        task,
                        front,
                        pieces,
                        block_place,
                        blocks,
                        child,
                        relative,
                        tiles,
                        scalars,
                        done,
                        failed_column,
                        one,
                    )
                t = ti.atomic_add(next_task[0], 1)
