"""Integration domains under laws of large strains: forces, and the system matrix by sums of neighbours.

A block of two nodes has twenty-seven numbers from each domain, too many to store for all of them and to gather: a group
of neighbouring domains adds to its own copies of the blocks, few enough to stay in the cache (`domains.py`).
"""

from typing import Any, NamedTuple

from taichisoft.mechanics.kernels.domain_deformation import (
    FIRST_STRETCH_LAW,
    Domains,
    DomainSums,
    Movement,
    deformation_and_rate,
    respond_by_invariants,
    respond_by_sums,
)
from taichisoft.mechanics.kernels.hooke_domains import Quads, polar_rotation, vec4
from taichisoft.runtime.arithmetic import (
    BEGUN,
    BEGUN_LATER,
    FINISHED,
    PATIENCE,
    TINY,
    positive_part,
    reaches,
    symmetric_eigen,
)
from taichisoft.runtime.language import CHUNK, Arrays, Integers, func, mat3, ti, vec3
from taichisoft.runtime.launch import kernel
from taichisoft.runtime.rubber_laws import SMALLEST_STRETCH

# How many blocks a thread sums in one go.
BLOCKS_A_TASK = 512
# Rows of a thread's work space: nine of a tangent, three of the response to one node.
ROWS = 12

vec8 = ti.types.vector(8, ti.f64)
Octets: Any = Arrays(vec8, 1)


class DomainGroups(NamedTuple):
    """Groups of neighbouring domains with sums of their own; a slot is the copy of a block of the matrix in a group.

    Attributes:
        start: where each group's domains begin, shape (group_count + 1,).
        first_slot: where each group's slots begin, shape (group_count + 1,).
        first_part: where the parts of each entry begin in the lists that follow, shape (entry_count + 1,). They are the
            blocks in whose column the entry stands; its diagonal block is the first.
        row: entry of the block's row, counted from the domain's first.
        slot: of the block.
    """

    start: Integers
    first_slot: Integers
    first_part: Integers
    row: Integers
    slot: Integers


class GroupSums(NamedTuple):
    """Work space of the groups; rows of 4 and 8 numbers are vectors of the processor.

    Attributes:
        block: all of a slot's block but the last number, row by row, shape (slot_count, 8).
        rest: that number, and in a slot on the diagonal the node's force [mN], shape (slot_count, 4).
        tangent: of the domain at hand w (h^2 C + h b D)_ik,jl, nine rows a thread for kl = 00, 01, ..., with all ij but
            the last, shape (9 threads, 8).
        last_tangent: the last ij, three rows a thread for l, each with all k, shape (3 threads, 4).
        gradient: of the domain's entries along the axes k of the tangent, shape (threads, most entries, 4), flat.
    """

    block: Octets
    rest: Quads
    tangent: Octets
    last_tangent: Quads
    gradient: Quads


class BlockCopies(NamedTuple):
    """The slots that make up each block of the system matrix to which domains add.

    Attributes:
        block: its number in the matrix, shape (count,).
        start: the first slot of each block in the list that follows, shape (count + 1,).
        slot: in the order of the groups.
        node: of a block on the diagonal, -1 for others, shape (count,).
    """

    block: Integers
    start: Integers
    slot: Integers
    node: Integers


@func
def column(matrix: mat3, k: ti.template()) -> vec3:
    """A column of a matrix."""
    return vec3(matrix[0, k], matrix[1, k], matrix[2, k])


@func
def stiffness_by_stretches(d: ti.i32, stretches: vec3, domains: Domains):
    """Slope of a domain's energy by the stretches, and stiffness along their axes without negative eigenvalues.

    Returns:
        Slope, Hessian, that of damping; of pairs of axes at the number of the third one flip, twist and share of the
        viscosity.
    """
    slope, flip, twist = vec3(0.0), vec3(0.0), vec3(0.0)
    hessian = ti.Matrix.zero(ti.f64, 3, 3)
    if domains.law[d] >= FIRST_STRETCH_LAW:
        slope, hessian, flip, twist = respond_by_sums(d, domains, stretches)
    else:
        slope, hessian, flip, twist = respond_by_invariants(d, domains, stretches)
    # The slope of the Kirchhoff stress by the rate of strain, in axes that turn with the body (Jaumann's rate): this
    # damping does not resist rotations, and pressures cancel in it.
    viscosity = ti.max(flip + twist, 0.0)
    viscous_hessian = hessian
    for i in ti.static(range(3)):
        square = ti.max(stretches[i] * stretches[i], SMALLEST_STRETCH * SMALLEST_STRETCH)
        viscous_hessian[i, i] += slope[i] * stretches[i] / square
    viscous_hessian = positive_part(viscous_hessian)
    hessian = positive_part(hessian)
    flip, twist = ti.max(flip, 0.0), ti.max(twist, 0.0)
    # In two axes it is viscosity a a^T with a along the stretches: a rotation is across.
    squares = stretches * stretches
    share = vec3(0.0)
    for i in ti.static(range(3)):
        share[i] = viscosity[i] / (squares[(i + 1) % 3] + squares[(i + 2) % 3] + TINY)
    return slope, hessian, viscous_hessian, flip, twist, share


