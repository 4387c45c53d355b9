"""Integration domains of hexahedra of eight nodes: shape at eight Gauss points, volume as its mean (Hughes 1980)."""

import numpy as np

from taichisoft.bodies.domains import IntegrationDomains, quadrature_domains
from taichisoft.errors import MeshError
from taichisoft.meshes.hexahedra import SIGNS, hexahedra_of

POINTS = SIGNS / np.sqrt(3.0)
"""Gauss points of the cube with edges of 2, each of weight 1, shape (8, 3)."""


def hexahedral_domains(nodes: np.ndarray, elements: np.ndarray, material: np.ndarray) -> IntegrationDomains:
    """Domains of trilinear hexahedra: eight for the energy of shape, and one for that of volume, whose mean gradient
    keeps volume without locking (mean dilatation, B-bar).

    Args:
        nodes: at rest [mm], shape (node_count, 3).
        elements: node indices of tetrahedra, six for each hexahedron, shape (element_count, 4).
        material: number of the material of each element, shape (element_count,).

    Raises:
        MeshError: a hexahedron is turned over at a Gauss point.
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
