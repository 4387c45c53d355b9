"""The elastic forces on amplitudes, and their stiffness, by the chosen integration domains of reduced bodies.

With F = F_0 + sum_k B_k q_k in a domain of volume w, the force on amplitude k is -w P : B_k, and the stiffness
w B_k : C : B_l. Along the axes of the tangent, as in `rubber_domains.py`, C is a 3x3 matrix of the diagonal and a 2x2
matrix of each pair across it. With their Cholesky factors a domain's stiffness is the sum of squares of at most nine
rows, S^T S, of which those that are zero are left out. A few domains at a time fill their rows, which stay in the cache
while their squares are added.

Hooke's law, corotated with R, needs four rows: with Z_k = R^T B_k,
    2 mu sym(Z_k) : sym(Z_l) = 2 mu B_k : B_l - 2 mu skew(Z_k) : skew(Z_l),
of which the first part never changes. The three rows of skew(Z) are subtracted, the row of tr(Z) = R : B is added.
"""

from typing import NamedTuple

from taichisoft.mechanics.kernels.domain_deformation import (
    DILATION,
    HOOKE,
    LAMBDA,
    MU,
    SHAPE,
    Domains,
    Movement,
    deformation_and_rate,
)
from taichisoft.mechanics.kernels.hooke_domains import corotated_stress
from taichisoft.mechanics.kernels.mode_motion import Amplitudes, ModeShapes
from taichisoft.mechanics.kernels.rubber_domains import respond_by_stretches
from taichisoft.runtime.arithmetic import HALF, SHIFT, TILE, Column, Columns, advance, opaque
from taichisoft.runtime.language import Integers, Matrices, Scalars, func, mat3, ti, vec3
from taichisoft.runtime.launch import kernel

# Shares of an entry of B: in the force, and in each row of S.
HOOKE_SHARES, RUBBER_SHARES = 5, 10
# Domains that fill their rows before their squares are added, and rows for them with one to write zeros to.
DOMAINS_AT_ONCE = 8
ADDED_ROWS = 9 * DOMAINS_AT_ONCE + 1
ROWS = ADDED_ROWS + 3 * DOMAINS_AT_ONCE + 1
# Two axes, and the one across them.
PAIRS = ((1, 2, 0), (2, 0, 1), (0, 1, 2))


class ReducedDomains(NamedTuple):
    """Beside the domains' own arrays, whose gradients are in the frame of the mesh.

    Attributes:
        body_start: first domain of each body, shape (body_count + 1,).
        slope_start: where a domain's B begins in `slope`, shape (domain_count,).
        slope: B of eight modes after the other: entry 00 of the deformation gradient, then 01, and so on.
    """

    body_start: Integers
    slope_start: Integers
    slope: Columns


class ReducedStiffness(NamedTuple):
    """Work space, and what it is added to.

    Attributes:
        rows: of S of the domains at hand, in columns of eight modes: ADDED_ROWS that are added, then others.
        share: of an entry of a domain's B in its force and in its rows of S, entry by entry, shape (90,).
        force: on the amplitudes, in columns of eight.
        square_start: where the matrix of each body begins in `square`, shape (body_count,).
        constant: what never changes in A, row by row in columns of eight: mass, damping, anchors, and 2 mu B : B.
        square: A, likewise; the lower triangle of tiles.
        block: numbers of the blocks of the system matrix that belong to reduced bodies, shape (count,).
        block_body: of each the number of its body.
        block_row, block_column: of each the first amplitude.
        blocks: of the system matrix, shape (block_count, 3, 3).
    """

    rows: Columns
    share: Scalars
    force: Columns
    square_start: Integers
    constant: Columns
    square: Columns
    block: Integers
    block_body: Integers
    block_row: Integers
    block_column: Integers
    blocks: Matrices


@func
def safe_root(pivot: ti.f64):
    """A root and its inverse, both 0 where the pivot of a semi-definite matrix is not positive."""
    root, inverse = 0.0, 0.0
    if pivot > 0.0:
        root = ti.sqrt(pivot)
        inverse = 1.0 / root
    return root, inverse


@func
def is_positive(number: ti.f64) -> ti.i32:
    """1 or 0."""
    return ti.select(number > 0.0, 1, 0)