@func
def tangent_of_pairs(stretches: vec3, flip: vec3, twist: vec3, share: vec3, elastic: ti.f64, viscous: ti.f64):
    """Of ik,ik in a matrix, and of ik,ki at the number of the third axis, by the weights of stiffness and viscosity."""
    squares = stretches * stretches
    same, swapped = ti.Matrix.zero(ti.f64, 3, 3), vec3(0.0)
    for j in ti.static(range(3)):
        i, k = ti.static((j + 1) % 3), ti.static((j + 2) % 3)
        even = 0.5 * elastic * (flip[j] + twist[j])
        same[i, k] = even + viscous * share[j] * squares[i]
        same[k, i] = even + viscous * share[j] * squares[k]
        swapped[j] = 0.5 * elastic * (flip[j] - twist[j]) + viscous * share[j] * stretches[i] * stretches[k]
    return same, swapped


@func
def respond_by_stretches(d: ti.i32, deformation: mat3, rate: mat3, domains: Domains):
    """Stress, and tangent along the axes of the principal stretches, of a domain.

    With F = R U, and F + h dF/dt = R1 U1, the law is linearised where it would be turned but not strained, at
    R1 U: the stretches grow by U1 - U, which is zero for any rigid motion of the step.

    Returns:
        w P, left and right axes, and along them w (h^2 C + h b D): of ii,jj in a matrix, of ik,ik in another, and of
        ik,ki at the number of the third axis.
    """
    ahead = deformation + domains.undamped[d] * domains.lag[d] * rate
    turned = polar_rotation(ahead)
    stretch = polar_rotation(deformation).transpose() @ deformation
    stretches, right = symmetric_eigen(0.5 * (stretch + stretch.transpose()))
    left = turned @ right
    growth = turned.transpose() @ ahead - stretch
    growth = 0.5 * (right.transpose() @ (growth + growth.transpose()) @ right)
    slope, hessian, viscous_hessian, flip, twist, share = stiffness_by_stretches(d, stretches, domains)
    damping = (1.0 - domains.undamped[d]) / domains.undamped[d]
    stress = ti.Matrix.zero(ti.f64, 3, 3)
    for i in ti.static(range(3)):
        j, k = ti.static((i + 1) % 3), ti.static((i + 2) % 3)
        stress[i, i] = slope[i]
        for m in ti.static(range(3)):
            stress[i, i] += (hessian[i, m] + damping * viscous_hessian[i, m]) * growth[m, m]
        both = damping * share[i] * (stretches[j] + stretches[k])
        stress[j, k] = (flip[i] + both * stretches[j]) * growth[j, k]
        stress[k, j] = (flip[i] + both * stretches[k]) * growth[j, k]
    stress = left @ stress @ right.transpose()
    elastic = domains.undamped[d] * domains.factor[d]
    viscous = domains.factor[d] - elastic
    same, swapped = tangent_of_pairs(stretches, flip, twist, share, elastic, viscous)
    return stress, left, right, elastic * hessian + viscous * viscous_hessian, same, swapped


@func
def set_tangent(worker: ti.i32, left: mat3, hessian: mat3, same: mat3, swapped: vec3, sums: GroupSums):
    """Turn the forces of a tangent, given along left and right axes, to the axes of space."""
    last = ti.Matrix.zero(ti.f64, 3, 3)
    for k in ti.static(range(3)):
        i, j = ti.static((k + 1) % 3), ti.static((k + 2) % 3)
        u, v, w = column(left, k), column(left, i), column(left, j)
        alone = hessian[k, k] * u.outer_product(u) + same[i, k] * v.outer_product(v) + same[j, k] * w.outer_product(w)
        last[k, k] = alone[2, 2]
        sums.tangent[ROWS * worker + 4 * k] = all_but_last(alone)
        product = u.outer_product(v)
        mixed = hessian[k, i] * product + swapped[j] * product.transpose()
        last[k, i], last[i, k] = mixed[2, 2], mixed[2, 2]
        sums.tangent[ROWS * worker + 3 * k + i] = all_but_last(mixed)
        sums.tangent[ROWS * worker + 3 * i + k] = all_but_last(mixed.transpose())
    for k in ti.static(range(3)):
        sums.last_tangent[3 * worker + k] = vec4(last[0, k], last[1, k], last[2, k], 0.0)


@func
def all_but_last(matrix: mat3) -> vec8:
    """The entries of a matrix row by row, without the last."""
    return vec8(
        matrix[0, 0], matrix[0, 1], matrix[0, 2], matrix[1, 0], matrix[1, 1], matrix[1, 2], matrix[2, 0], matrix[2, 1]
    )


