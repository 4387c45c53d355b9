"""Supernodal multifrontal Cholesky factorisation and its triangular solves (Liu 1992).

A front is a supernode's panel (its columns of the factor, all its rows, stored by columns) and an update matrix
(its rows below, lower triangle, stored by columns) that the parent adds in. Sizes count nodes; a node is three
scalar rows. Every front is computed by one task from its children in a fixed order, so that the result does not
depend on how tasks are shared out.
"""

from taichisoft.kernels.launch import kernel
from taichisoft.kernels.runtime import CHUNK, Integers, IntegerTable, Matrices, Scalars, ti


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
def factorise_front(s: ti.i32, front: IntegerTable, panel: Scalars, update: Scalars) -> ti.i32:
    """Eliminate a front's own columns; returns the local column of a pivot that is not positive, or -1."""
    width, height = 3 * front[s, 0], 3 * front[s, 1]
    rest = height - width
    p, u = front[s, 2], front[s, 3]
    failed = -1
    for node in range(front[s, 0]):
        k = 3 * node
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
        c0, c1, c2 = p + k * height, p + (k + 1) * height, p + (k + 2) * height
        for j in range(k + 3, width):
            f0, f1, f2 = panel[c0 + j], panel[c1 + j], panel[c2 + j]
            target = p + j * height
            for i in range(j, height):
                panel[target + i] = panel[target + i] - (panel[c0 + i] * f0 + panel[c1 + i] * f1 + panel[c2 + i] * f2)
    for group in range(rest // 3):
        j = 3 * group
        t0, t1, t2 = u + j * rest, u + (j + 1) * rest, u + (j + 2) * rest
        for node in range(front[s, 0]):
            k = 3 * node
            c0 = p + k * height + width
            c1 = c0 + height
            c2 = c1 + height
            a0, a1, a2 = panel[c0 + j], panel[c1 + j], panel[c2 + j]
            b0, b1, b2 = panel[c0 + j + 1], panel[c1 + j + 1], panel[c2 + j + 1]
            d0, d1, d2 = panel[c0 + j + 2], panel[c1 + j + 2], panel[c2 + j + 2]
            for i in range(j, rest):
                x0, x1, x2 = panel[c0 + i], panel[c1 + i], panel[c2 + i]
                update[t0 + i] = update[t0 + i] - (x0 * a0 + x1 * a1 + x2 * a2)
                update[t1 + i] = update[t1 + i] - (x0 * b0 + x1 * b1 + x2 * b2)
                update[t2 + i] = update[t2 + i] - (x0 * d0 + x1 * d1 + x2 * d2)
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
