"""Gaussian elimination with partial pivoting, in panels of eight columns and blocks of 32.

Golub and Van Loan 2013, section 3.4. Nearly all of the work is in `subtract_block`, whose tiles of 8 x 8 stay in
registers while it reads the eliminated block; see `tiles.py`, also for `one`.
"""

from typing import NamedTuple

import numpy as np

from taichisoft.runtime.language import Integers, Scalars, func, ti
from taichisoft.runtime.tiles import TILE, Columns, advance, opaque, tiles_in

BLOCK = 32


class LinearSystem(NamedTuple):
    """Linear equations for some rows of a larger problem; the factors overwrite the matrix.

    Attributes:
        row_of: row of the problem for each equation, shape (row_capacity,).
        matrix: by rows, each padded to whole tiles, `row_length` numbers long, shape (row_capacity row_length,).
        tiles: the same memory by eights, shape (row_capacity row_length / 8, 8).
        order: row exchanged with the row of each pivot, shape (row_capacity,).
        step: right-hand side, then the solution, shape (row_capacity,).
    """

    row_of: Integers
    matrix: Scalars
    tiles: Columns
    order: Integers
    step: Scalars


@func
def row_length(count: ti.i32) -> ti.i32:
    """Distance between rows of the matrix in memory, in numbers."""
    return TILE * tiles_in(count)


@func
def factorise(count: ti.i32, system: LinearSystem, one: ti.i32) -> ti.i32:
    """Factorise P A = L U in place; returns 0 if a pivot is zero."""
    solvable = 1
    for block in range((count + BLOCK - 1) // BLOCK):
        start = BLOCK * block
        end = ti.min(start + BLOCK, count)
        for panel in range(tiles_in(end - start)):
            first = start + TILE * panel
            last = ti.min(first + TILE, end)
            if solvable != 0:
                solvable = eliminate_panel(first, last, count, system, one)
            if solvable != 0 and last < end:
                solve_upper(first, last, tiles_in(last), tiles_in(end), count, system, one)
                for i in range(last, count):
                    subtract_panel(i, first, tiles_in(end), count, system)
        if solvable != 0 and end < count:
            solve_upper(start, end, tiles_in(end), tiles_in(count), count, system, one)
            subtract_block(start, end, count, system, one)
    return solvable


@func
def solve_upper(
    first: ti.i32, last: ti.i32, tile: ti.i32, end: ti.i32, count: ti.i32, system: LinearSystem, one: ti.i32
):
    """Compute rows first..last of U in the columns of tiles tile..end."""
    row = tiles_in(count)
    for k in range(first + 1, last):
        for e in range(first, k):
            factor = system.matrix[k * TILE * row + e]
            t = tile
            while t < end:
                system.tiles[k * row + t] = system.tiles[k * row + t] - factor * system.tiles[e * row + t]
                t = advance(t, 1, one)


@func
def substitute(count: ti.i32, system: LinearSystem):
    """Solve A x = b in place with the factors."""
    matrix, order, x = ti.static(system.matrix, system.order, system.step)
    row = row_length(count)
    for k in range(count):
        other = x[k]
        x[k] = x[order[k]]
        x[order[k]] = other
    for k in range(count):
        total = x[k]
        for j in range(k):
            total -= matrix[k * row + j] * x[j]
        x[k] = total
    for k_ in range(count):
        k = count - 1 - k_
        total = x[k]
        for j in range(k + 1, count):
            total -= matrix[k * row + j] * x[j]
        x[k] = total / matrix[k * row + k]


@func
def eliminate_panel(first: ti.i32, last: ti.i32, count: ti.i32, system: LinearSystem, one: ti.i32) -> ti.i32:
    """Choose pivots and eliminate within columns first..last; the factors stay below the diagonal."""
    matrix, tiles = ti.static(system.matrix, system.tiles)
    row = row_length(count)
    solvable = 1
    for k in range(first, last):
        pivot = k
        for i in range(k + 1, count):
            if ti.abs(matrix[i * row + k]) > ti.abs(matrix[pivot * row + k]):
                pivot = i
        system.order[k] = pivot
        if matrix[pivot * row + k] == 0.0:
            solvable = 0
        if solvable != 0:
            if pivot != k:
                t = 0
                while t < tiles_in(count):
                    swapped = tiles[k * tiles_in(count) + t]
                    tiles[k * tiles_in(count) + t] = tiles[pivot * tiles_in(count) + t]
                    tiles[pivot * tiles_in(count) + t] = swapped
                    t = advance(t, 1, one)
            inverse = 1.0 / matrix[k * row + k]
            for i in range(k + 1, count):
                factor = matrix[i * row + k] * inverse
                matrix[i * row + k] = factor
                if factor != 0.0:
                    for left in range(last - 1 - k & TILE - 1):  # fewer than eight, as LLVM can see
                        j = last - 1 - left
                        matrix[i * row + j] = matrix[i * row + j] - factor * matrix[k * row + j]
    return solvable


@func
def subtract_panel(i: ti.i32, first: ti.i32, end: ti.i32, count: ti.i32, system: LinearSystem):
    """Subtract the eight rows from `first` on, times their factors in row i, from row i up to tile `end`."""
    row = tiles_in(count)
    place = i * TILE * row + first
    for t in range(first // TILE + 1, end):
        total = system.tiles[i * row + t]
        for e in ti.static(range(TILE)):
            total -= system.matrix[place + e] * system.tiles[(first + e) * row + t]
        system.tiles[i * row + t] = total


@func
def subtract_block(start: ti.i32, end: ti.i32, count: ti.i32, system: LinearSystem, one: ti.i32):
    """Subtract the product of the block's factors and its rows of U from the rows and columns after `end`."""
    matrix, tiles = ti.static(system.matrix, system.tiles)
    row = tiles_in(count)
    strips = (count - end) // TILE
    for strip in range(strips):
        for t in range(end // TILE, row):
            target = opaque((end + TILE * strip) * row, one)
            total = [tiles[target + r * row + t] for r in range(TILE)]
            e = start
            while e < end:
                above = tiles[e * row + t]
                for r in ti.static(range(TILE)):
                    total[r] -= matrix[TILE * (target + r * row) + e] * above
                e = advance(e, 1, one)
            for r in ti.static(range(TILE)):
                tiles[target + r * row + t] = total[r]
    for i in range(end + TILE * strips, count):
        for t in range(end // TILE, row):
            rest = tiles[i * row + t]
            for e in range(start, end):
                rest -= matrix[i * TILE * row + e] * tiles[e * row + t]
            tiles[i * row + t] = rest


def make_linear_system(capacity: int) -> LinearSystem:
    """Allocate a system of up to `capacity` rows; the padding of the matrix is 0."""
    tiles = np.zeros((capacity * -(-capacity // TILE), TILE))
    rows, order = np.empty(capacity, dtype=np.int32), np.empty(capacity, dtype=np.int32)
    return LinearSystem(rows, tiles.reshape(-1), tiles, order, np.empty(capacity))
