"""Inverse kinematics by damped least squares, within the joints' limits, from several starts.

The damping is the one of Sugihara (2011, Solvability-unconcerned inverse kinematics by the Levenberg-Marquardt method,
IEEE Transactions on Robotics 27): half the square of the error, so that it vanishes as the pose is reached. A joint at
a limit that the step would cross is held there.
"""

import numpy as np
from scipy.stats import qmc

from taichisoft_arm.kinematic_chain import KinematicChain, turn_between

TOLERANCE = 2e-13
"""Error of a pose that is reached: of its place in shares of the chain's reach, and of its turn [rad]."""
STARTS = 48
"""Starts beside the one that is given; of 300 poses that the shipped arm reaches, 8 starts miss 7."""
MOST_STEPS = 60
BIAS = 1e-15
"""Damping that stays, so that the matrix of a stretched arm has an inverse."""


def solve_near(chain: KinematicChain, pose: np.ndarray, start: np.ndarray) -> np.ndarray | None:
    """Values of the joints that bring the link to a pose, found from a start alone, as along a path.

    Args:
        chain: the arm.
        pose: where the link shall be in the root's frame, shape (4, 4).
        start: values of the joints from which the search begins, shape (joint_count,).

    Returns:
        Shape (joint_count,), or None where the search ends elsewhere.
    """
    values, reached = _descend(chain, pose, np.asarray(start, dtype=np.float64)[None])
    return values[0] if reached[0] else None


def solve(chain: KinematicChain, pose: np.ndarray, start: np.ndarray) -> np.ndarray | None:
    """Values of the joints that bring the link to a pose: of all found, those that are reached soonest from a start.

    The same arguments give the same answer; `solve_near` describes them.

    Returns:
        Shape (joint_count,), or None where no search gets there: most likely the pose is out of reach.
    """
    start = np.asarray(start, dtype=np.float64)
    values, reached = _descend(chain, pose, np.vstack([start, _spread(chain)]))
    values = _nearest_turns(chain, values[reached], start)
    if not len(values):
        return None
    times = np.abs((values - start) / chain.speed).max(axis=1)
    return values[np.argmin(times)]


def pose_error(chain: KinematicChain, frames: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """What the link lacks of a pose: way in shares of the reach, and rotation vector [rad], shape (..., 6)."""
    link = frames[..., -1, :, :]
    way = (pose[:3, 3] - link[..., :3, 3]) / chain.reach
    return np.concatenate([way, turn_between(link[..., :3, :3], pose[:3, :3])], axis=-1)


def _descend(chain: KinematicChain, pose: np.ndarray, starts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where the searches from starts (count, joint_count) end, and whether each has reached the pose, (count,)."""
    values = np.clip(starts, chain.lowest, chain.highest)
    weight = np.array([1.0 / chain.reach] * 3 + [1.0] * 3)[:, None]
    unit = np.where(chain.slides, chain.reach, 1.0)  # a slide by the reach counts as a turn by 1 rad
    waiting = np.arange(len(values))
    for _ in range(MOST_STEPS):
        frames = chain.frames(values[waiting])
        error = pose_error(chain, frames, pose)
        going = np.abs(error).max(axis=1) > TOLERANCE
        waiting, frames, error = waiting[going], frames[going], error[going]
        if not len(waiting):
            break
        jacobian = weight * chain.jacobian(frames) * unit
        step = _step(chain, values[waiting], jacobian, error) * unit
        moved = np.clip(values[waiting] + step, chain.lowest, chain.highest)
        still = (moved == values[waiting]).all(axis=1)
        values[waiting] = moved
        waiting = waiting[~still]
    error = np.abs(pose_error(chain, chain.frames(values), pose)).max(axis=1)
    return values, error <= 5.0 * TOLERANCE


def _step(chain: KinematicChain, values: np.ndarray, jacobian: np.ndarray, error: np.ndarray) -> np.ndarray:
    """The damped steps at values (count, joint_count), for Jacobians (count, 6, joint_count) and errors (count, 6)."""
    gradient = np.einsum("cij,ci->cj", jacobian, error)
    held = ((values <= chain.lowest) & (gradient < 0.0)) | ((values >= chain.highest) & (gradient > 0.0))
    free = np.where(held[:, None, :], 0.0, jacobian)
    damping = 0.5 * np.einsum("ci,ci->c", error, error) + BIAS
    matrix = free @ np.swapaxes(free, 1, 2) + damping[:, None, None] * np.eye(6)
    return np.einsum("cij,ci->cj", free, np.linalg.solve(matrix, error[..., None])[..., 0])


def _spread(chain: KinematicChain) -> np.ndarray:
    """Starts all over the joints' ranges, the same ones always: a Halton sequence, shape (STARTS, joint_count)."""
    endless = np.isinf(chain.lowest)
    lowest, highest = np.where(endless, -np.pi, chain.lowest), np.where(endless, np.pi, chain.highest)
    shares = qmc.Halton(len(lowest), scramble=False).random(STARTS + 1)[1:]  # without the corner
    return lowest + shares * (highest - lowest)


def _nearest_turns(chain: KinematicChain, values: np.ndarray, start: np.ndarray) -> np.ndarray:
    """The same poses by whole turns nearer to the start, as far as the limits allow, shape (count, joint_count)."""
    turn = 2.0 * np.pi
    lowest, highest = np.ceil((chain.lowest - values) / turn), np.floor((chain.highest - values) / turn)
    turns = np.clip(np.round((start - values) / turn), lowest, highest)
    return np.where(chain.slides, values, values + turn * turns)
