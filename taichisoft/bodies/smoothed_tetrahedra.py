"""Integration domains of smoothed tetrahedra: two sets (Liu and Nguyen-Thoi 2010, Smoothed Finite Element Methods).

One set lies around the edges, for the energy of shape, and one around the nodes, for that of volume. The first bend as
they should, where a tetrahedron on its own is too stiff; the second keep volume without locking, since there are fewer
of them than motions of the nodes.
"""

import numpy as np

from taichisoft.bodies.domains import IntegrationDomains
from taichisoft.bodies.shape_functions import linear_tetrahedra
from taichisoft.meshes.ten_nodes import SIDES


def smoothed_domains(nodes: np.ndarray, elements: np.ndarray, material: np.ndarray) -> IntegrationDomains:
    """Domains around the edges, for shape, and around the nodes, for volume, of linear tetrahedra.

    A domain around an edge has a sixth of each element at the edge, a domain around a node a quarter; each domain has
    one material.

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
    """The domains of `smoothed_domains` that each element is a part of.

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
    """Number the pairs of an owner and a material: the first place of each number in the flat list, and the numbers in
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
