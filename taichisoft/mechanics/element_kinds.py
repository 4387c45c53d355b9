"""The kinds of elements that a scene may name: what each makes of a mesh. A new one is an entry here.

`SoftBody.element` in `scene/soft_body.py` has the names.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from taichisoft.errors import MeshError
from taichisoft.mechanics.domains import IntegrationDomains, quadrature_domains
from taichisoft.mesh.volume_mesh import (
    CUBIC_POINTS,
    CUBIC_WEIGHTS,
    QUADRATURE_POINTS,
    SIDES,
    SIGNS,
    hexahedra_of,
    jacobians,
    slopes,
)

# Integration domains of hexahedra of eight nodes: shape at eight Gauss points, volume as its mean (Hughes 1980).

POINTS = SIGNS / np.sqrt(3.0)
"""Gauss points of the cube with edges of 2, each of weight 1, shape (8, 3)."""


def hexahedral_domains(nodes: np.ndarray, elements: np.ndarray, material: np.ndarray) -> IntegrationDomains:
    """Domains of trilinear hexahedra, six tetrahedra each: eight for the energy of shape, and one for that of volume,
    whose mean gradient keeps volume without locking (mean dilatation, B-bar).
    """
    hexahedra = _hexahedra(elements)
    slopes = np.array([_slopes(point) for point in POINTS])  # [point, corner, direction]
    jacobian = np.einsum("qaj,eai->eqij", slopes, nodes[hexahedra])
    volume = np.linalg.det(jacobian)
    if (volume <= 0.0).any():
        worst = int(np.argmax((volume <= 0.0).any(axis=1)))
        raise MeshError(f"hexahedron {worst}, of the nodes {hexahedra[worst].tolist()}, is turned over; mesh again")
    gradient = np.einsum("qaj,eqji->eqai", slopes, np.linalg.inv(jacobian))
    mean = np.einsum("eq,eqai->eai", volume / volume.sum(axis=1, keepdims=True), gradient)[:, None]
    shape = quadrature_domains(hexahedra, gradient, volume)
    whole = quadrature_domains(hexahedra, mean, volume.sum(axis=1, keepdims=True))
    shape.volume[:, 1] = whole.volume[:, 0] = 0.0
    shape.element[:] *= 6
    whole.element[:] *= 6
    return IntegrationDomains.joined([shape, whole])


def domains_of_hexahedra(elements: np.ndarray, node_count: int, material: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The domains of `hexahedral_domains` that each tetrahedron shares, (element_count, 8) and (element_count, 1)."""
    count = len(elements) // 6
    hexahedron = np.repeat(np.arange(count), 6)[:, None]
    return 8 * hexahedron + np.arange(8), 8 * count + hexahedron


def of_hexahedra(values: np.ndarray) -> np.ndarray:
    """Numbers of materials (element_count,) with each hexahedron's most frequent one for all of its tetrahedra.

    Of two with three each the larger one wins, as a later region wins over an earlier one.
    """
    six = np.sort(values.reshape(-1, 6), axis=1)
    counts = (six[:, :, None] == six[:, None, :]).sum(axis=1)
    most = six[np.arange(len(six)), 5 - np.argmax(counts[:, ::-1], axis=1)]
    return np.repeat(most, 6).astype(values.dtype)


def hexahedral_masses(nodes: np.ndarray, elements: np.ndarray, density: float) -> np.ndarray:
    """Mass of each node [kg], shape (node_count,): the row sums of the consistent mass matrix, by density [kg/mm^3]."""
    hexahedra = _hexahedra(elements)
    slopes = np.array([_slopes(point) for point in POINTS])
    part = np.linalg.det(np.einsum("qaj,eai->eqij", slopes, nodes[hexahedra]))
    functions = np.prod(1.0 + POINTS[:, None, :] * SIGNS, axis=2) / 8.0  # [point, corner]
    return density * np.bincount(hexahedra.ravel(), (part @ functions).ravel(), len(nodes))


def _slopes(point: np.ndarray) -> np.ndarray:
    """Derivatives of the eight shape functions at a point of the cube, shape (8, 3)."""
    factors = 1.0 + point * SIGNS
    others = [factors[:, pair].prod(axis=1) for pair in ([1, 2], [0, 2], [0, 1])]
    slopes: np.ndarray = SIGNS * np.column_stack(others) / 8.0
    return slopes


def _hexahedra(elements: np.ndarray) -> np.ndarray:
    hexahedra = hexahedra_of(elements)
    assert hexahedra is not None  # other meshes are refused before
    return hexahedra


# Shape functions of finite elements: gradients and volumes at the quadrature points of the rest shape.


