"""Integration domains: the pieces of a body that have one deformation gradient each.

An element has one at each of its quadrature points. Smoothed tetrahedra have two sets (Liu and Nguyen-Thoi 2010,
Smoothed Finite Element Methods): one around every edge, for the energy of shape, and one around every node, for that of
volume. The first bend as they should, where a tetrahedron on its own is too stiff; the second keep volume without
locking, since there are fewer of them than motions of the nodes.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from taichisoft.bodies.elements import linear_tetrahedra, quadratic_tetrahedra
from taichisoft.meshes.ten_nodes import SIDES


@dataclass(frozen=True)
class IntegrationDomains:
    """Domains of variable size; an entry is a node of a domain.

    Attributes:
        start: where each domain's entries begin, shape (domain_count + 1,).
        node: of each entry, shape (entry_count,).
        gradient: g of each entry at rest [1/mm], so that F = sum x_a g_a^T, shape (entry_count, 3).
        volume: for which the energies of shape and of volume count [mm^3], shape (domain_count, 2).
        element: one element of each domain, which has its material, shape (domain_count,).
    """

    start: np.ndarray
    node: np.ndarray
    gradient: np.ndarray
    volume: np.ndarray
    element: np.ndarray

    @classmethod
    def joined(cls, parts: Sequence["IntegrationDomains"]) -> "IntegrationDomains":
        """Several sets of domains, whose nodes and elements are numbered alike, one after the other."""
        first_entry = np.cumsum([0, *(len(part.node) for part in parts)])
        starts = [part.start[:-1] + first for part, first in zip(parts, first_entry[:-1], strict=True)]
        return cls(
            start=np.concatenate([*starts, first_entry[-1:]]).astype(np.int32),
            node=np.concatenate([part.node for part in parts]),
            gradient=np.concatenate([part.gradient for part in parts]),
            volume=np.concatenate([part.volume for part in parts]),
            element=np.concatenate([part.element for part in parts]),
        )

    def of(self, numbers: np.ndarray) -> "IntegrationDomains":
        """The domains of these numbers, in this order."""
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


def quadrature_domains(nodes: np.ndarray, elements: np.ndarray) -> IntegrationDomains:
    """The quadrature points of linear or quadratic tetrahedra.

    Args:
        nodes: at rest [mm], shape (node_count, 3).
        elements: node indices, shape (element_count, 4) or (element_count, 10).
    """
    make = quadratic_tetrahedra if elements.shape[1] == 10 else linear_tetrahedra
    gradient, volume = make(nodes, elements)
    element_count, point_count, nodes_per_element, _ = gradient.shape
    return IntegrationDomains(
        start=np.arange(element_count * point_count + 1, dtype=np.int32) * np.int32(nodes_per_element),
        node=np.repeat(elements, point_count, axis=0).reshape(-1).astype(np.int32),
        gradient=gradient.reshape(-1, 3),
        volume=np.repeat(volume.reshape(-1, 1), 2, axis=1),
        element=np.repeat(np.arange(element_count), point_count),
    )


def smoothed_domains(nodes: np.ndarray, elements: np.ndarray, material: np.ndarray) -> IntegrationDomains:
    """Domains around the edges, for shape, and around the nodes, for volume, of linear tetrahedra.

    A domain around an edge has a sixth of each element at it, one around a node a quarter, and none has two materials.

    Args:
        nodes: at rest [mm], shape (node_count, 3).
        elements: node indices, shape (element_count, 4).
        material: number of the material of each element, shape (element_count,).
    """
    edges, corners = _edges_and_corners(elements, len(nodes))
    around_edges = _smoothed(nodes, elements, material, edges, np.array([1.0, 0.0]))
    around_nodes = _smoothed(nodes, elements, material, corners, np.array([0.0, 1.0]))
    return IntegrationDomains.joined([around_edges, around_nodes])


def domains_of_elements(elements: np.ndarray, node_count: int, material: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which of the domains of `smoothed_domains` each element is a part of.

    Args:
        elements, material: as in `smoothed_domains`.
        node_count: number of the nodes.

    Returns:
        Numbers of the domains around its edges, shape (element_count, 6), and around its nodes, (element_count, 4).
    """
    edges, nodes = (_numbered(owners, material)[1] for owners in _edges_and_corners(elements, node_count))
    return edges, nodes + edges.max() + 1


def _edges_and_corners(elements: np.ndarray, node_count: int) -> tuple[np.ndarray, np.ndarray]:
    """A number of each edge of each element, shape (element_count, 6), and of each corner, (element_count, 4)."""
    edges = np.sort(elements[:, SIDES], axis=2).astype(np.int64) @ [node_count, 1]
    return edges, elements.astype(np.int64)


def _numbered(owners: np.ndarray, material: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Number what shares an owner and a material: where each number occurs first in the flat list, and the numbers in
    the shape of `owners`."""
    keys = np.column_stack([owners.reshape(-1), np.repeat(material, owners.shape[1])])
    _, first, domain = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    return first, domain.reshape(owners.shape)


def _smoothed(
    nodes: np.ndarray, elements: np.ndarray, material: np.ndarray, owners: np.ndarray, counts_for: np.ndarray
) -> IntegrationDomains:
    """Domains of the elements that share an owner, each giving equal parts to all of its own.

    Args:
        nodes, elements, material: as in `smoothed_domains`.
        owners: numbers of the owners of each element, shape (element_count, owners_per_element).
        counts_for: shares of a domain's volume for the energies of shape and of volume, shape (2,).
    """
    gradient, volume = linear_tetrahedra(nodes, elements)
    owners_per_element = owners.shape[1]
    first, domain = _numbered(owners, material)
    domain = domain.reshape(-1)
    element = np.repeat(np.arange(len(elements)), owners_per_element)
    part = volume[element, 0] / owners_per_element
    domain_volume = np.bincount(domain, part)
    # Each part brings the gradients of its element's four nodes, which are added up for each node of the domain.
    share = (part / domain_volume[domain])[:, None, None] * gradient[element, 0]
    entry_keys, entry = np.unique(
        (domain[:, None] * len(nodes) + elements[element].astype(np.int64)).reshape(-1), return_inverse=True
    )
    entry, share = entry.reshape(-1), share.reshape(-1, 3)
    domain_of_entry, node = np.divmod(entry_keys, len(nodes))
    return IntegrationDomains(
        start=np.searchsorted(domain_of_entry, np.arange(len(domain_volume) + 1)).astype(np.int32),
        node=node.astype(np.int32),
        gradient=np.column_stack([np.bincount(entry, share[:, d], len(entry_keys)) for d in range(3)]),
        volume=domain_volume[:, None] * counts_for,
        element=element[first],
    )
