"""y = y + a x for vectors within arrays, by tiles of eight numbers.

A plain loop over Taichi's arrays is not vectorised: LLVM must assume that a store changes the pointers that it loads.
Here a tile is computed in registers before any of it is stored.

LLVM unrolls a loop with a countable number of turns up to eight times. For tiles and the few remaining numbers this
only costs time, in compilation and in code generation at every start. So the loops are written such that LLVM sees
fewer than eight remaining numbers and cannot count the tiles (`next_tile`).
"""

from taichisoft.runtime.language import Scalars, func, ti

TILE = 8
Tile = ti.types.vector(TILE, ti.f64)


@func
def next_tile(place: ti.i32, first: ti.i32) -> ti.i32:
    """Start of the next tile, which is after `first`."""
    return ti.max(place + TILE, first)


@func
def add_multiple(y: Scalars, at: ti.i32, factor: ti.f64, x: Scalars, first: ti.i32, count: ti.i32):
    """Add `factor` times x[first : first + count] to y[at : at + count]."""
    i, beside = at, count & TILE - 1
    while i < at + count - beside:
        j = first + i - at
        total = Tile(0.0)
        for a in ti.static(range(TILE)):
            total[a] = y[i + a] + factor * x[j + a]
        for a in ti.static(range(TILE)):
            y[i + a] = total[a]
        i = next_tile(i, at)
    for left in range(beside):
        k = count - 1 - left
        y[at + k] = y[at + k] + factor * x[first + k]


@func
def add_three_multiples(y: Scalars, factors: ti.types.vector(3, ti.f64), x: Scalars, first: ti.i32, count: ti.i32):
    """Add three rows of x, `count` long and one after the other from `first`, each times its factor, to y[:count]."""
    i, beside = 0, count & TILE - 1
    while i < count - beside:
        j = first + i
        total = Tile(0.0)
        for a in ti.static(range(TILE)):
            total[a] = (
                y[i + a] + factors[0] * x[j + a] + factors[1] * x[j + count + a] + factors[2] * x[j + 2 * count + a]
            )
        for a in ti.static(range(TILE)):
            y[i + a] = total[a]
        i = next_tile(i, 0)
    for left in range(beside):
        k = count - 1 - left
        j = first + k
        y[k] = y[k] + factors[0] * x[j] + factors[1] * x[j + count] + factors[2] * x[j + 2 * count]
