"""How far the finger of `static_bend` bends with linear or with quadratic tetrahedra, by code that shares nothing with
the engine: where the engine's series of meshes must lead.

At every integration point the corotated law P = R (2 mu (S - 1) + lambda tr(S - 1) 1) with F = R S (Sifakis and Barbic,
FEM simulation of 3D deformable solids, SIGGRAPH 2012 courses, section 3.4), pressure on the deformed cavity, gravity.
"""

from dataclasses import replace

import numpy as np

from taichisoft.errors import TaichisoftError
from taichisoft.meshes.volume_mesh import VolumeMesh
from taichisoft_benchmarks.deformed_cavity import DeformedCavity
from taichisoft_benchmarks.quadratic_tetrahedra import Elements, make_elements, solve, stiffness
from taichisoft_benchmarks.static_bend import BASE, MASS, POISSON_RATIO, PRESSURE, SILICONE, SOFT, STIFF, STIFF_LAYER

GRAVITY = (-9810.0, 0.0, 0.0)
"""[mm/s^2]"""
RAMP = 10
"""Iterations in which the pressure rises."""
PART = 0.6
"""Of the way to the solution of the linearised equations: they lack the stiffness of stresses that turn."""
STILL = 1e-3
"""[mm] No node moves farther in an iteration when the finger is said to be at rest."""
MOST_ITERATIONS = 200


def quadratic_bend(mesh: VolumeMesh, quadratic: bool = True, pressure: float = PRESSURE) -> float:
    """How far the node that moves farthest is from where it was when the finger rests [mm].

    Args:
        mesh: its cavity is the group "cavity".
        quadratic: or linear.
        pressure: [kPa].

    Raises:
        PeerMissing: cvxopt, which has CHOLMOD, is not installed.
        TaichisoftError: no rest was found.
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
        step[free] = PART * solve(matrix, force.ravel()[free])
        position += step.reshape(-1, 3)
        if iteration > RAMP and np.linalg.norm(step.reshape(-1, 3), axis=1).max() < STILL:
            return float(np.linalg.norm(position - elements.nodes, axis=1).max())
    raise TaichisoftError(f"no rest after {MOST_ITERATIONS} iterations")


def elastic_forces(
    elements: Elements, young_modulus: np.ndarray, poisson_ratio: float, position: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Rotations at the integration points, (element_count, point_count, 3, 3), and forces on the nodes [mN].

    Args:
        elements: at rest.
        young_modulus: of each integration point [kPa], shape (element_count, point_count).
        poisson_ratio: [-].
        position: of all nodes [mm], shape (node_count, 3).

    Raises:
        TaichisoftError: an element has turned inside out.
    """
    deformation = np.einsum("eai,eqaj->eqij", position[elements.corners], elements.gradients)
    if (np.linalg.det(deformation) <= 0).any():
        raise TaichisoftError("an element has turned inside out; give a finer mesh or less pressure")
    left, _, right = np.linalg.svd(deformation)
    rotation = left @ right
    strain = np.swapaxes(rotation, -1, -2) @ deformation - np.eye(3)
    first = young_modulus * poisson_ratio / ((1 + poisson_ratio) * (1 - 2 * poisson_ratio))
    second = young_modulus / (2 * (1 + poisson_ratio))
    pressure = (first * np.trace(strain, axis1=-2, axis2=-1))[..., None, None] * np.eye(3)
    stress = rotation @ (2 * second[..., None, None] * strain + pressure)
    forces = np.zeros_like(position)
    np.subtract.at(
        forces, elements.corners, np.einsum("eq,eqij,eqaj->eai", elements.weights, stress, elements.gradients)
    )
    return rotation, forces


def _volume_of_nodes(elements: Elements) -> np.ndarray:
    """Each node's share of the silicone [mm^3], shape (node_count,)."""
    shares = np.zeros(len(elements.nodes))
    np.add.at(shares, elements.corners, elements.weights @ elements.shapes)
    return shares
