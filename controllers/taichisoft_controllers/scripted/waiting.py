"""Waiting for a condition while a model runs, and giving up when that takes too long."""

from typing import TYPE_CHECKING

from taichisoft.control.observation import Observation
from taichisoft.errors import ControllerFailed, SceneError
from taichisoft_controllers.scripted.condition import read_condition
from taichisoft_controllers.scripted.condition_reader import Quantity, Values
from taichisoft_controllers.scripted.quantities import QUANTITIES, Moment, Reading, bind_quantity

if TYPE_CHECKING:
    from taichisoft.model import Model


class Waiting:
    """A condition and how long it may take [s]."""

    def __init__(self, text: str, timeout: float, where: str):
        """Read the condition; `where` it stands begins every error.

        Raises:
            SceneError: it is not understood.
        """
        self._timeout, self._where = timeout, where
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
        """Whether the condition is true, `elapsed` after the waiting began [s].

        Raises:
            ControllerFailed: it is not, and the time is up; or it divides by zero.
        """
        moment = Moment(observation, elapsed)
        values = {quantity: read(moment) for quantity, read in self._readings.items()}
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
