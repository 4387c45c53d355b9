"""A step of a script that goes on: its way, its condition, its rest."""

import numpy as np

from taichisoft.control.observation import Observation
from taichisoft_controllers.scripted.ramp import Ramp
from taichisoft_controllers.scripted.waiting import Waiting

ROUND_OFF = 1e-9
"""Times this close are the same [s]: those of an observation are sums of time steps."""


class StepInProgress:
    """Goes along its way until it is done or the condition is true, then rests for `hold`.

    Attributes:
        begun: when [s].
        values: asked for now, shape (value_count,).
    """

    def __init__(self, begun: float, way: Ramp, waiting: Waiting | None, hold: float):
        self.begun = begun
        self.values = way.start
        self._way, self._waiting, self._hold = way, waiting, hold
        self._rest_begun: float | None = None if waiting is not None else way.length

    def advance(self, observation: Observation, reached: np.ndarray) -> float | None:
        """Bring `values` to the observation's time.

        Args:
            observation: of this moment.
            reached: what the scene's limits have left of `values` so far, shape (value_count,).

        Returns:
            When the step ended [s], or None while it goes on.

        Raises:
            ControllerFailed: the condition was not true in time.
        """
        elapsed = max(0.0, observation.time - self.begun)
        if self._waiting is None:
            self.values = self._way.at(elapsed) if elapsed + ROUND_OFF < self._way.length else self._way.target
        elif self._rest_begun is None and self._waiting.is_over(observation, elapsed + ROUND_OFF):
            self._rest_begun, self.values = elapsed, reached
        elif self._rest_begun is None:
            self.values = self._way.at(elapsed)
        if self._rest_begun is None or elapsed + ROUND_OFF < self._rest_begun + self._hold:
            return None
        return self.begun + self._rest_begun + self._hold
