"""Supernodal multifrontal Cholesky factorisation and its triangular solves (Liu 1992).

A front is a supernode's panel (its columns of the factor, all its rows, stored by columns) and an update matrix
(its rows below, lower triangle, stored by columns) that the parent adds in. Sizes count nodes; a node is three
scalar rows. Every front is computed by one task from its children in a fixed order, so that the result does not
depend on how tasks are shared out.
"""

from taichisoft.kernels.launch import kernel
from taichisoft.kernels.runtime import CHUNK, Integers, IntegerTable, Matrices, Scalars, ti

# Rows of a tile of the dense products; a panel array ends with as many entries that are read but never used.
TILE = 8
Tile = ti.types.vector(TILE, ti.f64)


@ti.func
def assemble_front(
    s: ti.i32,
    front: IntegerTable,
    block_row: Integers,
    block_column: Integers,
    blocks: Matrices,
    child: Integers,
    relative: Integers,
    panel: Scalars,
    update: Scalars,
):
    """Fill a front from the matrix's blocks and the update matrices of its children."""
    width, height = 3 * front[s, 0], 3 * front[s, 1]
    rest = height - width
    p, u = front[s, 2], front[s, 3]
    for i in range(height * width):
        panel[p + i] = 0.0
    for i in range(rest * rest):
        update[u + i] = 0.0
    for k in range(front[s, 4], front[s + 1, 4]):
        row, column = 3 * block_row[k], 3 * block_column[k]
        for i, j in ti.static(ti.ndrange(3, 3)):
            panel[p + (column + j) * height + row + i] = blocks[k][i, j]
    for k in range(front[s, 5], front[s + 1, 5]):
        c = child[k]
        child_rest = front[c, 1] - front[c, 0]
        first = front[c, 6] + front[c, 0]
        for j in range(child_rest):
            column = 3 * relative[first + j]
            for i in range(j, child_rest):
                row = 3 * relative[first + i]
                for b in ti.static(range(3)):
                    source = front[c, 3] + (3 * j + b) * 3 * child_rest + 3 * i
                    target = p + (column + b) * height + row
                    if column >= width:
                        target = u + (column + b - width) * rest + row - width
                        for a in ti.static(range(3)):
                            update[target + a] = update[target + a] + update[source + a]
                    else:
                        for a in ti.static(range(3)):
                            panel[target + a] = panel[target + a] + update[source + a]


