"""y = y + a x for vectors within arrays, by tiles of eight numbers.

A plain loop over Taichi's arrays is not vectorised: LLVM must assume that what is stored changes the pointers it loads.
Here a tile is computed in registers before any of it is stored.
"""

from taichisoft.kernels.runtime import Scalars, ti

TILE = 8
Tile = ti.types.vector(TILE, ti.f64)


@ti.func
def add_multiple(y: Scalars, at: ti.i32, factor: ti.f64, x: Scalars, first: ti.i32, count: ti.i32):
    """Add `factor` times x[first : first + count] to y[at : at + count]."""
    for tile in range(count // TILE):
        i, j = at + TILE * tile, first + TILE * tile
        total = Tile(0.0)
        for a in ti.static(range(TILE)):
            total[a] = y[i + a] + factor * x[j + a]
        for a in ti.static(range(TILE)):
            y[i + a] = total[a]
    for k in range(count // TILE * TILE, count):
        y[at + k] = y[at + k] + factor * x[first + k]


@ti.func
def add_three_multiples(y: Scalars, factors: ti.types.vector(3, ti.f64), x: Scalars, first: ti.i32, count: ti.i32):
    """Add three rows of x, `count` long and one after the other from `first`, each times its factor, to y[:count]."""
    for tile in range(count // TILE):
        i, j = TILE * tile, first + TILE * tile
        total = Tile(0.0)
        for a in ti.static(range(TILE)):
            total[a] = (
                y[i + a] + factors[0] * x[j + a] + factors[1] * x[j + count + a] + factors[2] * x[j + 2 * count + a]
            )
        for a in ti.static(range(TILE)):
            y[i + a] = total[a]
    for k in range(count // TILE * TILE, count):
        j = first + k
        y[k] = y[k] + factors[0] * x[j] + factors[1] * x[j + count] + factors[2] * x[j + 2 * count]