@func
def fill_hooke(d: ti.i32, deformation: mat3, rate: mat3, domains: Domains, share: Scalars):
    """Shares of the entries of B in the force and in four rows of S, of the trace and of skew(Z).

    Returns:
        Bit r set where share r makes a row that is not zero.
    """
    rotation, stress = corotated_stress(d, deformation, rate, domains)
    first = domains.volume[d, DILATION] * domains.modulus[d, LAMBDA]
    second = domains.volume[d, SHAPE] * domains.modulus[d, MU]
    of_volume, of_shape = ti.sqrt(domains.factor[d] * first), ti.sqrt(domains.factor[d] * second)
    for i, j in ti.static(ti.ndrange(3, 3)):
        place = HOOKE_SHARES * (3 * i + j)
        share[place] = stress[i, j]
        share[place + 1] = of_volume * rotation[i, j]
        for k in ti.static(range(3)):
            share[place + 2 + k] = 0.0
            if ti.static(j == (k + 2) % 3):
                share[place + 2 + k] = of_shape * rotation[i, (k + 1) % 3]
            if ti.static(j == (k + 1) % 3):
                share[place + 2 + k] = -of_shape * rotation[i, (k + 2) % 3]
    return is_positive(of_volume) << 1 | 7 * is_positive(of_shape) << 2


