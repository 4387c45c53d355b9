"""Forces of membranes, fibres and springs, and what they add to the system matrix.

A membrane's triangle and a piece of a fibre have one gradient each, from the plane or line in which they lie at rest to
space: f_i = sum_a x_a g_ai over their nodes, i = 1, 2 (a fibre has f_1 alone). With Green's strain
E = (f_i . f_j - delta_ij) / 2 and the tensions S = C E, linear in it, the energy is w S : E / 2, and
    force_a = -w g_ai S_ij f_j,    K_ab = w (B_a^T C B_b + (g_ai S_ij g_bj) I),    B_a = dE / dx_a.
Green's strain knows no rotation, however large, and threads are so stiff that their strains stay small. Of compression
nothing is left in the second part of K, so that K has no negative eigenvalue (Teran et al. 2005, Robust quasistatic
finite elements and flesh simulation); this does not change where the iterations end.

A part that slackens has the relaxed energy, the least that it has with any wrinkles, which shorten it (Pipkin 1986, The
relaxed energy density for isotropic elastic membranes). A thread is slack where E along it is negative. A sheet with
principal strains e1 > e2 is slack where e1 < 0, taut where e2 > -ratio e1, and in between wrinkled along its axis m of
e1: S = Et e1 m m^T. As S has no negative eigenvalue, the energy is convex in the positions; its C is the slope of S.

A spring of length L at rest has f_1 = x_b - x_a = l u instead, the tension T = k (l - L), at any stretch, and a drag c:
    force_b = -(T + c (v_b - v_a) . u) u,    K_bb = (k - T / l) u u^T + (T / l) I,
again without compression, T / l < 0. A cord is a spring that hangs loose where T < 0.
"""

from typing import NamedTuple

from taichisoft.mechanics.kernels.domain_deformation import DomainSums, Movement
from taichisoft.runtime.arithmetic import TINY
from taichisoft.runtime.language import Integers, Scalars, ScalarTable, Vectors, func, mat3, ti, vec3
from taichisoft.runtime.launch import kernel

STIFF, THREAD, SHEET, SPRING, CORD = range(5)
"""What a part does where it would be compressed: resist, hang loose, or wrinkle as an isotropic sheet does; a spring
resists, a cord hangs loose."""


class ReinforcementParts(NamedTuple):
    """Triangles of membranes, pieces of fibres, and springs; an entry is a node of one of them.

    Attributes:
        start: the first entry of each part, shape (part_count + 1,).
        node: of each entry, shape (entry_count,).
        gradient: g along the two axes of the part, and 0 [1/mm], shape (entry_count, 3); -1 and 1 [-] of a spring.
        measure: area [mm^2] or length [mm], 1 of a spring, shape (part_count,).
        stiffness: C of the strains 11, 22 and 12 twice: 00, 01, 02, 11, 12, 22 [mN/mm] or [mN]; of a spring
            k [mN/mm] and L [mm], shape (part_count, 6).
        slackening: STIFF, THREAD, SHEET, SPRING or CORD, shape (part_count,).
        drag: c [mN s/mm], 0 where there are no velocities before the step, shape (part_count,).
        lag: s + b [s], 0 where there are no velocities before the step, shape (part_count,).
        factor: of K in A, shape (part_count,).
        undamped: share of lag and factor without damping, shape (part_count,).
        dragged: c times its factor in A [mN s^2/mm], shape (part_count,).
    """

    start: Integers
    node: Integers
    gradient: Vectors
    measure: Scalars
    stiffness: ScalarTable
    slackening: Integers
    drag: Scalars
    lag: Scalars
    factor: Scalars
    undamped: Scalars
    dragged: Scalars


class ReinforcedBlocks(NamedTuple):
    """Which parts make up which blocks of the system matrix.

    Attributes:
        block: number of each block in the matrix, shape (count,).
        node: of a block on the diagonal, -1 for others, shape (count,).
        start: where each block's contributions begin in the lists that follow, shape (count + 1,).
        part: that contributes.
        row, column: its entries of the block's two nodes.
    """

    block: Integers
    node: Integers
    start: Integers
    part: Integers
    row: Integers
    column: Integers


