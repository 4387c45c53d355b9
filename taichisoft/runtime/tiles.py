"""Tiles of 8 x 8 scalars, the unit of all dense arithmetic of the direct solver. A column of a tile is one vector.

Two things keep a tile in the processor's vector registers, which is worth a factor of three. LLVM must not be able
to count a loop over columns, or it vectorises that loop instead of the tile. And it must not see through an index of
vectors to a loop's counter: it then fears that 32 bits overflow between the lanes, and loads them one by one.
`advance` and `opaque` see to both with the help of `one`, an argument of the kernel that is 1.
"""

from typing import Any

from taichisoft.runtime.language import Arrays, func, ti

TILE = 8
SHIFT = 3  # the logarithm of TILE
Column = ti.types.vector(TILE, ti.f64)
Columns: Any = Arrays(Column, 1)


@func
def advance(counter: ti.i32, step: ti.i32, one: ti.i32) -> ti.i32:
    """The counter, which is not negative, plus a step."""
    return ti.max(counter + step, one)


@func
def opaque(index: ti.i32, one: ti.i32) -> ti.i32:
    """An index that is not negative, as it is."""
    return ti.max(index, one - 1)


@func
def tiles_in(scalars: ti.i32) -> ti.i32:
    """How many tiles hold that many rows."""
    return (scalars + TILE - 1) >> SHIFT


@func
def triangle(rows: ti.i32) -> ti.i32:
    """Number of columns of tiles in that many rows of tiles of a lower triangle."""
    return rows * (rows + 1) << SHIFT - 1
