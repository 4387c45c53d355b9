"""Is a new state still a simulation of something?"""

import numpy as np

from taichisoft.errors import SimulationDiverged
from taichisoft.kernels.inversion import count_inverted
from taichisoft.model import Model
from taichisoft.state import State

# A corotational element survives being inverted for a while; a body of which more than this share is, does not.
INVERTED_SHARE = 0.25
# Nothing moves by more than this many times its own size in a step, unless it did so before: a small body that falls
# freely does after a while, one that explodes does at once.
LARGEST_MOVE = 10.0

ADVICE = "a smaller time.step, a lower pressure or pressure rate, or a finer mesh"


class DivergenceCheck:
    """Compares the states before and after a step."""

    def __init__(self, model: Model):
        """Lay out the bodies: the soft ones by their nodes and elements, each rigid one by its centre."""
        self._model = model
        soft, rigid = model.soft_bodies, model.rigid_bodies
        self._names = [*(body.name for body in soft), *(body.name for body in rigid)]
        self._start = 3 * np.array([*(body.nodes.start for body in soft), *(model.node_count + np.arange(len(rigid)))])
        shapes = [*(body.rest_position for body in soft), *(body.vertices for body in rigid)]
        self._size = np.array([np.ptp(shape, axis=0).max() for shape in shapes])
        counts = [len(body.elements) for body in soft]
        self._element_count = np.array(counts)
        self._element_start = np.cumsum([0, *counts]).astype(np.int32)
        self._position = np.empty(3 * model.node_count)
        self._inverted = np.zeros(len(soft), dtype=np.int32)

    def __call__(self, before: State, after: State) -> None:
        """Check a step.

        Raises:
            SimulationDiverged: a value is not finite, a body explodes, or too many of its elements are inverted.
        """
        if not self._names:
            return
        with np.errstate(invalid="ignore", over="ignore"):  # what is not finite is found below
            self._check_moves(before, after)
        self._check_inverted(before.step, after.position)

    def _check_moves(self, before: State, after: State) -> None:
        move = _in_a_row(after.position, after.rigid_position) - _in_a_row(before.position, before.rigid_position)
        expected = self._model.scene.time.step * _in_a_row(before.velocity, before.rigid_velocity)
        size = np.abs(move)
        largest = np.maximum.reduceat(np.minimum(size, np.abs(move - expected)), self._start)
        # NaN goes through every maximum, and fails every comparison.
        good = largest <= LARGEST_MOVE * self._size
        soft_count = len(self._model.soft_bodies)
        good[soft_count:] &= np.isfinite(after.rigid_rotation).all(axis=1)
        if good.all():
            return
        body = int(np.argmin(good))
        extent = np.maximum.reduceat(size, self._start)[body]
        cause = "has a position that is not finite"
        if np.isfinite(extent) and largest[body] > LARGEST_MOVE * self._size[body]:
            cause = f"exploded: it would move {extent:.3g} mm in one step, over {LARGEST_MOVE:g} times its size"
        raise SimulationDiverged(self._names[body], before.step, cause, ADVICE)

    def _check_inverted(self, step: int, position: np.ndarray) -> None:
        if self._model.elasticity is None:
            return
        self._position[:] = position.reshape(-1)
        count_inverted(self._model.elasticity.elements, self._position, self._element_start, self._inverted)
        bad = self._inverted > INVERTED_SHARE * self._element_count
        if bad.any():
            body = int(np.argmax(bad))
            cause = f"has {self._inverted[body]} of {self._element_count[body]} elements turned inside out"
            raise SimulationDiverged(self._names[body], step, cause, ADVICE)


def _in_a_row(soft: np.ndarray, rigid: np.ndarray) -> np.ndarray:
    """All numbers of two arrays of vectors."""
    return np.concatenate([soft.reshape(-1), rigid.reshape(-1)])
