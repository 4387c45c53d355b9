"""Linear and quadratic tetrahedra and their stiffness, by numpy and CHOLMOD; nothing of the engine's elements is used.

Quadratic tetrahedra bend as they should where linear ones are too stiff.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse

from taichisoft.meshes.volume_mesh import tetrahedron_volumes

EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])
# Four points that integrate quadratic functions exactly, as barycentric coordinates.
POINTS = np.full((4, 4), (5 - 5**0.5) / 20) + np.eye(4) * 5**-0.5


@dataclass(frozen=True)
class Elements:
    """Tetrahedra of one order.

    Attributes:
        nodes: [mm], shape (node_count, 3); those in the middles of edges come last.
        corners: of each element, shape (element_count, nodes_per_element).
        shapes: values of the shape functions at the integration points [-], shape (point_count, nodes_per_element).
        gradients: of the shape functions [1/mm], shape (element_count, point_count, nodes_per_element, 3).
        places: of the integration points [mm], shape (element_count, point_count, 3).
        weights: volume of each point [mm^3], shape (element_count, point_count).
        middles: index of the node in the middle of an edge by its ends; empty for linear elements.
    """

    nodes: np.ndarray
    corners: np.ndarray
    shapes: np.ndarray
    gradients: np.ndarray
    places: np.ndarray
    weights: np.ndarray
    middles: dict[tuple[int, int], int]


def make_elements(nodes: np.ndarray, tetrahedra: np.ndarray, quadratic: bool) -> Elements:
    """Elements on the tetrahedra of a mesh: linear ones have one integration point, quadratic ones four, and a node in
    the middle of each edge."""
    inverse = np.linalg.inv(np.concatenate([nodes[tetrahedra], np.ones((len(tetrahedra), 4, 1))], axis=2))
    slopes = np.swapaxes(inverse[:, :3], 1, 2)  # of the barycentric coordinates, (element_count, 4, 3)
    points = POINTS if quadratic else POINTS.mean(axis=0, keepdims=True)
    places = np.einsum("qa,eai->eqi", points, nodes[tetrahedra])
    weights = np.repeat(tetrahedron_volumes(nodes, tetrahedra)[:, None] / len(points), len(points), axis=1)
    if not quadratic:
        return Elements(nodes, tetrahedra, points, slopes[:, None], places, weights, {})
    ends, edge = np.unique(np.sort(tetrahedra[:, EDGES].reshape(-1, 2), axis=1), axis=0, return_inverse=True)
    middle = len(nodes) + edge.reshape(-1, 6)
    first, second = EDGES.T
    at_corners = np.einsum("qa,eai->eqai", 4 * points - 1, slopes)
    at_middles = 4 * np.einsum("qa,eai->eqai", points[:, first], slopes[:, second])
    at_middles += 4 * np.einsum("qa,eai->eqai", points[:, second], slopes[:, first])
    return Elements(
        np.vstack([nodes, nodes[ends].mean(axis=1)]),
        np.hstack([tetrahedra, middle]),
        np.hstack([points * (2 * points - 1), 4 * points[:, first] * points[:, second]]),
        np.concatenate([at_corners, at_middles], axis=2),
        places,
        weights,
        {(int(a), int(b)): len(nodes) + index for index, (a, b) in enumerate(ends)},
    )


def stiffness(elements: Elements, young_modulus: np.ndarray, poisson_ratio: float) -> sparse.csr_matrix:
    """The matrix of linear elasticity [mN/mm]; `young_modulus` [kPa] of each integration point."""
    first = elements.weights * young_modulus * poisson_ratio / ((1 + poisson_ratio) * (1 - 2 * poisson_ratio))
    second = elements.weights * young_modulus / (2 * (1 + poisson_ratio))
    g = elements.gradients
    blocks = np.einsum("eq,eqai,eqbj->eaibj", first, g, g, optimize=True)
    blocks += np.einsum("eq,eqaj,eqbi->eaibj", second, g, g, optimize=True)
    blocks += np.einsum("eq,eqak,eqbk,ij->eaibj", second, g, g, np.eye(3), optimize=True)
    unknowns = (3 * elements.corners[:, :, None] + np.arange(3)).reshape(len(g), -1)
    rows = np.repeat(unknowns, unknowns.shape[1], axis=1).ravel()
    columns = np.tile(unknowns, unknowns.shape[1]).ravel()
    size = 3 * len(elements.nodes)
    return sparse.csr_matrix((blocks.ravel(), (rows, columns)), shape=(size, size))


def solve(matrix: sparse.csr_matrix, load: np.ndarray) -> np.ndarray:
    """Displacements [mm] under forces [mN] of a symmetric, positive definite stiffness.

    Raises:
        PeerMissing: cvxopt, which has CHOLMOD, is not installed.
    """
    from taichisoft_benchmarks.peers.cholmod import prepare

    factor = prepare(matrix.tocsc())()
    from cvxopt import cholmod
    from cvxopt import matrix as column

    answer = column(load)
    cholmod.solve(factor, answer)
    return np.array(answer).ravel()