class PartStates(NamedTuple):
    """What a step computes for each part.

    Attributes:
        first, second: f_1 and f_2, u of a spring, shape (part_count, 3).
        tension: the tensions 11, 22 and 12, T / l of a spring, without compression, shape (part_count, 3).
        stiffness: C of a part as taut as it is, laid out as that of other parts than springs, shape (part_count, 6).
        force: of the part on the node of each entry [mN], shape (entry_count, 3).
    """

    first: Vectors
    second: Vectors
    tension: Vectors
    stiffness: ScalarTable
    force: Vectors


@func
def stiffness_of(p: ti.i32, table: ti.template()) -> mat3:
    """C of a part."""
    return ti.Matrix(
        [
            [table[p, 0], table[p, 1], table[p, 2]],
            [table[p, 1], table[p, 3], table[p, 4]],
            [table[p, 2], table[p, 4], table[p, 5]],
        ]
    )


@func
def wrinkled(stiffness: mat3, strain: vec3):
    """Tension of an isotropic sheet, and its slope."""
    ratio = stiffness[0, 1] / stiffness[0, 0]
    modulus = stiffness[0, 0] * (1.0 - ratio * ratio)
    mean, half, shear = 0.5 * (strain[0] + strain[1]), 0.5 * (strain[0] - strain[1]), 0.5 * strain[2]
    radius = ti.sqrt(half * half + shear * shear)
    tension, slope = stiffness @ strain, stiffness
    if mean + radius <= 0.0:
        tension, slope = vec3(0.0), ti.Matrix.zero(ti.f64, 3, 3)
    elif mean - radius < -ratio * (mean + radius):
        cosine, sine = half / radius, shear / radius  # of twice the angle of m
        along = 0.5 * vec3(1.0 + cosine, 1.0 - cosine, sine)
        turning = 0.5 * vec3(-sine, sine, cosine)
        tension = modulus * (mean + radius) * along
        turn = modulus * (mean + radius) / radius
        slope = modulus * along.outer_product(along) + turn * turning.outer_product(turning)
    return tension, slope


@func
def without_compression(tension: vec3) -> vec3:
    """The part of a tensor (11, 22, 12) with positive eigenvalues."""
    mean, radius = (
        0.5 * (tension[0] + tension[1]),
        ti.sqrt(0.25 * (tension[0] - tension[1]) ** 2 + tension[2] * tension[2]),
    )
    low, high = mean - radius, mean + radius
    kept = tension
    if high <= 0.0:
        kept = vec3(0.0)
    elif low < 0.0:
        kept = high / (2.0 * radius + TINY) * vec3(tension[0] - low, tension[1] - low, tension[2])
    return kept


@func
def stretched_spring(p: ti.i32, between: vec3, parts: ReinforcementParts):
    """Direction of a spring, its tension, that over length without compression, and its slope beside that."""
    stiffness, rest, length = parts.stiffness[p, 0], parts.stiffness[p, 1], between.norm()
    along, tension, kept = between / (length + TINY), stiffness * (length - rest), stiffness
    if rest > 0.0:
        kept = ti.max(tension, 0.0) / (length + TINY)
    slope = ti.Matrix.zero(ti.f64, 3, 3)
    slope[0, 0] = stiffness - kept
    if parts.slackening[p] == CORD and tension < 0.0:
        along, tension = vec3(0.0), 0.0
    return along, vec3(tension, 0.0, 0.0), vec3(kept, 0.0, 0.0), slope


