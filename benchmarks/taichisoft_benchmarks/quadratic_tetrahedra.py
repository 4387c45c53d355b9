"""How far the finger bends under a small pressure, by linear and by quadratic tetrahedra: a check from outside.

Quadratic tetrahedra bend as they should where linear ones are too stiff. Small displacements, no gravity, numpy and
CHOLMOD; nothing of the engine's elements is used.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse

from taichisoft.mesh import VolumeMesh, tetrahedron_volumes
from taichisoft_benchmarks.static_bend import BASE, POISSON_RATIO, SOFT, STIFF, STIFF_LAYER

EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])
# Four points that integrate quadratic functions exactly, as barycentric coordinates.
POINTS = np.full((4, 4), (5 - 5**0.5) / 20) + np.eye(4) * 5**-0.5


@dataclass(frozen=True)
class Elements:
    """Tetrahedra of one order.

    Attributes:
        nodes: [mm], shape (node_count, 3); those in the middles of edges come last.
        corners: of each element, shape (element_count, nodes_per_element).
        gradients: of the shape functions [1/mm], shape (element_count, 4 points, nodes_per_element, 3).
        places: of the integration points [mm], shape (element_count, 4 points, 3).
        weights: volume of each point [mm^3], shape (element_count, 4 points).
        middles: index of the node in the middle of an edge by its ends; empty for linear elements.
    """

    nodes: np.ndarray
    corners: np.ndarray
    gradients: np.ndarray
    places: np.ndarray
    weights: np.ndarray
    middles: dict[tuple[int, int], int]


def compliance(mesh: VolumeMesh, quadratic: bool) -> float:
    """Largest displacement of a node for each kPa in the cavity [mm/kPa]; held and stiffened like `static_bend`.

    Raises:
        PeerMissing: cvxopt, which has CHOLMOD, is not installed.
    """
    elements = make_elements(mesh.nodes, mesh.elements, quadratic)
    lower, upper = np.array(STIFF_LAYER)
    in_layer = ((elements.places >= lower) & (elements.places <= upper)).all(axis=2)
    matrix = stiffness(elements, np.where(in_layer, STIFF, SOFT), POISSON_RATIO)
    load = _load(elements, mesh.surface_groups["cavity"])
    free = np.repeat((elements.nodes < BASE[0]).any(axis=1) | (elements.nodes > BASE[1]).any(axis=1), 3)
    moved = np.zeros(free.size)
    moved[free] = _solve(matrix[free][:, free], load.ravel()[free])
    return float(np.linalg.norm(moved.reshape(-1, 3), axis=1).max())


def make_elements(nodes: np.ndarray, tetrahedra: np.ndarray, quadratic: bool) -> Elements:
    """Elements on the tetrahedra of a mesh; quadratic ones get a node in the middle of each edge."""
    inverse = np.linalg.inv(np.concatenate([nodes[tetrahedra], np.ones((len(tetrahedra), 4, 1))], axis=2))
    slopes = np.swapaxes(inverse[:, :3], 1, 2)  # of the barycentric coordinates, (element_count, 4, 3)
    places = np.einsum("qa,eai->eqi", POINTS, nodes[tetrahedra])
    weights = np.repeat(tetrahedron_volumes(nodes, tetrahedra)[:, None] / 4, 4, axis=1)
    if not quadratic:
        return Elements(nodes, tetrahedra, np.repeat(slopes[:, None], 4, axis=1), places, weights, {})
    ends, edge = np.unique(np.sort(tetrahedra[:, EDGES].reshape(-1, 2), axis=1), axis=0, return_inverse=True)
    middle = len(nodes) + edge.reshape(-1, 6)
    at_corners = np.einsum("qa,eai->eqai", 4 * POINTS - 1, slopes)
    first, second = EDGES.T
    at_middles = 4 * np.einsum("qa,eai->eqai", POINTS[:, first], slopes[:, second])
    at_middles += 4 * np.einsum("qa,eai->eqai", POINTS[:, second], slopes[:, first])
    return Elements(
        np.vstack([nodes, nodes[ends].mean(axis=1)]),
        np.hstack([tetrahedra, middle]),
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


def _load(elements: Elements, cavity: np.ndarray) -> np.ndarray:
    """Forces of 1 kPa on the nodes [mN], shape (node_count, 3): on quadratic triangles the middles carry all of it."""
    a, b, c = np.moveaxis(elements.nodes[cavity], 1, 0)
    third = np.cross(b - a, c - a) / 6
    force = np.zeros_like(elements.nodes)
    for start, end in ((0, 1), (1, 2), (2, 0)):
        if elements.middles:
            edges = np.sort(cavity[:, [start, end]], axis=1)
            np.add.at(force, [elements.middles[int(i), int(j)] for i, j in edges], third)
        else:
            np.add.at(force, cavity[:, start], third)
    return force


def _solve(matrix: sparse.csr_matrix, load: np.ndarray) -> np.ndarray:
    from taichisoft_benchmarks.peers.cholmod import prepare

    factor = prepare(matrix.tocsc())()
    from cvxopt import cholmod
    from cvxopt import matrix as column

    answer = column(load)
    cholmod.solve(factor, answer)
    return np.array(answer).ravel()