@func
def fill_rubber(d: ti.i32, deformation: mat3, rate: mat3, domains: Domains, share: Scalars):
    """Shares of the entries of B in the force and in nine rows of S, of Z along the axes of the tangent.

    Returns:
        Bit r set where share r makes a row that is not zero.
    """
    stress, left, right, hessian, same, swapped = respond_by_stretches(d, deformation, rate, domains)
    r00, i00 = safe_root(hessian[0, 0])
    r10, r20 = hessian[1, 0] * i00, hessian[2, 0] * i00
    r11, i11 = safe_root(hessian[1, 1] - r10 * r10)
    r21 = (hessian[2, 1] - r20 * r10) * i11
    r22, _ = safe_root(hessian[2, 2] - r20 * r20 - r21 * r21)
    root, cross, rest = vec3(0.0), vec3(0.0), vec3(0.0)
    for i, j, n in ti.static(PAIRS):
        root[n], inverse = safe_root(same[i, j])
        cross[n] = swapped[n] * inverse
        rest[n], _ = safe_root(same[j, i] - cross[n] * cross[n])
    for k, m in ti.static(ti.ndrange(3, 3)):
        place = RUBBER_SHARES * (3 * k + m)
        z = [left[k, n // 3] * right[m, n % 3] for n in range(9)]
        share[place] = stress[k, m]
        share[place + 1] = r00 * z[0] + r10 * z[4] + r20 * z[8]
        share[place + 2] = r11 * z[4] + r21 * z[8]
        share[place + 3] = r22 * z[8]
        for i, j, n in ti.static(PAIRS):
            share[place + 4 + n] = root[n] * z[3 * i + j] + cross[n] * z[3 * j + i]
            share[place + 7 + n] = rest[n] * z[3 * j + i]
    is_filled = is_positive(r00) << 1 | is_positive(r11) << 2 | is_positive(r22) << 3
    for n in ti.static(range(3)):
        is_filled |= is_positive(root[n]) << 4 + n | is_positive(rest[n]) << 7 + n
    return is_filled


@func
def multiply_slopes(
    d: ti.i32,
    count: ti.template(),
    tiles: ti.i32,
    start: ti.i32,
    row: ti.i32,
    further_row: ti.i32,
    is_filled: ti.i32,
    reduced: ReducedDomains,
    stiffness: ReducedStiffness,
    one: ti.i32,
):
    """Subtract a domain's force on the amplitudes, and fill its rows of S: the products of shares and slopes.

    Share 1 makes `row`, the others `further_row` and those after it. Where bit r of `is_filled` is not set, row r is
    zero and written over by the next. The shares come from memory and the loop over them is not unrolled, or LLVM takes
    the columns apart: twice the time.
    """
    slope = opaque(reduced.slope_start[d], one)
    t = 0
    while t < tiles:
        total = [Column(0.0) for _ in range(count)]
        n = 0
        while n < 9:
            column = reduced.slope[slope]
            for r in ti.static(range(count)):
                total[r] += stiffness.share[count * n + r] * column
            n, slope = advance(n, 1, one), advance(slope, 1, one)
        own = opaque(start + t, one)
        stiffness.force[own] = stiffness.force[own] - total[0]
        stiffness.rows[opaque(row * tiles + t, one)] = total[1]
        place = further_row * tiles + t
        for r in ti.static(range(2, count)):
            stiffness.rows[opaque(place, one)] = total[r]
            place += tiles * (is_filled >> r & 1)
        t = advance(t, 1, one)


@func
def add_squares(b: ti.i32, added: ti.i32, subtracted: ti.i32, tiles: ti.i32, stiffness: ReducedStiffness, one: ti.i32):
    """Add to the lower triangle of tiles of A the squares of so many rows, and subtract those of so many others."""
    for one_tile in range(tiles):
        for other in range(one_tile + 1):
            for half in ti.static(range(2)):
                first = TILE * one_tile + HALF * half
                place = opaque(stiffness.square_start[b] + first * tiles + other, one)
                total = [stiffness.square[place + a * tiles] for a in range(HALF)]
                row, shift = other, one_tile - other
                while row < added * tiles:
                    mine, theirs = stiffness.rows[opaque(row + shift, one)], stiffness.rows[opaque(row, one)]
                    for a in ti.static(range(HALF)):
                        total[a] += mine[HALF * half + a] * theirs
                    row = advance(row, tiles, one)
                row = other + ADDED_ROWS * tiles
                while row < (ADDED_ROWS + subtracted) * tiles:
                    mine, theirs = stiffness.rows[opaque(row + shift, one)], stiffness.rows[opaque(row, one)]
                    for a in ti.static(range(HALF)):
                        total[a] -= mine[HALF * half + a] * theirs
                    row = advance(row, tiles, one)
                for a in ti.static(range(HALF)):
                    stiffness.square[place + a * tiles] = total[a]


@func
def add_domains(
    b: ti.i32,
    first: ti.i32,
    last: ti.i32,
    modes: ModeShapes,
    reduced: ReducedDomains,
    domains: Domains,
    movement: Movement,
    amplitudes: Amplitudes,
    stiffness: ReducedStiffness,
    one: ti.i32,
):
    """Add some domains of a body to its forces and to A."""
    tiles, start = modes.tiles[b], amplitudes.start[b]
    added, subtracted = 0, 0
    for d in range(first, last):
        deformation, rate = deformation_and_rate(d, domains, movement)
        to_mesh = modes.axes[b].transpose()
        deformation, rate = to_mesh @ deformation, to_mesh @ rate
        if domains.law[d] == HOOKE:
            filled = fill_hooke(d, deformation, rate, domains, stiffness.share)
            further = ADDED_ROWS + subtracted
            multiply_slopes(d, HOOKE_SHARES, tiles, start, added, further, filled, reduced, stiffness, one)
            added += filled >> 1 & 1
            subtracted += 3 * (filled >> 2 & 1)
        else:
            filled = fill_rubber(d, deformation, rate, domains, stiffness.share)
            further = added + (filled >> 1 & 1)
            multiply_slopes(d, RUBBER_SHARES, tiles, start, added, further, filled, reduced, stiffness, one)
            for r in ti.static(range(1, RUBBER_SHARES)):
                added += filled >> r & 1
    add_squares(b, added, subtracted, tiles, stiffness, one)


@kernel
def assemble_reduced(
    modes: ModeShapes,
    reduced: ReducedDomains,
    domains: Domains,
    movement: Movement,
    amplitudes: Amplitudes,
    stiffness: ReducedStiffness,
    one: ti.i32,
):
    """Forces f - (h + b) K v on the amplitudes, and the blocks of A of the reduced bodies.

    The bodies take turns, so that those which are copies read the same slopes from the cache.
    """
    ti.loop_config(serialize=True)
    for _ in range(1):
        bodies, most = modes.tiles.shape[0], 0
        for t in range(stiffness.force.shape[0]):
            stiffness.force[t] = Column(0.0)
        for t in range(stiffness.square.shape[0]):
            stiffness.square[t] = stiffness.constant[t]
        for b in range(bodies):
            most = ti.max(most, reduced.body_start[b + 1] - reduced.body_start[b])
        for n in range((most + DOMAINS_AT_ONCE - 1) // DOMAINS_AT_ONCE):
            for b in range(bodies):
                first = reduced.body_start[b] + DOMAINS_AT_ONCE * n
                last = ti.min(first + DOMAINS_AT_ONCE, reduced.body_start[b + 1])
                if first < last:
                    add_domains(b, first, last, modes, reduced, domains, movement, amplitudes, stiffness, one)
    ti.loop_config(serialize=True)
    for n in range(stiffness.block.shape[0]):
        b = stiffness.block_body[n]
        entries = ti.Matrix.zero(ti.f64, 3, 3)
        for i, j in ti.static(ti.ndrange(3, 3)):
            low = ti.max(stiffness.block_row[n] + i, stiffness.block_column[n] + j)
            high = ti.min(stiffness.block_row[n] + i, stiffness.block_column[n] + j)
            place = stiffness.square_start[b] + low * modes.tiles[b] + (high >> SHIFT)
            entries[i, j] = stiffness.square[place][high % TILE]
        stiffness.blocks[stiffness.block[n]] = entries
