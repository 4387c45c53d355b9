"""Elasticity on integration domains: forces, tangents, and the system matrix by gathering.

A domain is a piece of a body with one deformation gradient, F = sum_a x_a g_a^T over its nodes: a quadrature point of
an element, or what surrounds an edge or a node of the mesh (`bodies/domains.py`). It has any number of nodes. With P
the first Piola stress and C = dP/dF of an energy (`laws.py`), and w its volume,
    f_a = -w P g_a,   (K_ab)_ij = w sum_kl C_ik,jl (g_a)_k (g_b)_l,
where C has no negative eigenvalues left. Hooke's law is corotated with the polar rotation, which is frozen in C.
"""

from typing import NamedTuple

from taichisoft.kernels.launch import func, kernel
from taichisoft.kernels.laws import HOOKE, LAMBDA, MU, OGDEN, SMALLEST_STRETCH, ogden_law, polynomial_law
from taichisoft.kernels.polar_rotation import polar_rotation
from taichisoft.kernels.runtime import CHUNK, THREADS, Integers, Matrices, Scalars, ScalarTable, Vectors, mat3, ti, vec3
from taichisoft.kernels.symmetric import TINY, positive_part, symmetric_eigen

# What a thread does in one go.
DOMAINS_A_TASK = 32
BLOCKS_A_TASK = 128
# What `progress` counts.
NEXT_TASK, DOMAINS_DONE = range(2)
# Columns of `volume`.
SHAPE, DILATION = range(2)
# Kinds of parts: Hooke's law with an energy of shape, with that of volume alone, and other laws.
SHAPED, DILATED, RESPONDING = range(3)

vec4 = ti.types.vector(4, ti.f64)
vec8 = ti.types.vector(8, ti.f64)
Quads = ti.types.ndarray(dtype=vec4, ndim=1)
Octets = ti.types.ndarray(dtype=vec8, ndim=1)


class Domains(NamedTuple):
    """Integration domains of all soft bodies that have them; an entry is a node of a domain.

    Attributes:
        start: where each domain's entries begin, shape (domain_count + 1,).
        node: of each entry, shape (entry_count,).
        gradient: g of each entry, at rest [1/mm], shape (entry_count, 3).
        volume: for which the energies of shape and of volume count [mm^3], shape (domain_count, 2).
        law: HOOKE, POLYNOMIAL or OGDEN, shape (domain_count,).
        modulus: of the law, see `laws.py` [kPa], shape (domain_count, 5).
        exponent: Ogden's [-], shape (domain_count, 3).
        lag: h + b [s], 0 in first order dynamics, shape (domain_count,).
        factor: of K in A, shape (domain_count,).
        undamped: h / (h + b), the share of the lag and of the factor that is not damping's, shape (domain_count,).
    """

    start: Integers
    node: Integers
    gradient: Vectors
    volume: ScalarTable
    law: Integers
    modulus: ScalarTable
    exponent: ScalarTable
    lag: Scalars
    factor: Scalars
    undamped: Scalars


class Strained(NamedTuple):
    """Domains of a step, by entries; rows of 4 and 8 numbers are vectors of the processor.

    Attributes:
        position: of the nodes [mm], shape (node_count, 3).
        velocity: of the nodes [mm/s], shape (node_count, 3).
        force: of each domain on its nodes [mN], shape (entry_count, 3).
        gradient: under Hooke's law sqrt(w mu factor) R g, with lambda for mu where only the energy of volume counts;
            under others g along the axes of the response; shape (entry_count, 4).
        response: under other laws w sum_l (h^2 C + h b D)_ik,jl (g_b)_l, three rows an entry for k = 0, 1, 2, with all
            ij but the last, shape (3 entry_count, 8).
        last_response: the last ij of the three, shape (entry_count, 4).
    """

    position: Vectors
    velocity: Vectors
    force: Vectors
    gradient: Quads
    response: Octets
    last_response: Quads


