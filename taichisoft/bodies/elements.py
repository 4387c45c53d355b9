"""Shape functions of finite elements: gradients and volumes at the quadrature points of the rest shape."""

import numpy as np

from taichisoft.meshes.second_order import SIDES


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


# Four points that integrate quadratic functions over a tetrahedron exactly, as barycentric coordinates.
QUADRATURE_POINTS = np.full((4, 4), (5.0 - 5.0**0.5) / 20.0) + np.eye(4) * 5.0**-0.5


def quadratic_tetrahedra(nodes: np.ndarray, elements: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gradients and volumes of ten-node tetrahedra, whose sides may be curved, at four quadrature points.

    Args:
        nodes: rest positions [mm], shape (node_count, 3).
        elements: node indices, the four corners first and then the middles of `SIDES`, shape (element_count, 10).

    Returns:
        gradients [1/mm] of the shape functions, shape (element_count, 4, 10, 3), and the volume [mm^3] that each
        quadrature point stands for, shape (element_count, 4); negative where an element is inside out.
    """
    first, second = SIDES.T
    unit, points = np.eye(4), QUADRATURE_POINTS
    # Slopes of the shape functions along the barycentric coordinates, then along the last three of them.
    at_corners = (4.0 * points - 1.0)[:, :, None] * unit
    at_middles = 4.0 * (points[:, first, None] * unit[second] + points[:, second, None] * unit[first])
    slopes = np.concatenate([at_corners, at_middles], axis=1)
    slopes = slopes[..., 1:] - slopes[..., :1]
    jacobian = np.einsum("eai,qaj->eqij", nodes[elements], slopes)
    gradients = np.einsum("qaj,eqji->eqai", slopes, np.linalg.inv(jacobian))
    return np.ascontiguousarray(gradients), np.linalg.det(jacobian) / 24.0


def edge_frames(along: np.ndarray, across: np.ndarray) -> np.ndarray:
    """Frames (count, 3, 3): first column along one edge, third normal to it and another; edges of shape (count, 3)."""
    first = along / np.linalg.norm(along, axis=1, keepdims=True)
    third = np.cross(first, across)
    third /= np.linalg.norm(third, axis=1, keepdims=True)
    return np.ascontiguousarray(np.stack([first, np.cross(third, first), third], axis=2))


def lame_parameters(young_modulus: np.ndarray, poisson_ratio: np.ndarray) -> np.ndarray:
    """Lame's lambda and mu [kPa], shape (count, 2), of isotropic materials given by arrays of shape (count,)."""
    first = young_modulus * poisson_ratio / ((1 + poisson_ratio) * (1 - 2 * poisson_ratio))
    second = young_modulus / (2 * (1 + poisson_ratio))
    return np.column_stack([first, second])