@ti.func
def subtract_products(
    panel: Scalars,
    p: ti.i32,
    height: ti.i32,
    pivots: ti.i32,
    row: ti.i32,
    target: Scalars,
    t: ti.i32,
    stride: ti.i32,
):
    """Subtract the panel's first `pivots` columns times their rows row..row+2 from three columns of the target.

    Rows run from `row` to the panel's last; target column c has row r at t + c * stride + r. A tile of eight rows
    and three columns stays in registers over all pivots; the last tile computes rows that it does not store.
    """
    for tile in range((height - row + TILE - 1) // TILE):
        r = row + tile * TILE
        s0, s1, s2 = Tile(0.0), Tile(0.0), Tile(0.0)
        for k in range(pivots):
            column = p + k * height
            x = Tile(0.0)
            for a in ti.static(range(TILE)):
                x[a] = panel[column + r + a]
            s0 += panel[column + row] * x
            s1 += panel[column + row + 1] * x
            s2 += panel[column + row + 2] * x
        if r + TILE <= height:
            for a in ti.static(range(TILE)):
                target[t + r + a] = target[t + r + a] - s0[a]
            for a in ti.static(range(TILE)):
                target[t + stride + r + a] = target[t + stride + r + a] - s1[a]
            for a in ti.static(range(TILE)):
                target[t + 2 * stride + r + a] = target[t + 2 * stride + r + a] - s2[a]
        else:
            for a in ti.static(range(TILE)):
                if r + a < height:
                    target[t + r + a] = target[t + r + a] - s0[a]
                    target[t + stride + r + a] = target[t + stride + r + a] - s1[a]
                    target[t + 2 * stride + r + a] = target[t + 2 * stride + r + a] - s2[a]


@ti.func
def factorise_front(s: ti.i32, front: IntegerTable, panel: Scalars, update: Scalars) -> ti.i32:
    """Eliminate a front's own columns; returns the local column of a pivot that is not positive, or -1."""
    width, height = 3 * front[s, 0], 3 * front[s, 1]
    rest = height - width
    p, u = front[s, 2], front[s, 3]
    failed = -1
    for node in range(front[s, 0]):
        k = 3 * node
        subtract_products(panel, p, height, k, k, panel, p + k * height, height)
        for a in ti.static(range(3)):
            column = p + (k + a) * height
            pivot = panel[column + k + a]
            if not pivot > 0.0 and failed < 0:
                failed = k + a
            inverse = 1.0 / ti.sqrt(pivot)
            for i in range(k + a, height):
                panel[column + i] = panel[column + i] * inverse
            for b in ti.static(range(a + 1, 3)):
                factor = panel[column + k + b]
                target = p + (k + b) * height
                for i in range(k + b, height):
                    panel[target + i] = panel[target + i] - panel[column + i] * factor
    for group in range(rest // 3):
        j = 3 * group
        subtract_products(panel, p, height, width, width + j, update, u + j * rest - width, rest)
    return failed


@kernel
def factorise_tasks(
    task: IntegerTable,
    stage: ti.i32,
    stage_of: Integers,
    front: IntegerTable,
    block_row: Integers,
    block_column: Integers,
    blocks: Matrices,
    child: Integers,
    relative: Integers,
    panel: Scalars,
    update: Scalars,
    failed_column: Integers,
):
    """Factorise the supernodes of one stage, each task a range of supernodes of one subtree."""
    for t_ in range(task.shape[0] * CHUNK):
        if t_ % CHUNK == 0:
            t = t_ // CHUNK
            failed_column[t] = -1
            for s in range(task[t, 0], task[t, 1]):
                if stage_of[s] == stage:
                    assemble_front(s, front, block_row, block_column, blocks, child, relative, panel, update)
                    failed = factorise_front(s, front, panel, update)
                    if failed >= 0 and failed_column[t] < 0:
                        failed_column[t] = 3 * front[s, 7] + failed


@kernel
def solve_trees(
    tree: IntegerTable,
    front: IntegerTable,
    rows: Integers,
    panel: Scalars,
    x: Scalars,
    work: Scalars,
):
    """Solve L L^T x = b in place for one right-hand side in elimination order, one task per tree."""
    for t_ in range(tree.shape[0] * CHUNK):
        if t_ % CHUNK == 0:
            t = t_ // CHUNK
            w = 3 * tree[t, 2]  # this tree's part of the work space
            for s in range(tree[t, 0], tree[t, 1]):
                width, height, p, first = 3 * front[s, 0], 3 * front[s, 1], front[s, 2], 3 * front[s, 7]
                for i in range(width, height):
                    work[w + i] = 0.0
                for k in range(width):
                    column = p + k * height
                    value = x[first + k] / panel[column + k]
                    x[first + k] = value
                    for i in range(k + 1, width):
                        x[first + i] = x[first + i] - panel[column + i] * value
                    for i in range(width, height):
                        work[w + i] = work[w + i] + panel[column + i] * value
                for i in range(front[s, 0], front[s, 1]):
                    row = 3 * rows[front[s, 6] + i]
                    for a in ti.static(range(3)):
                        x[row + a] = x[row + a] - work[w + 3 * i + a]
            for s_ in range(tree[t, 1] - tree[t, 0]):
                s = tree[t, 1] - 1 - s_
                width, height, p, first = 3 * front[s, 0], 3 * front[s, 1], front[s, 2], 3 * front[s, 7]
                for i in range(front[s, 0], front[s, 1]):
                    row = 3 * rows[front[s, 6] + i]
                    for a in ti.static(range(3)):
                        work[w + 3 * i + a] = x[row + a]
                for k_ in range(width):
                    k = width - 1 - k_
                    column = p + k * height
                    value = x[first + k]
                    for i in range(k + 1, width):
                        value -= panel[column + i] * x[first + i]
                    for i in range(width, height):
                        value -= panel[column + i] * work[w + i]
                    x[first + k] = value / panel[column + k]
