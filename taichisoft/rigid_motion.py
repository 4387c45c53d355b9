"""Motion of the rigid bodies between contacts."""

import numpy as np

from taichisoft.model import Model
from taichisoft.placement import matrices_from_quaternions
from taichisoft.state import State


def velocity_without_contact(model: Model, state: State) -> np.ndarray:
    """Linear [mm/s] and angular [rad/s] velocities after a step without contacts, shape (rigid_count, 6).

    The gyroscopic torque is taken implicitly, one Newton step in the body frame, since the explicit one makes
    slender bodies spin up (Catto 2015, Physics for Game Programmers: Numerical Methods).
    """
    time_step = model.scene.time.step
    linear = state.rigid_velocity + time_step * model.gravity
    if not len(model.rigid_bodies):
        return np.zeros((0, 6))
    to_world = matrices_from_quaternions(state.rigid_rotation)
    local = np.einsum("bji,bj->bi", to_world, state.rigid_angular_velocity)
    inertia = model.rigid_inertia
    momentum = np.einsum("bij,bj->bi", inertia, local)
    residual = time_step * np.cross(local, momentum)
    jacobian = inertia + time_step * (_skew(local) @ inertia - _skew(momentum))
    local = local - np.linalg.solve(jacobian, residual[:, :, None])[:, :, 0]
    return np.concatenate([linear, np.einsum("bij,bj->bi", to_world, local)], axis=1)


def inverse_mass_matrices(model: Model, state: State) -> np.ndarray:
    """Inverse mass [1/kg] and inverse inertia [1/(kg mm^2)] in world axes, shape (rigid_count, 6, 6)."""
    count = len(model.rigid_bodies)
    result = np.zeros((count, 6, 6))
    to_world = matrices_from_quaternions(state.rigid_rotation)
    result[:, :3, :3] = np.eye(3) / model.rigid_mass[:, None, None]
    result[:, 3:, 3:] = to_world @ np.linalg.inv(model.rigid_inertia) @ to_world.transpose(0, 2, 1)
    return result


def _skew(vectors: np.ndarray) -> np.ndarray:
    """Matrices of the cross product with each vector, shape (count, 3, 3)."""
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    return np.stack(
        [np.stack([zero, -z, y], axis=1), np.stack([z, zero, -x], axis=1), np.stack([-y, x, zero], axis=1)], axis=1
    )
