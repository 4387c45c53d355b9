"""A step of a script that goes on: its way, the condition that it waits for, its rest."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from taichisoft.control import Observation
from taichisoft.errors import ControllerFailed, SceneError
from taichisoft_controllers.scripted.condition import Quantity, Values, read_condition
from taichisoft_controllers.scripted.quantities import QUANTITIES, Reading, bind_quantity
from taichisoft_controllers.scripted.script_targets import Way

if TYPE_CHECKING:
    from taichisoft.model import Model

ROUND_OFF = 1e-9
"""Times this close are the same [s]: times of observations are sums of time steps."""


class Waiting:
    """A condition and how long it may take to become true."""

    def __init__(self, text: str, timeout: float, where: str):
        """Read the condition.

        Args:
            text: the condition.
            timeout: time after which the run fails [s].
            where: the beginning of every error, which says where the condition stands.

        Raises:
            SceneError: it is not understood.
        """
        self._timeout = timeout
        self._key = f"{where}: until = {text!r}"
        try:
            self._condition = read_condition(text, list(QUANTITIES))
        except SceneError as error:
            raise SceneError(f"{self._key}: {error}") from error
        self._readings: dict[Quantity, Reading] = {}

    def reset(self, model: "Model") -> None:
        """Find in a model what the condition names.

        Raises:
            SceneError: the model does not have it.
        """
        try:
            self._readings = {quantity: bind_quantity(quantity, model) for quantity in self._condition.quantities}
        except SceneError as error:
            raise SceneError(f"{self._key}: {error}") from error

    def is_over(self, observation: Observation, elapsed: float) -> bool:
        """Whether the condition is true, `elapsed` [s] after the waiting began.

        Raises:
            ControllerFailed: it is not, and the time is up; or it divides by zero.
        """
        values = {quantity: read(observation, elapsed) for quantity, read in self._readings.items()}
        try:
            if self._condition.holds(values):
                return True
        except ZeroDivisionError as error:
            raise ControllerFailed(
                f"{self._key} divides by zero at {observation.time:g} s: {_listed(values)}; "
                "ask first, as in: contact_force > 1 and friction_force / contact_force < 0.5"
            ) from error
        if elapsed >= self._timeout:
            raise ControllerFailed(
                f"{self._key} was not true within {self._timeout:g} s; at {observation.time:g} s: {_listed(values)}"
            )
        return False


def _listed(values: Values) -> str:
    return ", ".join(
        f"{quantity} = {value:.4g} {QUANTITIES[quantity.name].unit}".removesuffix(" 1")
        for quantity, value in values.items()
    )


class StepInProgress:
    """Goes along its way until it is done or the condition is true, then rests for `hold`.

    Attributes:
        begun: time at which the step began [s].
        values: what is asked for now, shape (value_count,).
    """

    def __init__(self, begun: float, way: Way, waiting: Waiting | None, hold: float):
        self.begun = begun
        self.values = way.start
        self._way, self._waiting, self._hold = way, waiting, hold
        self._rest_begun: float | None = None if waiting is not None else way.length

    def save(self) -> dict[str, Any]:
        """Where it is on its way; numbers of all values, in the order of the script's targets."""
        return {
            "begun": self.begun,
            "values": self.values.tolist(),
            "start": self._way.start.tolist(),
            "rest_begun": self._rest_begun,
        }

    @classmethod
    def restored(cls, saved: Mapping[str, Any], way: Way, waiting: Waiting | None, hold: float) -> Self:
        """The step that `save` described, with its way, what it waits for, and how long it then rests [s]."""
        step = cls(saved["begun"], way, waiting, hold)
        step.values, step._rest_begun = np.array(saved["values"]), saved["rest_begun"]
        return step

    def advance(self, observation: Observation, reached: np.ndarray) -> float | None:
        """Bring `values` to the observation's time.

        Args:
            observation: what is seen now.
            reached: what the scene's limits have left of `values` so far, shape (value_count,).

        Returns:
            The time at which the step ended [s], or None while it goes on.

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
