"""The bend of the finger by an independent program: linear or quadratic tetrahedra in numpy, solved by CHOLMOD.

It shares nothing with the engine, and says where the engine's series of meshes must lead: quadratic tetrahedra bend as
they should where linear ones are too stiff. At every integration point stands the corotated law
P = R (2 mu (S - 1) + lambda tr(S - 1) 1) with F = R S (Sifakis and Barbic, FEM simulation of 3D deformable solids,
SIGGRAPH 2012 courses, section 3.4); the pressure acts on the deformed cavity, and gravity on the silicone.
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sparse

from taichisoft.errors import TaichisoftError
from taichisoft.meshes.volume_mesh import VolumeMesh, tetrahedron_volumes
from taichisoft_benchmarks.peers.factorisations import prepare_cholmod
from taichisoft_benchmarks.studies.finger_at_rest import (
    BASE,
    GRAVITY,
    MASS,
    POISSON_RATIO,
    PRESSURE,
    RAMP,
    SILICONE,
    SOFT,
    STIFF,
    STIFF_LAYER,
    farthest,
)

EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])
# Four points that integrate quadratic functions over a tetrahedron exactly, as barycentric coordinates.
POINTS = np.full((4, 4), (5 - 5**0.5) / 20) + np.eye(4) * 5**-0.5

SIDES = np.array([[0, 1], [1, 2], [2, 0]])
# Six points that integrate polynomials of degree four over a triangle (Dunavant 1985), as barycentric coordinates.
_NEAR, _FAR = 0.445948490915965, 0.091576213509771
TRIANGLE_POINTS = np.array([[1 - 2 * a if i == k else a for i in range(3)] for a in (_NEAR, _FAR) for k in range(3)])
TRIANGLE_WEIGHTS = np.repeat([0.223381589678011, 0.109951743655322], 3)

PART = 0.6
"""Share of each solution of the linearised equations that is gone: they lack the stiffness of stresses that turn."""
STILL = 1e-3
"""Largest motion of a node in an iteration at which the finger counts as resting [mm]."""
MOST_ITERATIONS = 200


@dataclass(frozen=True)
class Elements:
    """Tetrahedra of one order.

    Attributes:
        nodes: positions at rest [mm], shape (node_count, 3); nodes in the middle of an edge come last.
        corners: nodes of each element, shape (element_count, nodes_per_element).
        shapes: shape functions at the integration points [-], shape (point_count, nodes_per_element).
        gradients: their gradients [1/mm], shape (element_count, point_count, nodes_per_element, 3).
        places: integration points [mm], shape (element_count, point_count, 3).
        weights: volume that each integration point stands for [mm^3], shape (element_count, point_count).
        middles: index of the node in the middle of an edge, by the ends of the edge; empty for linear elements.
    """

    nodes: np.ndarray
    corners: np.ndarray
    shapes: np.ndarray
    gradients: np.ndarray
    places: np.ndarray
    weights: np.ndarray
    middles: dict[tuple[int, int], int]


def make_elements(nodes: np.ndarray, tetrahedra: np.ndarray, quadratic: bool) -> Elements:
    """Elements on the tetrahedra of a mesh.

    Linear ones have one integration point, quadratic ones four, and a node in the middle of each edge.
    """
    inverse = np.linalg.inv(np.concatenate([nodes[tetrahedra], np.ones((len(tetrahedra), 4, 1))], axis=2))
    slopes_of_coordinates = np.swapaxes(inverse[:, :3], 1, 2)  # (element_count, 4, 3)
    points = POINTS if quadratic else POINTS.mean(axis=0, keepdims=True)
    shapes, slopes = shape_functions(points, EDGES, quadratic)
    corners, middles = tetrahedra, {}
    if quadratic:
        ends, edge = np.unique(np.sort(tetrahedra[:, EDGES].reshape(-1, 2), axis=1), axis=0, return_inverse=True)
        corners = np.hstack([tetrahedra, len(nodes) + edge.reshape(-1, 6)])
        middles = {(int(a), int(b)): len(nodes) + index for index, (a, b) in enumerate(ends)}
    return Elements(
        nodes=np.vstack([nodes, nodes[ends].mean(axis=1)]) if quadratic else nodes,
        corners=corners,
        shapes=shapes,
        gradients=np.einsum("qac,eci->eqai", slopes, slopes_of_coordinates),
        places=np.einsum("qa,eai->eqi", points, nodes[tetrahedra]),
        weights=np.repeat(tetrahedron_volumes(nodes, tetrahedra)[:, None] / len(points), len(points), axis=1),
        middles=middles,
    )


def shape_functions(points: np.ndarray, sides: np.ndarray, quadratic: bool) -> tuple[np.ndarray, np.ndarray]:
    """Shape functions of a triangle or tetrahedron at some points, and their slopes along barycentric coordinates.

    Args:
        points: barycentric coordinates, shape (point_count, corner_count).
        sides: corners at both ends of each side, shape (side_count, 2).
        quadratic: whether there is a node in the middle of each side, after those at the corners.

    Returns:
        Values, shape (point_count, node_count), and slopes, shape (point_count, node_count, corner_count).
    """
    unit = np.eye(points.shape[1])
    if not quadratic:
        return points, np.repeat(unit[None], len(points), axis=0)
    first, second = sides.T
    values = np.hstack([points * (2 * points - 1), 4 * points[:, first] * points[:, second]])
    at_corners = (4 * points - 1)[:, :, None] * unit
    at_middles = 4 * (points[:, first, None] * unit[second] + points[:, second, None] * unit[first])
    return values, np.concatenate([at_corners, at_middles], axis=1)


class DeformedCavity:
    """The triangles of a cavity on linear or quadratic elements; they point into the silicone."""

    def __init__(self, elements: Elements, triangles: np.ndarray):
        """Find the nodes of all triangles.

        Args:
            elements: elements that the triangles are sides of.
            triangles: corners, shape (triangle_count, 3); on quadratic elements the triangles are curved.
        """
        self._nodes = triangles
        if elements.middles:
            ends = np.sort(triangles[:, SIDES], axis=2)
            middles = [[elements.middles[int(a), int(b)] for a, b in sides] for sides in ends]
            self._nodes = np.hstack([triangles, np.array(middles)])
        self._shapes, slopes = shape_functions(TRIANGLE_POINTS, SIDES, bool(elements.middles))
        self._slopes = slopes[..., 0] - slopes[..., 2], slopes[..., 1] - slopes[..., 2]

    def volume_gradient(self, position: np.ndarray) -> np.ndarray:
        """Change of the cavity's volume with the nodes, which is the force of 1 kPa on them [mN].

        Args:
            position: positions of all nodes [mm], shape (node_count, 3).

        Returns:
            Forces, shape (node_count, 3).
        """
        corners = position[self._nodes]
        first, second = (np.einsum("qn,tni->tqi", slope, corners) for slope in self._slopes)
        shares = np.einsum("q,qn,tqi->tni", TRIANGLE_WEIGHTS, self._shapes, np.cross(first, second) / 2)
        gradient = np.zeros_like(position)
        np.add.at(gradient, self._nodes, shares)
        return gradient


def stiffness(elements: Elements, young_modulus: np.ndarray, poisson_ratio: float) -> sparse.csr_matrix:
    """The matrix of linear elasticity [mN/mm], from Young's modulus at each integration point [kPa]."""
    first, second = _lame(young_modulus, poisson_ratio)
    first, second = elements.weights * first, elements.weights * second
    g = elements.gradients
    blocks = np.einsum("eq,eqai,eqbj->eaibj", first, g, g, optimize=True)
    blocks += np.einsum("eq,eqaj,eqbi->eaibj", second, g, g, optimize=True)
    blocks += np.einsum("eq,eqak,eqbk,ij->eaibj", second, g, g, np.eye(3), optimize=True)
    unknowns = (3 * elements.corners[:, :, None] + np.arange(3)).reshape(len(g), -1)
    rows = np.repeat(unknowns, unknowns.shape[1], axis=1).ravel()
    columns = np.tile(unknowns, unknowns.shape[1]).ravel()
    size = 3 * len(elements.nodes)
    return sparse.csr_matrix((blocks.ravel(), (rows, columns)), shape=(size, size))


