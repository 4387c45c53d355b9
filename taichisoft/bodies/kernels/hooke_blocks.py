"""Blocks of the system matrix under corotated Hooke's law, gathered from what each domain stores for its nodes.

With H_a = sqrt(w mu factor) R g_a for node a of a domain of volume w, and M = sum H_a H_b^T over the domains that
contain both nodes of a block, the block is
    sum (lambda / mu) H_a H_b^T + M^T + tr(M) I.
Domains of one lambda / mu stand together, so that their products are summed before they are multiplied by it.
"""

from typing import Any, NamedTuple

from taichisoft.runtime.language import Arrays, Integers, Scalars, Vectors, func, mat3, ti, vec3

vec4 = ti.types.vector(4, ti.f64)
Quads: Any = Arrays(vec4, 1)


class HookeEntries(NamedTuple):
    """What a step computes for each entry, a node of a domain.

    Attributes:
        force: of the domain on the node [mN], shape (entry_count, 3).
        gradient: H, in rows that are vectors of the processor, shape (entry_count, 4); with lambda for mu where only
            the energy of volume counts.
    """

    force: Vectors
    gradient: Quads


class BlockParts(NamedTuple):
    """Which entries make up which blocks.

    Attributes:
        run_start: where each block's runs begin, shape (block_count + 1,); the domains of a run are alike.
        start: where each run's parts begin in the lists that follow, shape (run_count + 1,).
        lame_ratio: of each run lambda / mu, 0 without energy of volume, 1 with nothing else, shape (run_count,).
        shaped: 1 where energy of shape counts, else 0, shape (run_count,).
        row, column: entries of the block's two nodes in a domain.
        node: that of a block on the diagonal, -1 for others, shape (block_count,).
    """

    run_start: Integers
    start: Integers
    lame_ratio: Scalars
    shaped: Scalars
    row: Integers
    column: Integers
    node: Integers


@func
def gathered_stiffness(b: ti.i32, entries: HookeEntries, parts: BlockParts) -> mat3:
    """A block's stiffness."""
    # The columns of M, and of what is proportional to lambda.
    m0, m1, m2, l0, l1, l2 = vec4(0.0), vec4(0.0), vec4(0.0), vec4(0.0), vec4(0.0), vec4(0.0)
    for r in range(parts.run_start[b], parts.run_start[b + 1]):
        p0, p1, p2 = vec4(0.0), vec4(0.0), vec4(0.0)
        for c in range(parts.start[r], parts.start[r + 1]):
            row, column = entries.gradient[parts.row[c]], entries.gradient[parts.column[c]]
            p0 += column[0] * row
            p1 += column[1] * row
            p2 += column[2] * row
        m0 += parts.shaped[r] * p0
        m1 += parts.shaped[r] * p1
        m2 += parts.shaped[r] * p2
        l0 += parts.lame_ratio[r] * p0
        l1 += parts.lame_ratio[r] * p1
        l2 += parts.lame_ratio[r] * p2
    trace = m0[0] + m1[1] + m2[2]
    return ti.Matrix(
        [
            [l0[0] + m0[0] + trace, l1[0] + m0[1], l2[0] + m0[2]],
            [l0[1] + m1[0], l1[1] + m1[1] + trace, l2[1] + m1[2]],
            [l0[2] + m2[0], l1[2] + m2[1], l2[2] + m2[2] + trace],
        ]
    )


@func
def gathered_force(b: ti.i32, entries: HookeEntries, parts: BlockParts) -> vec3:
    """The force on the node of a block on the diagonal."""
    force = vec3(0.0)
    for c in range(parts.start[parts.run_start[b]], parts.start[parts.run_start[b + 1]]):
        force += entries.force[parts.row[c]]
    return force
