"""The kinds of elements that a scene may name: what each makes of a mesh. A new one is an entry here.

`SoftBody.element` in `scenes/soft_body.py` has the names.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from taichisoft.bodies.domains import IntegrationDomains, quadrature_domains
from taichisoft.bodies.hexahedral_domains import domains_of_hexahedra, hexahedral_domains
from taichisoft.bodies.shape_functions import linear_tetrahedra, quadratic_tetrahedra
from taichisoft.bodies.smoothed_tetrahedra import domains_of_elements, smoothed_domains
from taichisoft.meshes.ten_nodes import QUADRATURE_POINTS


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


def _linear_domains(nodes: np.ndarray, elements: np.ndarray, material: np.ndarray) -> IntegrationDomains:
    return quadrature_domains(elements, *linear_tetrahedra(nodes, elements))


def _linear_stress(elements: np.ndarray, node_count: int, material: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    own = np.arange(len(elements))[:, None]
    return own, own


def _quadratic_domains(nodes: np.ndarray, elements: np.ndarray, material: np.ndarray) -> IntegrationDomains:
    return quadrature_domains(elements, *quadratic_tetrahedra(nodes, elements))


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
    "linear": ElementKind(np.full(4, 1 / 4), _linear_domains, _linear_stress),
    "smoothed": ElementKind(np.full(4, 1 / 4), smoothed_domains, domains_of_elements),
    "hexahedral": ElementKind(np.full(4, 1 / 4), hexahedral_domains, domains_of_hexahedra),
    "quadratic": ElementKind(np.repeat([1 / 36, 4 / 27], [4, 6]), _quadratic_domains, _quadratic_stress),
}
