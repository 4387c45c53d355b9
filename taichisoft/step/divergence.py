"""Is a new state still a simulation of something?"""

import numpy as np

from taichisoft.errors import SimulationDiverged
from taichisoft.kernels import divergence as kernels
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
        soft, rigid, node_count = model.soft_bodies, model.rigid_bodies, model.node_count
        self._names = [*(body.name for body in soft), *(body.name for body in rigid)]
        shapes = [*(body.rest_position for body in soft), *(body.vertices for body in rigid)]
        self._limit = LARGEST_MOVE * np.array([np.ptp(shape, axis=0).max() for shape in shapes])
        starts = [*(body.nodes.start for body in soft), *range(node_count, node_count + len(rigid) + 1)]
        self._start = np.array(starts, dtype=np.int32)
        counts = [len(body.elements) for body in soft]
        self._element_count = np.array(counts)
        self._element_start = np.cumsum([0, *counts]).astype(np.int32)
        self._before, self._velocity, self._after = (np.empty((node_count + len(rigid), 3)) for _ in range(3))
        self._leap = np.empty(len(shapes))
        self._inverted = np.zeros(len(soft), dtype=np.int32)

    def __call__(self, before: State, after: State) -> None:
        """Check a step.

        Raises:
            SimulationDiverged: a value is not finite, a body explodes, or too many of its elements are inverted.
        """
        soft_nodes = slice(self._model.node_count)
        centres = slice(self._model.node_count, None)
        self._before[soft_nodes], self._before[centres] = before.position, before.rigid_position
        self._velocity[soft_nodes], self._velocity[centres] = before.velocity, before.rigid_velocity
        self._after[soft_nodes], self._after[centres] = after.position, after.rigid_position
        self._check_finite(before.step, after.rigid_rotation)
        self._check_leaps(before.step)
        self._check_inverted(before.step)

    def _check_finite(self, step: int, rigid_rotation: np.ndarray) -> None:
        if np.isfinite(self._after).all() and np.isfinite(rigid_rotation).all():
            return
        turned = np.isfinite(rigid_rotation).all(axis=1)
        finite = np.isfinite(self._after).all(axis=1) & np.append(np.ones(self._model.node_count, dtype=bool), turned)
        body = int(np.searchsorted(self._start, np.argmin(finite), side="right")) - 1
        raise SimulationDiverged(self._names[body], step, "has a position that is not finite", ADVICE)

    def _check_leaps(self, step: int) -> None:
        time_step = self._model.scene.time.step
        kernels.largest_leaps(time_step, self._before, self._velocity, self._after, self._start, self._leap)
        leaps = self._leap > self._limit
        if leaps.any():
            body = int(np.argmax(leaps))
            points = slice(self._start[body], self._start[body + 1])
            move = np.abs(self._after[points] - self._before[points]).max()
            cause = f"exploded: it would move {move:.3g} mm in one step, over {LARGEST_MOVE:g} times its size"
            raise SimulationDiverged(self._names[body], step, cause, ADVICE)

    def _check_inverted(self, step: int) -> None:
        if self._model.elasticity is None:
            return
        kernels.count_inverted(self._model.elasticity.elements, self._after, self._element_start, self._inverted)
        bad = self._inverted > INVERTED_SHARE * self._element_count
        if bad.any():
            body = int(np.argmax(bad))
            cause = f"has {self._inverted[body]} of {self._element_count[body]} elements turned inside out"
            raise SimulationDiverged(self._names[body], step, cause, ADVICE)
