"""The layout of sums over integration domains: groups of neighbouring domains, and the blocks that each adds to.

A domain of many nodes adds to as many blocks as it has pairs of them. Each group keeps its own copies of the blocks,
few enough to stay in the cache while its domains add to them; the copies are summed afterwards. Groups do not depend on
the number of threads, and so neither does any sum. The domains are numbered group by group, so that what is read of
them comes from memory as a stream.
"""

import numpy as np

from taichisoft.bodies.domains import IntegrationDomains
from taichisoft.bodies.hooke_parts import find_blocks, node_of_block
from taichisoft.bodies.kernels.rubber_domains import BlockCopies, DomainGroups

DOMAINS_A_GROUP = 256
# Cells along an axis of the curve: 2^CURVE_BITS.
CURVE_BITS = 10


def group_domains(domains: IntegrationDomains, block_pairs: np.ndarray) -> tuple[DomainGroups, BlockCopies]:
    """The groups, and which of their slots make up which blocks.

    Args:
        domains: in an order in which neighbours follow each other.
        block_pairs: the two nodes (row, column) of each block of the matrix, shape (block_count, 2); of two blocks that
            are each other's transpose one is stored.
    """
    domain_count, entry_count = len(domains.start) - 1, len(domains.node)
    group = np.arange(domain_count, dtype=np.int64) // DOMAINS_A_GROUP
    row, column = domains.node_pairs()
    block = find_blocks(block_pairs, domains.node[row], domains.node[column])
    row, column, block = row[block >= 0], column[block >= 0], block[block >= 0]
    by_column = np.lexsort((row, row != column, column))
    row, column, block = row[by_column], column[by_column], block[by_column]
    domain = np.repeat(np.arange(domain_count), np.diff(domains.start))[column]
    slots, slot = np.unique(group[domain] * len(block_pairs) + block, return_inverse=True)
    group_of_slot, block_of_slot = np.divmod(slots, len(block_pairs))
    group_count = -(-domain_count // DOMAINS_A_GROUP)
    groups = DomainGroups(
        start=np.minimum(np.arange(group_count + 1) * DOMAINS_A_GROUP, domain_count).astype(np.int32),
        first_slot=np.searchsorted(group_of_slot, np.arange(group_count + 1)).astype(np.int32),
        first_part=np.searchsorted(column, np.arange(entry_count + 1)).astype(np.int32),
        row=(row - domains.start[domain]).astype(np.int32),
        slot=slot.reshape(-1).astype(np.int32),
    )
    by_block = np.argsort(block_of_slot, kind="stable")
    blocks, start = np.unique(block_of_slot[by_block], return_index=True)
    copies = BlockCopies(
        block=blocks.astype(np.int32),
        start=np.append(start, len(by_block)).astype(np.int32),
        slot=by_block.astype(np.int32),
        node=node_of_block(block_pairs[blocks]),
    )
    return groups, copies


def along_curve(points: np.ndarray) -> np.ndarray:
    """An order in which neighbours mostly follow each other, that of Morton's curve; points of shape (count, 3)."""
    low = points.min(axis=0)
    size = max(float((points.max(axis=0) - low).max()), np.finfo(float).tiny)
    cells = np.minimum((points - low) / size * 2**CURVE_BITS, 2**CURVE_BITS - 1).astype(np.int64)
    place = np.zeros(len(points), dtype=np.int64)
    for bit in range(CURVE_BITS):
        place += ((cells >> bit & 1) << 3 * bit) @ [1, 2, 4]
    return np.argsort(place, kind="stable")