@func
def stretch_part(p: ti.i32, parts: ReinforcementParts, movement: Movement, states: PartStates):
    """Gradient, tension and forces of a part."""
    begin, end = parts.start[p], parts.start[p + 1]
    x0, v0 = movement.position[parts.node[begin]], movement.velocity[parts.node[begin]]
    f1, f2, d1, d2 = vec3(0.0), vec3(0.0), vec3(0.0), vec3(0.0)
    for c in range(begin + 1, end):
        g = parts.gradient[c]
        x, v = movement.position[parts.node[c]] - x0, movement.velocity[parts.node[c]] - v0
        f1 += g[0] * x
        f2 += g[1] * x
        d1 += g[0] * v
        d2 += g[1] * v
    slope = stiffness_of(p, parts.stiffness)
    strain = vec3(0.5 * (f1.dot(f1) - 1.0), 0.5 * (f2.dot(f2) - 1.0), f1.dot(f2))
    rate = vec3(f1.dot(d1), f2.dot(d2), f1.dot(d2) + f2.dot(d1))
    elastic = slope @ strain
    if parts.slackening[p] == SHEET:
        elastic, slope = wrinkled(slope, strain)
    elif parts.slackening[p] == THREAD and elastic[0] + elastic[1] <= 0.0:
        elastic, slope = vec3(0.0), ti.Matrix.zero(ti.f64, 3, 3)
    kept = without_compression(elastic)
    if parts.slackening[p] == SPRING or parts.slackening[p] == CORD:
        f1, elastic, kept, slope = stretched_spring(p, f1, parts)
        rate = vec3(f1.dot(d1), 0.0, 0.0)
    tension = elastic + parts.lag[p] * (slope @ rate)
    tension[0] += parts.drag[p] * rate[0]
    # A tension that turns with the body is no strain: damping does not resist it.
    ahead = parts.undamped[p] * parts.lag[p]
    along1 = tension[0] * f1 + tension[2] * f2 + ahead * (kept[0] * d1 + kept[2] * d2)
    along2 = tension[2] * f1 + tension[1] * f2 + ahead * (kept[2] * d1 + kept[1] * d2)
    for c in range(begin, end):
        g = parts.gradient[c]
        states.force[c] = -parts.measure[p] * (g[0] * along1 + g[1] * along2)
    states.first[p], states.second[p], states.tension[p] = f1, f2, kept
    for i in ti.static(range(3)):
        for j in ti.static(range(i, 3)):
            states.stiffness[p, 3 * i - i * (i + 1) // 2 + j] = slope[i, j]


@func
def change_of_strain(g: vec3, first: vec3, second: vec3) -> mat3:
    """B of a node with gradient g."""
    both = g[1] * first + g[0] * second
    return ti.Matrix.rows([g[0] * first, g[1] * second, both])


@kernel
def add_reinforcements(
    parts: ReinforcementParts, movement: Movement, blocks: ReinforcedBlocks, states: PartStates, total: DomainSums
):
    """Add the parts' nodal forces f - lag K v, and K times its factor, to forces and matrix."""
    for p in range(parts.lag.shape[0]):
        stretch_part(p, parts, movement, states)
    for b in range(blocks.block.shape[0]):
        stiffness, force = ti.Matrix.zero(ti.f64, 3, 3), vec3(0.0)
        for k in range(blocks.start[b], blocks.start[b + 1]):
            p, row, column = blocks.part[k], parts.gradient[blocks.row[k]], parts.gradient[blocks.column[k]]
            first, second, kept = states.first[p], states.second[p], states.tension[p]
            of_row, of_column = change_of_strain(row, first, second), change_of_strain(column, first, second)
            turning = parts.undamped[p] * (
                row[0] * (kept[0] * column[0] + kept[2] * column[1])
                + row[1] * (kept[2] * column[0] + kept[1] * column[1])
            )
            whole = of_row.transpose() @ stiffness_of(p, states.stiffness) @ of_column
            whole += turning * ti.Matrix.identity(ti.f64, 3)
            stiffness += parts.factor[p] * parts.measure[p] * whole
            stiffness += parts.dragged[p] * row[0] * column[0] * first.outer_product(first)
            force += states.force[blocks.row[k]]
        total.blocks[blocks.block[b]] = total.blocks[blocks.block[b]] + stiffness
        node = blocks.node[b]
        if node >= 0:
            total.force[node] = total.force[node] + force