def elastic_forces(
    elements: Elements, young_modulus: np.ndarray, poisson_ratio: float, position: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Rotations at the integration points, and elastic forces on the nodes [mN].

    Args:
        elements: elements at rest.
        young_modulus: Young's modulus at each integration point [kPa], shape (element_count, point_count).
        poisson_ratio: Poisson's ratio [-].
        position: positions of all nodes [mm], shape (node_count, 3).

    Returns:
        Rotations, shape (element_count, point_count, 3, 3), and forces, shape (node_count, 3).

    Raises:
        TaichisoftError: an element has turned inside out.
    """
    deformation = np.einsum("eai,eqaj->eqij", position[elements.corners], elements.gradients)
    if (np.linalg.det(deformation) <= 0).any():
        raise TaichisoftError("an element has turned inside out; give a finer mesh or less pressure")
    left, _, right = np.linalg.svd(deformation)
    rotation = left @ right
    strain = np.swapaxes(rotation, -1, -2) @ deformation - np.eye(3)
    first, second = _lame(young_modulus, poisson_ratio)
    pressure = (first * np.trace(strain, axis1=-2, axis2=-1))[..., None, None] * np.eye(3)
    stress = rotation @ (2 * second[..., None, None] * strain + pressure)
    forces = np.zeros_like(position)
    shares = np.einsum("eq,eqij,eqaj->eai", elements.weights, stress, elements.gradients)
    np.subtract.at(forces, elements.corners, shares)
    return rotation, forces


def quadratic_bend(mesh: VolumeMesh, quadratic: bool = True, pressure: float = PRESSURE) -> float:
    """Displacement of the node that moves farthest until the finger rests [mm].

    Args:
        mesh: mesh of the finger, whose group "cavity" is the cavity.
        quadratic: whether the elements are quadratic instead of linear.
        pressure: pressure in the cavity [kPa].

    Raises:
        PeerMissing: cvxopt, which has CHOLMOD, is not installed.
        TaichisoftError: no state of rest was found.
    """
    elements = make_elements(mesh.nodes, mesh.elements, quadratic)
    cavity = DeformedCavity(elements, mesh.surface_groups["cavity"])
    free = np.repeat((elements.nodes < BASE[0]).any(axis=1) | (elements.nodes > BASE[1]).any(axis=1), 3)
    lower, upper = np.array(STIFF_LAYER)
    in_layer = ((elements.places >= lower) & (elements.places <= upper)).all(axis=2)
    young_modulus = np.where(in_layer, STIFF, SOFT)
    weight = _volume_of_nodes(elements)[:, None] * MASS / SILICONE * np.array(GRAVITY)
    position = elements.nodes.copy()
    for iteration in range(1, MOST_ITERATIONS + 1):
        rotation, inner = elastic_forces(elements, young_modulus, POISSON_RATIO, position)
        force = inner + weight + min(1.0, iteration / RAMP) * pressure * cavity.volume_gradient(position)
        turned = replace(elements, gradients=np.einsum("eqij,eqaj->eqai", rotation, elements.gradients))
        matrix = stiffness(turned, young_modulus, POISSON_RATIO)[free][:, free]
        step = np.zeros(free.size)
        step[free] = PART * _solve(matrix, force.ravel()[free])
        position += step.reshape(-1, 3)
        if iteration > RAMP and farthest(step.reshape(-1, 3)) < STILL:
            return farthest(position - elements.nodes)
    raise TaichisoftError(f"no rest after {MOST_ITERATIONS} iterations")


def _lame(young_modulus: np.ndarray, poisson_ratio: float) -> tuple[np.ndarray, np.ndarray]:
    """Lamé's first and second parameters [kPa]."""
    first = young_modulus * poisson_ratio / ((1 + poisson_ratio) * (1 - 2 * poisson_ratio))
    return first, young_modulus / (2 * (1 + poisson_ratio))


def _volume_of_nodes(elements: Elements) -> np.ndarray:
    """Each node's share of the silicone [mm^3], shape (node_count,)."""
    shares = np.zeros(len(elements.nodes))
    np.add.at(shares, elements.corners, elements.weights @ elements.shapes)
    return shares


def _solve(matrix: sparse.csr_matrix, load: np.ndarray) -> np.ndarray:
    """Displacements [mm] under forces [mN] of a symmetric, positive definite stiffness."""
    factor = prepare_cholmod(matrix.tocsc())()
    from cvxopt import cholmod
    from cvxopt import matrix as column

    answer = column(load)
    cholmod.solve(factor, answer)
    return np.array(answer).ravel()
