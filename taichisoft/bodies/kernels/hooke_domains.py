"""Integration domains under Hooke's law: forces, and the system matrix by gathering (`hooke_blocks.py`)."""

from taichisoft.bodies.kernels.domain_deformation import (
    DILATION,
    SHAPE,
    Domains,
    DomainSums,
    Movement,
    deformation_and_rate,
)
from taichisoft.bodies.kernels.hooke_blocks import BlockParts, HookeEntries, gathered_force, gathered_stiffness, vec4
from taichisoft.bodies.kernels.polar_rotation import polar_rotation
from taichisoft.bodies.kernels.principal_stretches import LAMBDA, MU
from taichisoft.runtime.language import CHUNK, Integers, func, mat3, ti
from taichisoft.runtime.launch import kernel
from taichisoft.runtime.waiting import BEGUN, BEGUN_LATER, FINISHED, PATIENCE, reaches

# What a thread does in one go.
DOMAINS_A_TASK = 32
BLOCKS_A_TASK = 128


@func
def corotated_stress(d: ti.i32, deformation: mat3, rate: mat3, domains: Domains):
    """Rotation of a domain, and its stress w P, with `lag` times what it changes by at this rate."""
    rotation, unit = polar_rotation(deformation), ti.Matrix.identity(ti.f64, 3)
    first = domains.volume[d, DILATION] * domains.modulus[d, LAMBDA]
    second = domains.volume[d, SHAPE] * domains.modulus[d, MU]
    strain = rotation.transpose() @ (deformation + domains.lag[d] * rate) - unit
    return rotation, rotation @ (first * strain.trace() * unit + second * (strain + strain.transpose()))


@func
def strain_domain(d: ti.i32, domains: Domains, movement: Movement, entries: HookeEntries):
    """Forces and turned gradients of a domain."""
    deformation, rate = deformation_and_rate(d, domains, movement)
    rotation, stress = corotated_stress(d, deformation, rate, domains)
    weight = domains.volume[d, SHAPE] * domains.modulus[d, MU]
    if domains.volume[d, SHAPE] == 0.0:
        weight = domains.volume[d, DILATION] * domains.modulus[d, LAMBDA]
    turn = ti.sqrt(domains.factor[d] * weight) * rotation
    for c in range(domains.start[d], domains.start[d + 1]):
        g = domains.gradient[c]
        turned = turn @ g
        entries.force[c] = -(stress @ g)
        entries.gradient[c] = vec4(turned[0], turned[1], turned[2], 0.0)


@func
def add_block(b: ti.i32, block: Integers, entries: HookeEntries, parts: BlockParts, sums: DomainSums):
    """Add to a block of the matrix, and on the diagonal to the node's force, what the domains of its nodes give."""
    sums.blocks[block[b]] = sums.blocks[block[b]] + gathered_stiffness(b, entries, parts)
    node = parts.node[b]
    if node >= 0:
        sums.force[node] = sums.force[node] + gathered_force(b, entries, parts)


@kernel
def add_hooke_domains(
    domains: Domains,
    movement: Movement,
    block: Integers,
    entries: HookeEntries,
    parts: BlockParts,
    sums: DomainSums,
    workers: ti.i32,
):
    """Add the domains' nodal forces f - lag K v, and K times its factor, to forces and matrix.

    Number b of `parts` is number block[b] of the matrix. Each thread takes the next task until none is left; blocks,
    which gather their parts in a fixed order, wait for all domains.
    """
    domain_count, block_count = domains.lag.shape[0], block.shape[0]
    domain_tasks = (domain_count + DOMAINS_A_TASK - 1) // DOMAINS_A_TASK
    block_tasks = (block_count + BLOCKS_A_TASK - 1) // BLOCKS_A_TASK
    for worker in range(workers * CHUNK):
        if worker % CHUNK == 0:
            t = ti.atomic_add(sums.progress[BEGUN], 1)
            while t < domain_tasks:
                for d in range(t * DOMAINS_A_TASK, ti.min((t + 1) * DOMAINS_A_TASK, domain_count)):
                    strain_domain(d, domains, movement, entries)
                ti.atomic_add(sums.progress[FINISHED], 1)
                t = ti.atomic_add(sums.progress[BEGUN], 1)
            if reaches(sums.progress, FINISHED, domain_tasks, PATIENCE):
                t = ti.atomic_add(sums.progress[BEGUN_LATER], 1)
                while t < block_tasks:
                    for b in range(t * BLOCKS_A_TASK, ti.min((t + 1) * BLOCKS_A_TASK, block_count)):
                        add_block(b, block, entries, parts, sums)
                    t = ti.atomic_add(sums.progress[BEGUN_LATER], 1)
