"""Integration domains: the pieces of a body that have one deformation gradient each, such as the quadrature points of
elements. `element_kinds.py` has the domains of each kind of element.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from taichisoft.mechanics.elastic_laws import find_blocks, joined_arrays, node_of_block
from taichisoft.mechanics.kernels.rubber_domains import BlockCopies, DomainGroups


@dataclass(frozen=True)
class IntegrationDomains:
    """Domains of variable size; an entry is a node of a domain.

    Attributes:
        start: the first entry of each domain, shape (domain_count + 1,).
        node: of each entry, shape (entry_count,).
        gradient: g of each entry at rest [1/mm], so that F = sum x_a g_a^T, shape (entry_count, 3).
        volume: for which the energies of shape and of volume count [mm^3], shape (domain_count, 2).
        element: one element of each domain, for its material, shape (domain_count,).
    """

    start: np.ndarray
    node: np.ndarray
    gradient: np.ndarray
    volume: np.ndarray
    element: np.ndarray

    @classmethod
    def joined(cls, parts: Sequence["IntegrationDomains"]) -> "IntegrationDomains":
        """Several sets of domains one after the other; they share the numbering of nodes and elements."""
        return cls(**joined_arrays(parts))

    def select(self, numbers: np.ndarray) -> "IntegrationDomains":
        """The domains with these numbers, in this order."""
        sizes = np.diff(self.start)[numbers]
        start = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int32)
        entries = np.arange(start[-1]) + np.repeat(self.start[numbers] - start[:-1], sizes)
        return IntegrationDomains(
            start=start,
            node=self.node[entries],
            gradient=self.gradient[entries],
            volume=self.volume[numbers],
            element=self.element[numbers],
        )

    def deformation(self, position: np.ndarray) -> np.ndarray:
        """The deformation gradient of each domain, shape (domain_count, 3, 3), at positions [mm] (node_count, 3)."""
        products = position[self.node][:, :, None] * self.gradient[:, None, :]
        gradients: np.ndarray = np.add.reduceat(products, self.start[:-1])
        return gradients

    def centres(self, position: np.ndarray) -> np.ndarray:
        """The mean of each domain's nodes, shape (domain_count, 3), at positions [mm] (node_count, 3)."""
        sums: np.ndarray = np.add.reduceat(position[self.node], self.start[:-1])
        return sums / np.diff(self.start)[:, None]

    def node_pairs(self) -> tuple[np.ndarray, np.ndarray]:
        """Entries of every ordered pair of nodes of one domain, in the order of the domains; two arrays."""
        size = np.diff(self.start).astype(np.int64)
        size_of_entry = np.repeat(size, size)
        row = np.repeat(np.arange(len(self.node)), size_of_entry)
        within = np.arange(len(row)) - np.repeat(np.cumsum(size_of_entry) - size_of_entry, size_of_entry)
        return row, np.repeat(np.repeat(self.start[:-1], size), size_of_entry) + within


def quadrature_domains(elements: np.ndarray, gradient: np.ndarray, volume: np.ndarray) -> IntegrationDomains:
    """The quadrature points of elements, with gradients and volumes as those of `element_kinds.py`."""
    element_count, point_count, nodes_per_element, _ = gradient.shape
    return IntegrationDomains(
        start=np.arange(element_count * point_count + 1, dtype=np.int32) * np.int32(nodes_per_element),
        node=np.repeat(elements, point_count, axis=0).reshape(-1).astype(np.int32),
        gradient=gradient.reshape(-1, 3),
        volume=np.repeat(volume.reshape(-1, 1), 2, axis=1),
        element=np.repeat(np.arange(element_count), point_count),
    )


# The layout of sums over integration domains: groups of neighbouring domains, and the blocks that each adds to.
#
# A domain of many nodes adds to as many blocks as it has pairs of them. Each group keeps its own copies of the blocks,
# few enough to stay in the cache while its domains add to them; the copies are summed afterwards. Groups do not depend
# on the number of threads, and so neither does any sum. The domains are numbered group by group, so that what is read
# of them comes from memory as a stream.

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