def linear_tetrahedra(nodes: np.ndarray, elements: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gradients and volumes of four-node tetrahedra, which need one quadrature point.

    Args:
        nodes: rest positions [mm], shape (node_count, 3).
        elements: node indices, shape (element_count, 4).

    Returns:
        gradients [1/mm] of the shape functions, shape (element_count, 1, 4, 3), and the volume [mm^3] of
        each quadrature point, shape (element_count, 1).
    """
    edges = nodes[elements[:, 1:]] - nodes[elements[:, :1]]
    # The rows of the inverse transpose of the edge matrix are the gradients of the last three functions.
    last_three = np.linalg.inv(edges).transpose(0, 2, 1)
    first = -last_three.sum(axis=1, keepdims=True)
    volumes = np.abs(np.linalg.det(edges)) / 6.0
    return np.ascontiguousarray(np.concatenate([first, last_three], axis=1)[:, None]), volumes[:, None]


def quadratic_tetrahedra(nodes: np.ndarray, elements: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gradients and volumes of ten-node tetrahedra, whose sides may be curved, as of `linear_tetrahedra`, at four
    points.

    Over curved elements the gradients times the determinant of the Jacobian are cubic functions, which four points do
    not integrate exactly, so that a constant stress would push nodes inside a body. The volumes are scaled to that of
    the element, and the gradients shifted by what their mean misses (the integration constraint of Chen, Wu, Yoon and
    You 2001): then they give rigid motions and constant strains exactly, too, and a constant stress is at rest. A
    volume is negative where an element is inside out.
    """
    gradients, determinants = _gradients(nodes, elements, QUADRATURE_POINTS)
    exact_gradients, exact_determinants = _gradients(nodes, elements, CUBIC_POINTS)
    exact_parts = exact_determinants * CUBIC_WEIGHTS / 6.0
    volume = exact_parts.sum(axis=1)
    volumes = determinants * (volume / determinants.sum(axis=1))[:, None]
    missing = np.einsum("eq,eqai->eai", exact_parts, exact_gradients)
    missing -= np.einsum("eq,eqai->eai", volumes, gradients)
    gradients += (missing / volume[:, None, None])[:, None]
    return np.ascontiguousarray(gradients), volumes


def _gradients(nodes: np.ndarray, elements: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gradients [1/mm], (element_count, point_count, 10, 3), and determinants of the Jacobian [mm^3], at points."""
    jacobian = jacobians(nodes, elements, points)
    return np.einsum("qaj,eqji->eqai", slopes(points), np.linalg.inv(jacobian)), np.linalg.det(jacobian)


# Integration domains of smoothed tetrahedra: two sets (Liu and Nguyen-Thoi 2010, Smoothed Finite Element Methods).
#
# One set lies around the edges, for the energy of shape, and one around the nodes, for that of volume. The first bend
# as they should, where a tetrahedron on its own is too stiff; the second keep volume without locking, since there are
# fewer of them than motions of the nodes.


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
    """Domains of the elements that share an owner, each giving equal parts to all of its own, (element_count, owners).

    Their volumes count in two shares for the energies of shape and of volume.
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


@dataclass(frozen=True)
class ElementKind:
    """A kind of element.

    Attributes:
        mass_shares: of an element's mass, what each of its nodes has [-], shape (nodes_per_element,), 4 or 10.
        domains: from nodes at rest [mm], shape (node_count, 3), elements, shape (element_count, nodes_per_element), and
            the number of each element's material, shape (element_count,).
        stress_domains: from elements, number of nodes and materials: the domains whose mean is the stress of shape of
            an element, shape (element_count, domain_count), or of each of its linear parts, (element_count, part_count,
            domain_count), and those whose mean is the stress of volume, (element_count, volume_domain_count).
    """

    mass_shares: np.ndarray
    domains: Callable[[np.ndarray, np.ndarray, np.ndarray], IntegrationDomains]
    stress_domains: Callable[[np.ndarray, int, np.ndarray], tuple[np.ndarray, np.ndarray]]


def _quadratic_stress(elements: np.ndarray, node_count: int, material: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of the eight parts of an element each of the first four is at a corner; the others share its middle."""
    point_count = len(QUADRATURE_POINTS)
    points = np.arange(len(elements) * point_count).reshape(-1, point_count)
    nearest = points[:, QUADRATURE_POINTS.argmax(axis=0)]
    corners = np.repeat(nearest[:, :, None], point_count, axis=2)
    return np.concatenate([corners, np.repeat(points[:, None], 4, axis=1)], axis=1), points


# The mass of a quadratic element is spread as the diagonal of the consistent mass matrix (Hinton, Rock and Zienkiewicz
# 1976), since the integrals of the functions of its corners are negative.
ELEMENT_KINDS = {
    "linear": ElementKind(
        np.full(4, 1 / 4),
        lambda nodes, elements, _: quadrature_domains(elements, *linear_tetrahedra(nodes, elements)),
        lambda elements, _node_count, _material: (np.arange(len(elements))[:, None],) * 2,
    ),
    "smoothed": ElementKind(np.full(4, 1 / 4), smoothed_domains, domains_of_elements),
    "hexahedral": ElementKind(np.full(4, 1 / 4), hexahedral_domains, domains_of_hexahedra),
    "quadratic": ElementKind(
        np.repeat([1 / 36, 4 / 27], [4, 6]),
        lambda nodes, elements, _: quadrature_domains(elements, *quadratic_tetrahedra(nodes, elements)),
        _quadratic_stress,
    ),
}
