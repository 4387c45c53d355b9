"""Integration domains: the pieces of a body that have one deformation gradient each, such as the quadrature points of
elements. `element_kinds.py` has the domains of each kind of element."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


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
        first_entry = np.cumsum([0, *(len(part.node) for part in parts)])
        starts = [part.start[:-1] + first for part, first in zip(parts, first_entry[:-1], strict=True)]
        return cls(
            start=np.concatenate([*starts, first_entry[-1:]]).astype(np.int32),
            node=np.concatenate([part.node for part in parts]),
            gradient=np.concatenate([part.gradient for part in parts]),
            volume=np.concatenate([part.volume for part in parts]),
            element=np.concatenate([part.element for part in parts]),
        )

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
    """The quadrature points of elements.

    Args:
        elements: node indices, shape (element_count, nodes_per_element).
        gradient: of the shape functions at rest [1/mm], shape (element_count, point_count, nodes_per_element, 3).
        volume: that each quadrature point stands for [mm^3], shape (element_count, point_count).
    """
    element_count, point_count, nodes_per_element, _ = gradient.shape
    return IntegrationDomains(
        start=np.arange(element_count * point_count + 1, dtype=np.int32) * np.int32(nodes_per_element),
        node=np.repeat(elements, point_count, axis=0).reshape(-1).astype(np.int32),
        gradient=gradient.reshape(-1, 3),
        volume=np.repeat(volume.reshape(-1, 1), 2, axis=1),
        element=np.repeat(np.arange(element_count), point_count),
    )
