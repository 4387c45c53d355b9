"""Kinetic energy, elastic energy and energy of position of a simulation, and how much a step may add to them."""

import numpy as np

from taichisoft import Simulation, State
from taichisoft.base import matrices_from_quaternions


def total_energy(simulation: Simulation) -> float:
    """Kinetic energy, elastic energy of elements with polar rotations, and energy of position [mN mm]."""
    model, state = simulation.model, simulation.state
    energy = float(
        (model.rigid_mass * (0.5 * _squared(state.rigid_velocity) - state.rigid_position @ model.gravity)).sum()
    )
    spin = np.einsum("bij,bi->bj", matrices_from_quaternions(state.rigid_rotation), state.rigid_angular_velocity)
    energy += 0.5 * float(np.einsum("bi,bij,bj->", spin, model.rigid_inertia, spin))
    if model.elasticity is not None:
        mass = model.elasticity.node_mass
        energy += float((mass * (0.5 * _squared(state.velocity) - state.position @ model.gravity)).sum())
        _, stretch = _rotations_and_stretches(simulation, state)
        first, second = model.elasticity.lame.T
        strain = stretch - 1.0
        density = second * _squared(strain) + 0.5 * first * strain.sum(axis=1) ** 2
        energy += float((model.elasticity.volume.sum(axis=1) * density).sum())
    return energy


def gain_by_turning(simulation: Simulation, start: State) -> float:
    """What the elements' turn in the step since `start` may add to the energy [mN mm].

    A step of implicit Euler is one on the quadratic energy w of the strains in the axes R0 that the element has at
    its start, where it loses energy. With F = R S at the end, Q = R0^T R, and s_i, n_i and the stresses p_i of the
    principal directions of S, w is convex, and strain and stress have the same directions, so that

        w(S - I) - w(sym(Q S) - I) <= p : (S - sym(Q S)) = sum_i p_i s_i (1 - n_i . Q n_i),

    and n_i . Q n_i >= cos(angle of Q).
    """
    elasticity = simulation.model.elasticity
    if elasticity is None:
        return 0.0
    before, _ = _rotations_and_stretches(simulation, start)
    after, stretch = _rotations_and_stretches(simulation, simulation.state)
    one_less_cosine = 0.25 * _squared((after - before).reshape(-1, 9))
    first, second = elasticity.lame.T
    strain = stretch - 1.0
    stress = 2 * second[:, None] * strain + (first * strain.sum(axis=1))[:, None]
    per_volume = one_less_cosine * (np.maximum(stress, 0.0) * stretch).sum(axis=1)
    return float((elasticity.volume.sum(axis=1) * per_volume).sum())


def normal_impulse(state: State) -> float:
    """Sum of the normal impulses of the last step [mN s]."""
    return float(np.einsum("ci,ci->", state.contact_impulse, state.contact_normal))


def _rotations_and_stretches(simulation: Simulation, state: State) -> tuple[np.ndarray, np.ndarray]:
    """Polar rotations of linear tetrahedra, shape (element_count, 3, 3), and their principal stretches, (.., 3)."""
    elasticity = simulation.model.elasticity
    assert elasticity is not None
    deformation = np.einsum("eai,eaj->eij", state.position[elasticity.elements], elasticity.gradient[:, 0])
    left, stretch, right = np.linalg.svd(deformation)
    return left @ right, stretch


def _squared(vectors: np.ndarray) -> np.ndarray:
    return (vectors**2).sum(axis=-1)