@func
def add_domain(d: ti.i32, worker: ti.i32, domains: Domains, movement: Movement, groups: DomainGroups, sums: GroupSums):
    """Add a domain's forces on its nodes, and how they respond to motions, to the slots of its group."""
    first, last = domains.start[d], domains.start[d + 1]
    deformation, rate = deformation_and_rate(d, domains, movement)
    stress, left, right, hessian, same, swapped = respond_by_stretches(d, deformation, rate, domains)
    set_tangent(worker, left, hessian, same, swapped, sums)
    response = ROWS * worker + 9
    own = worker * (sums.gradient.shape[0] // (sums.tangent.shape[0] // ROWS))
    for c in range(first, last):
        g = domains.gradient[c]
        along = right.transpose() @ g
        sums.gradient[own + c - first] = vec4(along[0], along[1], along[2], 0.0)
        force, slot = stress @ g, groups.slot[groups.first_part[c]]
        sums.rest[slot] = sums.rest[slot] - vec4(0.0, force[0], force[1], force[2])
    for c in range(first, last):
        g = sums.gradient[own + c - first]
        last_response = vec4(0.0)
        for k in ti.static(range(3)):
            last_response += g[k] * sums.last_tangent[3 * worker + k]
            tangent = ROWS * worker + 3 * k
            sums.tangent[response + k] = (
                g[0] * sums.tangent[tangent] + g[1] * sums.tangent[tangent + 1] + g[2] * sums.tangent[tangent + 2]
            )
        for p in range(groups.first_part[c], groups.first_part[c + 1]):
            row, slot = sums.gradient[own + groups.row[p]], groups.slot[p]
            sums.block[slot] = sums.block[slot] + (
                row[0] * sums.tangent[response]
                + row[1] * sums.tangent[response + 1]
                + row[2] * sums.tangent[response + 2]
            )
            sums.rest[slot][0] = sums.rest[slot][0] + row.dot(last_response)


@func
def add_group(t: ti.i32, worker: ti.i32, domains: Domains, movement: Movement, groups: DomainGroups, sums: GroupSums):
    """Sum the contributions of the domains of a group."""
    for slot in range(groups.first_slot[t], groups.first_slot[t + 1]):
        sums.block[slot] = vec8(0.0)
        sums.rest[slot] = vec4(0.0)
    for d in range(groups.start[t], groups.start[t + 1]):
        add_domain(d, worker, domains, movement, groups, sums)


@func
def add_copies(b: ti.i32, copies: BlockCopies, sums: GroupSums, total: DomainSums):
    """Add the sums of the groups to a block of the matrix, and on the diagonal to the node's force."""
    most, rest = vec8(0.0), vec4(0.0)
    for c in range(copies.start[b], copies.start[b + 1]):
        most += sums.block[copies.slot[c]]
        rest += sums.rest[copies.slot[c]]
    block = ti.Matrix([[most[0], most[1], most[2]], [most[3], most[4], most[5]], [most[6], most[7], rest[0]]])
    total.blocks[copies.block[b]] = total.blocks[copies.block[b]] + block
    node = copies.node[b]
    if node >= 0:
        total.force[node] = total.force[node] + vec3(rest[1], rest[2], rest[3])


@kernel
def add_rubber_domains(
    domains: Domains,
    movement: Movement,
    groups: DomainGroups,
    sums: GroupSums,
    copies: BlockCopies,
    total: DomainSums,
):
    """Add the domains' nodal forces f - lag K v, and K times its factor, to forces and matrix.

    Each thread takes the next task until none is left: a group, whose blocks stay in the cache while its domains add to
    them; then blocks, which sum their slots in a fixed order when all groups are done.
    """
    group_count, block_count = groups.start.shape[0] - 1, copies.block.shape[0]
    block_tasks = (block_count + BLOCKS_A_TASK - 1) // BLOCKS_A_TASK
    for worker in range(sums.tangent.shape[0] // ROWS * CHUNK):
        if worker % CHUNK == 0:
            t = ti.atomic_add(total.progress[BEGUN], 1)
            while t < group_count:
                add_group(t, worker // CHUNK, domains, movement, groups, sums)
                ti.atomic_add(total.progress[FINISHED], 1)
                t = ti.atomic_add(total.progress[BEGUN], 1)
            if reaches(total.progress, FINISHED, group_count, PATIENCE):
                t = ti.atomic_add(total.progress[BEGUN_LATER], 1)
                while t < block_tasks:
                    for b in range(t * BLOCKS_A_TASK, ti.min((t + 1) * BLOCKS_A_TASK, block_count)):
                        add_copies(b, copies, sums, total)
                    t = ti.atomic_add(total.progress[BEGUN_LATER], 1)


add_rubber_domains.thorough = True  # a third faster, for 10 s more to compile
