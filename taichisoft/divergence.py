"""Is a new state still a simulation of something?"""

import numpy as np

from taichisoft.errors import SimulationDiverged
from taichisoft.model import Model
from taichisoft.soft_body import SoftBody
from taichisoft.state import State

# A corotational element survives being inverted for a while; a body of which more than this share is, does not.
INVERTED_SHARE = 0.25
# Nothing moves by more than this many times its own size in a step, unless it did so before: a small body that falls
# freely does after a while, one that explodes does at once.
LARGEST_MOVE = 10.0

ADVICE = "a smaller time.step, a lower pressure or pressure rate, or a finer mesh"


def check_state(model: Model, before: State, after: State) -> None:
    """Compare the state before and after a step.

    Raises:
        SimulationDiverged: a value is not finite, a body explodes, or too many of its elements are inverted.
    """
    time_step = model.scene.time.step
    for body in model.soft_bodies:
        move = after.position[body.nodes] - before.position[body.nodes]
        expected = time_step * before.velocity[body.nodes]
        _check_move(body.name, before.step, move, expected, np.ptp(body.rest_position, axis=0).max())
        _check_inverted(body, before.step, after.position[body.nodes])
    for index, rigid in enumerate(model.rigid_bodies):
        move = after.rigid_position[index] - before.rigid_position[index]
        expected = time_step * before.rigid_velocity[index]
        _check_finite(rigid.name, before.step, after.rigid_rotation[index])
        _check_move(rigid.name, before.step, move, expected, np.ptp(rigid.vertices, axis=0).max())


def _check_move(name: str, step: int, move: np.ndarray, expected: np.ndarray, size: float) -> None:
    _check_finite(name, step, move)
    limit = LARGEST_MOVE * size
    largest = float(np.minimum(np.abs(move), np.abs(move - expected)).max())
    if largest > limit:
        cause = f"exploded: it would move {np.abs(move).max():.3g} mm in one step, over {LARGEST_MOVE:g} times its size"
        raise SimulationDiverged(name, step, cause, ADVICE)


def _check_finite(name: str, step: int, values: np.ndarray) -> None:
    if not np.isfinite(values).all():
        raise SimulationDiverged(name, step, "has a position that is not finite", ADVICE)


def _check_inverted(body: SoftBody, step: int, position: np.ndarray) -> None:
    origin, first, second, third = (position[body.elements[:, corner]] for corner in range(4))
    volumes = np.einsum("ed,ed->e", np.cross(first - origin, second - origin), third - origin)
    count = int((volumes <= 0.0).sum())
    if count > INVERTED_SHARE * len(body.elements):
        cause = f"has {count} of {len(body.elements)} elements turned inside out"
        raise SimulationDiverged(body.name, step, cause, ADVICE)
