"""The elastic forces on amplitudes, and their stiffness, by the chosen integration domains of reduced bodies.

With F = F_0 + sum_k B_k q_k in a domain of volume w, the force on amplitude k is -w P : B_k, and the stiffness
w B_k : C : B_l. Along the axes of the tangent, as in `rubber_domains.py`, C is a 3x3 matrix of the diagonal and a 2x2
matrix of each pair across it. With their Cholesky factors a domain's stiffness is the sum of squares of nine rows,
S^T S, so that all domains of a body together are one dense product.

Hooke's law, corotated with R, needs four rows: with Z_k = R^T B_k,
    2 mu sym(Z_k) : sym(Z_l) = 2 mu B_k : B_l - 2 mu skew(Z_k) : skew(Z_l),
of which the first part never changes. The three rows of skew(Z) are subtracted, the row of tr(Z) = R : B is added.
"""

from typing import NamedTuple

from taichisoft.bodies.kernels.domain_deformation import (
    DILATION,
    SHAPE,
    Domains,
    Movement,
    deformation_and_rate,
)
from taichisoft.bodies.kernels.hooke_domains import corotated_stress
from taichisoft.bodies.kernels.mode_motion import Amplitudes, ModeShapes
from taichisoft.bodies.kernels.principal_stretches import HOOKE, LAMBDA, MU
from taichisoft.bodies.kernels.rubber_domains import respond_by_stretches
from taichisoft.runtime.launch import func, kernel
from taichisoft.runtime.taichi_start import Integers, Matrices, ti
from taichisoft.runtime.tiles import SHIFT, TILE, Column, Columns, advance, opaque


class ReducedDomains(NamedTuple):
    """Beside the domains' own arrays, whose gradients are in the frame of the mesh.

    Attributes:
        body: number among the reduced bodies of each domain, shape (domain_count,).
        body_start: first domain of each body, shape (body_count + 1,).
        slope_start: where a domain's B begins in `slope`, shape (domain_count,).
        slope: B of eight modes after the other: entry 00 of the deformation gradient, then 01, and so on.
        row_start: first row of each domain in S of its body, shape (domain_count,): nine under laws of rubber, under
            Hooke's law one where energy of volume counts.
        skew_start: first of its three rows that are subtracted, which follow after all others of the body, shape
            (domain_count,); without a meaning where there are none.
        body_rows: rows of S of each body, and with those that are subtracted, shape (2 body_count,).
    """

    body: Integers
    body_start: Integers
    slope_start: Integers
    slope: Columns
    row_start: Integers
    skew_start: Integers
    body_rows: Integers


class ReducedStiffness(NamedTuple):
    """Work space, and what it is added to.

    Attributes:
        rows: S of a body, in columns of eight modes.
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
    force: Columns
    square_start: Integers
    constant: Columns
    square: Columns
    block: Integers
    block_body: Integers
    block_row: Integers
    block_column: Integers
    blocks: Matrices


@ti.func
def safe_root(pivot: ti.f64):
    """A root and its inverse, both 0 where the pivot of a semi-definite matrix is not positive."""
    root, inverse = 0.0, 0.0
    if pivot > 0.0:
        root = ti.sqrt(pivot)
        inverse = 1.0 / root
    return root, inverse


@func
def strain_under_hooke(
    d: ti.i32,
    modes: ModeShapes,
    reduced: ReducedDomains,
    domains: Domains,
    movement: Movement,
    amplitudes: Amplitudes,
    stiffness: ReducedStiffness,
    one: ti.i32,
):
    """Add a domain's force on the amplitudes, and fill its rows of S."""
    deformation, rate = deformation_and_rate(d, domains, movement)
    b = reduced.body[d]
    to_mesh = modes.axes[b].transpose()
    deformation, rate = to_mesh @ deformation, to_mesh @ rate
    rotation, stress = corotated_stress(d, deformation, rate, domains)
    first = domains.volume[d, DILATION] * domains.modulus[d, LAMBDA]
    second = domains.volume[d, SHAPE] * domains.modulus[d, MU]
    of_volume, of_shape = ti.sqrt(domains.factor[d] * first), ti.sqrt(domains.factor[d] * second)
    tiles, start = modes.tiles[b], amplitudes.start[b]
    slope_start = opaque(reduced.slope_start[d], one)
    row, skew_row = opaque(reduced.row_start[d] * tiles, one), opaque(reduced.skew_start[d] * tiles, one)
    t = 0
    while t < tiles:
        slope = opaque(slope_start + 9 * t, one)
        s = [reduced.slope[slope + n] for n in range(9)]
        force, trace = Column(0.0), Column(0.0)
        for i, j in ti.static(ti.ndrange(3, 3)):
            force += stress[i, j] * s[3 * i + j]
            trace += rotation[i, j] * s[3 * i + j]
        own = opaque(start + t, one)
        stiffness.force[own] = stiffness.force[own] - force
        if first > 0.0:
            stiffness.rows[opaque(row + t, one)] = of_volume * trace
        if second > 0.0:
            for i, j, k in ti.static([(1, 2, 0), (2, 0, 1), (0, 1, 2)]):
                skew = Column(0.0)
                for n in ti.static(range(3)):
                    skew += rotation[n, i] * s[3 * n + j] - rotation[n, j] * s[3 * n + i]
                stiffness.rows[opaque(skew_row + k * tiles + t, one)] = of_shape * skew
        t = advance(t, 1, one)