class DomainParts(NamedTuple):
    """Which parts make up the blocks of the system matrix that domains have to do with.

    Attributes:
        block: number of each of these blocks in the matrix, shape (count,).
        start: where the parts of each kind (SHAPED, DILATED, RESPONDING) of each block begin in the lists that follow,
            shape (3 count + 1,).
        row_entry, column_entry: entries of the block's two nodes in a domain.
        lame_ratio: lambda / mu of the domain, where both energies count; 0 elsewhere.
        node: that of a block on the diagonal, -1 for others, shape (count,).
    """

    block: Integers
    start: Integers
    row_entry: Integers
    column_entry: Integers
    lame_ratio: Scalars
    node: Integers


class DomainSums(NamedTuple):
    """What the domains add to.

    Attributes:
        force: f - (h + b) K v on each node [mN], shape (node_count, 3).
        blocks: of A, shape (block_count, 3, 3).
        progress: counters, 0 at the start.
    """

    force: Vectors
    blocks: Matrices
    progress: Integers


@ti.func
def column(matrix: mat3, k: ti.template()) -> vec3:
    """A column of a matrix."""
    return vec3(matrix[0, k], matrix[1, k], matrix[2, k])


@func
def strain_by_hooke(d: ti.i32, deformation: mat3, rate: mat3, rotation: mat3, domains: Domains, strained: Strained):
    """Forces and turned gradients of a domain under corotated Hooke's law."""
    unit = ti.Matrix.identity(ti.f64, 3)
    first = domains.volume[d, DILATION] * domains.modulus[d, LAMBDA]
    second = domains.volume[d, SHAPE] * domains.modulus[d, MU]
    strain = rotation.transpose() @ (deformation + domains.lag[d] * rate) - unit
    stress = rotation @ (first * strain.trace() * unit + second * (strain + strain.transpose()))
    weight = second
    if domains.volume[d, SHAPE] == 0.0:
        weight = first
    turn = ti.sqrt(domains.factor[d] * weight) * rotation
    for c in range(domains.start[d], domains.start[d + 1]):
        g = domains.gradient[c]
        turned = turn @ g
        strained.force[c] = -(stress @ g)
        strained.gradient[c] = vec4(turned[0], turned[1], turned[2], 0.0)


