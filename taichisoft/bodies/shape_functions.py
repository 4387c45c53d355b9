"""Shape functions of finite elements: gradients and volumes at the quadrature points of the rest shape."""

import numpy as np

from taichisoft.meshes.ten_nodes import CUBIC_POINTS, CUBIC_WEIGHTS, QUADRATURE_POINTS, jacobians, slopes


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
    """Gradients and volumes of ten-node tetrahedra, whose sides may be curved, at four quadrature points.

    Over curved elements the gradients times the determinant of the Jacobian are cubic functions, which four points do
    not integrate exactly, so that a constant stress would push nodes inside a body. The volumes are scaled to that of
    the element, and the gradients shifted by what their mean misses (the integration constraint of Chen, Wu, Yoon and
    You 2001): then they give rigid motions and constant strains exactly, too, and a constant stress is at rest.

    Args:
        nodes: rest positions [mm], shape (node_count, 3).
        elements: node indices, the four corners first and then the middles of `SIDES`, shape (element_count, 10).

    Returns:
        gradients [1/mm] of the shape functions, shape (element_count, 4, 10, 3), and the volume [mm^3] that each
        quadrature point stands for, shape (element_count, 4); negative where an element is inside out.
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
