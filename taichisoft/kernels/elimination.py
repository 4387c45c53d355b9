"""Gaussian elimination with partial pivoting, eight columns at a time (Golub and Van Loan 2013, section 3.4)."""

from taichisoft.kernels.axpy import TILE, Tile, add_multiple
from taichisoft.kernels.runtime import Integers, Scalars, ti


@ti.func
def factorise(count: ti.i32, matrix: Scalars, order: Integers) -> ti.i32:
    """P A = L U in place, the matrix stored by rows; returns 0 where a pivot is zero.

    `order` says which row changed places with each pivot's.
    """
    solvable = 1
    for panel in range((count + TILE - 1) // TILE):
        first = TILE * panel
        last = ti.min(first + TILE, count)
        if solvable != 0:
            solvable = eliminate_panel(first, last, count, matrix, order)
        if solvable != 0 and last < count:
            for k in range(first + 1, last):
                for e in range(first, k):
                    add_multiple(
                        matrix, k * count + last, -matrix[k * count + e], matrix, e * count + last, count - last
                    )
            for i in range(last, count):
                subtract_rows(matrix, i * count, first, count)
    return solvable


@ti.func
def substitute(count: ti.i32, matrix: Scalars, order: Integers, x: Scalars):
    """Solve A x = b in place with the factors."""
    for k in range(count):
        other = x[k]
        x[k] = x[order[k]]
        x[order[k]] = other
    for k in range(count):
        total = x[k]
        for j in range(k):
            total -= matrix[k * count + j] * x[j]
        x[k] = total
    for k_ in range(count):
        k = count - 1 - k_
        total = x[k]
        for j in range(k + 1, count):
            total -= matrix[k * count + j] * x[j]
        x[k] = total / matrix[k * count + k]


@ti.func
def eliminate_panel(first: ti.i32, last: ti.i32, count: ti.i32, matrix: Scalars, order: Integers) -> ti.i32:
    """Choose pivots and eliminate within columns first..last; the factors stay below the diagonal."""
    solvable = 1
    for k in range(first, last):
        pivot = k
        for i in range(k + 1, count):
            if ti.abs(matrix[i * count + k]) > ti.abs(matrix[pivot * count + k]):
                pivot = i
        order[k] = pivot
        if matrix[pivot * count + k] == 0.0:
            solvable = 0
        if solvable != 0:
            if pivot != k:
                for j in range(count):
                    swapped = matrix[k * count + j]
                    matrix[k * count + j] = matrix[pivot * count + j]
                    matrix[pivot * count + j] = swapped
            inverse = 1.0 / matrix[k * count + k]
            for i in range(k + 1, count):
                factor = matrix[i * count + k] * inverse
                matrix[i * count + k] = factor
                if factor != 0.0:
                    for j in range(k + 1, last):
                        matrix[i * count + j] = matrix[i * count + j] - factor * matrix[k * count + j]
    return solvable


@ti.func
def subtract_rows(matrix: Scalars, row: ti.i32, first: ti.i32, count: ti.i32):
    """From the row at `row` subtract the eight rows from `first` on, times the factors in its columns there."""
    factors = Tile(0.0)
    for e in ti.static(range(TILE)):
        factors[e] = matrix[row + first + e]
    last = first + TILE
    tiles = (count - last) // TILE
    for tile in range(tiles):
        column = last + TILE * tile
        total = Tile(0.0)
        for a in ti.static(range(TILE)):
            total[a] = matrix[row + column + a]
        for e in ti.static(range(TILE)):
            source = (first + e) * count + column
            for a in ti.static(range(TILE)):
                total[a] -= factors[e] * matrix[source + a]
        for a in ti.static(range(TILE)):
            matrix[row + column + a] = total[a]
    for j in range(last + TILE * tiles, count):
        rest = matrix[row + j]
        for e in ti.static(range(TILE)):
            rest -= factors[e] * matrix[(first + e) * count + j]
        matrix[row + j] = rest