@func
def strain_by_stretches(d: ti.i32, deformation: mat3, rate: mat3, rotation: mat3, domains: Domains, strained: Strained):
    """Forces and responses of a domain under a law in its principal stretches.

    With F = R U, and U1 and R1 those of F + h dF/dt, it is linearised where it would be turned but not strained, at
    R1 U: the stretches grow by U1 - U, which is zero for any rigid motion of the step.
    """
    ahead = deformation + domains.undamped[d] * domains.lag[d] * rate
    turned = polar_rotation(ahead)
    stretch = rotation.transpose() @ deformation
    stretches, right = symmetric_eigen(0.5 * (stretch + stretch.transpose()))
    left = turned @ right
    growth = turned.transpose() @ ahead - stretch
    growth = 0.5 * (right.transpose() @ (growth + growth.transpose()) @ right)
    shape, dilation = domains.volume[d, SHAPE], domains.volume[d, DILATION]
    slope, flip, twist = vec3(0.0), vec3(0.0), vec3(0.0)
    hessian = ti.Matrix.zero(ti.f64, 3, 3)
    if domains.law[d] == OGDEN:
        slope, hessian, flip, twist = ogden_law(d, domains.modulus, domains.exponent, shape, dilation, stretches)
    else:
        slope, hessian, flip, twist = polynomial_law(d, domains.modulus, shape, dilation, stretches)
    # The slope of the Kirchhoff stress by the rate of strain, in axes that turn with the body (Jaumann's rate): damping
    # that holds nothing that turns, and in which pressures cancel.
    viscosity = ti.max(flip + twist, 0.0)
    viscous_hessian = hessian
    for i in ti.static(range(3)):
        square = ti.max(stretches[i] * stretches[i], SMALLEST_STRETCH * SMALLEST_STRETCH)
        viscous_hessian[i, i] += slope[i] * stretches[i] / square
    viscous_hessian = positive_part(viscous_hessian)
    hessian = positive_part(hessian)
    flip, twist = ti.max(flip, 0.0), ti.max(twist, 0.0)
    same, swapped = 0.5 * (flip + twist), 0.5 * (flip - twist)  # C_ik,ik and C_ik,ki of two axes
    # In two axes it is viscosity a a^T with a along the stretches: a rotation is across.
    along = ti.Matrix.zero(ti.f64, 3, 3)
    for i in ti.static(range(3)):
        for k in ti.static(range(3)):
            if ti.static(i != k):
                squares = stretches[i] * stretches[i] + stretches[k] * stretches[k]
                along[i, k] = stretches[i] / ti.sqrt(squares + TINY)
    damping = (1.0 - domains.undamped[d]) / domains.undamped[d]
    stress = ti.Matrix.zero(ti.f64, 3, 3)
    for i in ti.static(range(3)):
        j, k = ti.static((i + 1) % 3), ti.static((i + 2) % 3)
        stress[i, i] = slope[i]
        for m in ti.static(range(3)):
            stress[i, i] += (hessian[i, m] + damping * viscous_hessian[i, m]) * growth[m, m]
        both = damping * viscosity[i] * (along[j, k] + along[k, j])
        stress[j, k] = (flip[i] + both * along[j, k]) * growth[j, k]
        stress[k, j] = (flip[i] + both * along[k, j]) * growth[j, k]
    stress = left @ stress @ right.transpose()
    elastic = domains.undamped[d] * domains.factor[d]
    viscous = domains.factor[d] - elastic
    hessian = elastic * hessian + viscous * viscous_hessian
    same, swapped, viscosity = elastic * same, elastic * swapped, viscous * viscosity
    for c in range(domains.start[d], domains.start[d + 1]):
        strained.force[c] = -(stress @ domains.gradient[c])
        g = right.transpose() @ domains.gradient[c]
        strained.gradient[c] = vec4(g[0], g[1], g[2], 0.0)
        last = vec4(0.0)
        for k in ti.static(range(3)):
            part = ti.Matrix.zero(ti.f64, 3, 3)
            for m in ti.static(range(3)):
                part[k, m] = hessian[k, m] * g[m]
            for turn in ti.static(range(2)):
                i, j = ti.static((k + 1 + turn) % 3), ti.static((k + 2 - turn) % 3)
                part[i, i] = (same[j] + viscosity[j] * along[i, k] * along[i, k]) * g[k]
                part[i, k] = (swapped[j] + viscosity[j] * along[i, k] * along[k, i]) * g[i]
            part = left @ part @ left.transpose()
            strained.response[3 * c + k] = vec8(
                part[0, 0], part[0, 1], part[0, 2], part[1, 0], part[1, 1], part[1, 2], part[2, 0], part[2, 1]
            )
            last[k] = part[2, 2]
        strained.last_response[c] = last


@func
def strain_domain(d: ti.i32, domains: Domains, strained: Strained):
    """A domain's forces on its nodes, and how they respond to motions."""
    first = domains.start[d]
    x0, v0 = strained.position[domains.node[first]], strained.velocity[domains.node[first]]
    deformation, rate = ti.Matrix.zero(ti.f64, 3, 3), ti.Matrix.zero(ti.f64, 3, 3)
    for c in range(first + 1, domains.start[d + 1]):
        g = domains.gradient[c]
        deformation += (strained.position[domains.node[c]] - x0).outer_product(g)
        rate += (strained.velocity[domains.node[c]] - v0).outer_product(g)
    rotation = polar_rotation(deformation)
    if domains.law[d] == HOOKE:
        strain_by_hooke(d, deformation, rate, rotation, domains, strained)
    else:
        strain_by_stretches(d, deformation, rate, rotation, domains, strained)