@func
def strain_under_rubber(
    d: ti.i32,
    modes: ModeShapes,
    reduced: ReducedDomains,
    domains: Domains,
    movement: Movement,
    amplitudes: Amplitudes,
    stiffness: ReducedStiffness,
    one: ti.i32,
):
    """Add a domain's force on the amplitudes, and fill its rows of S."""
    deformation, rate = deformation_and_rate(d, domains, movement)
    b = reduced.body[d]
    to_mesh = modes.axes[b].transpose()
    stress, left, right, hessian, same, swapped = respond_by_stretches(
        d, to_mesh @ deformation, to_mesh @ rate, domains
    )
    r00, i00 = safe_root(hessian[0, 0])
    r10, r20 = hessian[1, 0] * i00, hessian[2, 0] * i00
    r11, i11 = safe_root(hessian[1, 1] - r10 * r10)
    r21 = (hessian[2, 1] - r20 * r10) * i11
    r22, _ = safe_root(hessian[2, 2] - r20 * r20 - r21 * r21)
    tiles, start = modes.tiles[b], amplitudes.start[b]
    first, row = opaque(reduced.slope_start[d], one), opaque(reduced.row_start[d] * tiles, one)
    t = 0
    while t < tiles:
        slope = opaque(first + 9 * t, one)
        s = [reduced.slope[slope + n] for n in range(9)]
        force, turned, z = Column(0.0), [Column(0.0) for _ in range(9)], [Column(0.0) for _ in range(9)]
        for i, j in ti.static(ti.ndrange(3, 3)):
            force += stress[i, j] * s[3 * i + j]
            for k in ti.static(range(3)):
                turned[3 * i + j] += left[k, i] * s[3 * k + j]
        own = opaque(start + t, one)
        stiffness.force[own] = stiffness.force[own] - force
        for i, j, k in ti.static(ti.ndrange(3, 3, 3)):
            z[3 * i + j] += turned[3 * i + k] * right[k, j]
        stiffness.rows[opaque(row + t, one)] = r00 * z[0] + r10 * z[4] + r20 * z[8]
        stiffness.rows[opaque(row + tiles + t, one)] = r11 * z[4] + r21 * z[8]
        stiffness.rows[opaque(row + 2 * tiles + t, one)] = r22 * z[8]
        for i, j, k in ti.static([(1, 2, 0), (2, 0, 1), (0, 1, 2)]):
            root, inverse = safe_root(same[i, j])
            cross = swapped[k] * inverse
            rest, _ = safe_root(same[j, i] - cross * cross)
            stiffness.rows[opaque(row + (3 + k) * tiles + t, one)] = root * z[3 * i + j] + cross * z[3 * j + i]
            stiffness.rows[opaque(row + (6 + k) * tiles + t, one)] = rest * z[3 * j + i]
        t = advance(t, 1, one)


@func
def square_rows(b: ti.i32, reduced: ReducedDomains, tiles: ti.i32, stiffness: ReducedStiffness, one: ti.i32):
    """The lower triangle of tiles of S^T S, less the rows that are subtracted, plus what is constant."""
    for one_tile in range(tiles):
        for other in range(one_tile + 1):
            place = opaque(stiffness.square_start[b] + TILE * one_tile * tiles + other, one)
            total = [stiffness.constant[place + a * tiles] for a in range(TILE)]
            row, shift = other, one_tile - other
            while row < reduced.body_rows[2 * b] * tiles:
                mine, theirs = stiffness.rows[opaque(row + shift, one)], stiffness.rows[opaque(row, one)]
                for a in ti.static(range(TILE)):
                    total[a] += mine[a] * theirs
                row = advance(row, tiles, one)
            while row < reduced.body_rows[2 * b + 1] * tiles:
                mine, theirs = stiffness.rows[opaque(row + shift, one)], stiffness.rows[opaque(row, one)]
                for a in ti.static(range(TILE)):
                    total[a] -= mine[a] * theirs
                row = advance(row, tiles, one)
            for a in ti.static(range(TILE)):
                stiffness.square[place + a * tiles] = total[a]


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
    """Forces f - (h + b) K v on the amplitudes, and the blocks of A of the reduced bodies."""
    ti.loop_config(serialize=True)
    for b in range(modes.tiles.shape[0]):
        for t in range(amplitudes.start[b], amplitudes.start[b + 1]):
            stiffness.force[t] = Column(0.0)
        for d in range(reduced.body_start[b], reduced.body_start[b + 1]):
            if domains.law[d] == HOOKE:
                strain_under_hooke(d, modes, reduced, domains, movement, amplitudes, stiffness, one)
            else:
                strain_under_rubber(d, modes, reduced, domains, movement, amplitudes, stiffness, one)
        square_rows(b, reduced, modes.tiles[b], stiffness, one)
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