@func
def gather_hooke(b: ti.i32, strained: Strained, parts: DomainParts) -> mat3:
    """A block's stiffness from domains under Hooke's law.

    With H_a = sqrt(w mu factor) R g_a and M = sum H_a H_b^T it is sum (lambda / mu) H_a H_b^T + M^T + tr(M) I.
    """
    # The columns of M, and of what is proportional to lambda.
    m0, m1, m2, l0, l1, l2 = vec4(0.0), vec4(0.0), vec4(0.0), vec4(0.0), vec4(0.0), vec4(0.0)
    for c in range(parts.start[3 * b + SHAPED], parts.start[3 * b + DILATED]):
        row, other = strained.gradient[parts.row_entry[c]], strained.gradient[parts.column_entry[c]]
        p0, p1, p2 = other[0] * row, other[1] * row, other[2] * row
        m0 += p0
        m1 += p1
        m2 += p2
        l0 += parts.lame_ratio[c] * p0
        l1 += parts.lame_ratio[c] * p1
        l2 += parts.lame_ratio[c] * p2
    for c in range(parts.start[3 * b + DILATED], parts.start[3 * b + RESPONDING]):
        row, other = strained.gradient[parts.row_entry[c]], strained.gradient[parts.column_entry[c]]
        l0 += other[0] * row
        l1 += other[1] * row
        l2 += other[2] * row
    trace = m0[0] + m1[1] + m2[2]
    return ti.Matrix(
        [
            [l0[0] + m0[0] + trace, l1[0] + m0[1], l2[0] + m0[2]],
            [l0[1] + m1[0], l1[1] + m1[1] + trace, l2[1] + m1[2]],
            [l0[2] + m2[0], l1[2] + m2[1], l2[2] + m2[2] + trace],
        ]
    )


@func
def gather_responses(b: ti.i32, strained: Strained, parts: DomainParts) -> mat3:
    """A block's stiffness from domains under other laws."""
    total, last = vec8(0.0), 0.0
    for c in range(parts.start[3 * b + RESPONDING], parts.start[3 * b + 3]):
        g, place = strained.gradient[parts.row_entry[c]], parts.column_entry[c]
        beside = strained.last_response[place]
        for k in ti.static(range(3)):
            total += g[k] * strained.response[3 * place + k]
            last += g[k] * beside[k]
    return ti.Matrix([[total[0], total[1], total[2]], [total[3], total[4], total[5]], [total[6], total[7], last]])


@func
def gather_block(b: ti.i32, strained: Strained, parts: DomainParts, sums: DomainSums):
    """Add to a block of the matrix, and on the diagonal to the node's force, what the domains of its nodes give."""
    total = gather_hooke(b, strained, parts) + gather_responses(b, strained, parts)
    sums.blocks[parts.block[b]] = sums.blocks[parts.block[b]] + total
    node = parts.node[b]
    if node >= 0:
        force = sums.force[node]
        for c in range(parts.start[3 * b], parts.start[3 * b + 3]):
            force += strained.force[parts.row_entry[c]]
        sums.force[node] = force


@kernel
def add_domains(domains: Domains, strained: Strained, parts: DomainParts, sums: DomainSums):
    """Add the domains' nodal forces f - lag K v, and K times its factor, to forces and matrix.

    Each thread takes the next task until none is left; blocks, which gather their parts in a fixed order, wait for all
    domains.
    """
    domain_count, block_count = domains.law.shape[0], parts.block.shape[0]
    domain_tasks = (domain_count + DOMAINS_A_TASK - 1) // DOMAINS_A_TASK
    block_tasks = (block_count + BLOCKS_A_TASK - 1) // BLOCKS_A_TASK
    for worker in range(THREADS * CHUNK):
        if worker % CHUNK == 0:
            t = ti.atomic_add(sums.progress[NEXT_TASK], 1)
            while t < domain_tasks:
                for d in range(t * DOMAINS_A_TASK, ti.min((t + 1) * DOMAINS_A_TASK, domain_count)):
                    strain_domain(d, domains, strained)
                ti.atomic_add(sums.progress[DOMAINS_DONE], 1)
                t = ti.atomic_add(sums.progress[NEXT_TASK], 1)
            while ti.atomic_max(sums.progress[DOMAINS_DONE], 0) < domain_tasks:  # a load that nothing may move
                pass
            while t < domain_tasks + block_tasks:
                first = (t - domain_tasks) * BLOCKS_A_TASK
                for b in range(first, ti.min(first + BLOCKS_A_TASK, block_count)):
                    gather_block(b, strained, parts, sums)
                t = ti.atomic_add(sums.progress[NEXT_TASK], 1)
