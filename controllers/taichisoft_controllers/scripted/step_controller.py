"""A controller that follows steps one after the other, each until its way is done or its condition is true."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from taichisoft.control.control import Control
from taichisoft.control.controller import Controller
from taichisoft.control.observation import Observation
from taichisoft.errors import SceneError
from taichisoft_controllers.model_names import pressures_by_cavity
from taichisoft_controllers.scripted.script_file import Step
from taichisoft_controllers.scripted.step_in_progress import StepInProgress, Waiting
from taichisoft_controllers.scripted.targets import PRESSURES, ROTATION, TRANSLATION, Ramp, as_control

if TYPE_CHECKING:
    from taichisoft.model import Model

SIGNAL = "script_step"
"""Name of the signal that gives the index of the step that goes on; the number of steps when all are done."""


class StepController(Controller):
    """Begins with the first step whenever it is reset; after the last one it holds."""

    def __init__(self, path: Path, steps: Sequence[Step], smooth: bool, factor: float):
        """Read the conditions of a file's steps; `factor` scales all pressures and their rates.

        Raises:
            SceneError: a condition is not understood.
        """
        self._path, self._steps, self._smooth, self._factor = path, steps, smooth, factor
        self._waiting = [
            Waiting(step.until, step.timeout, f"{path}: {self._label(index)}")
            if step.until is not None and step.timeout is not None
            else None
            for index, step in enumerate(steps)
        ]
        self._current: StepInProgress | None = None
        self._begun: list[float] = []

    def reset(self, model: "Model") -> None:
        """Check all names; the first step begins with the first observation.

        Raises:
            SceneError: a step names a finger, cavity or body that there is not.
        """
        self._cavities = model.cavities.names
        for index, waiting in enumerate(self._waiting):
            self._pressures(index)
            if waiting is not None:
                waiting.reset(model)
        self._current, self._begun = None, []

    def control(self, observation: Observation) -> Control:
        """The values that the present step asks for.

        Raises:
            ControllerFailed: a condition was not true in time.
        """
        values = self._values(observation)
        return as_control(self._cavities, values, {SIGNAL: float(len(self._begun) - 1)})

    def summary(self) -> dict[str, str]:
        """Rows that say when each step was made."""
        rows = {}
        for index in range(len(self._steps)):
            times = self._begun[index : index + 2]
            said = ("not begun", "from {:.2f} s, not done", "{:.2f} to {:.2f} s")[len(times)]
            rows[self._label(index)] = said.format(*times)
        return rows

    def _values(self, observation: Observation) -> np.ndarray:
        """The values at the time of an observation, shape (cavity_count + 6,)."""
        if self._current is None:
            pressures = [observation.pressures[name] for name in self._cavities]
            start = np.array([*pressures, *observation.base_translation, *observation.base_rotation])
            self._current = self._begin(observation.time, start)
        while len(self._begun) <= len(self._steps):
            ended = self._current.advance(observation, self._reached(observation, self._current.values))
            if ended is None:
                break
            self._current = self._begin(ended, self._current.values)
        return self._current.values

    def _reached(self, observation: Observation, values: np.ndarray) -> np.ndarray:
        """The values that were asked for, but where the scene's limits held them back those that were reached."""
        if not observation.clipped:
            return values
        reached = values.copy()
        for index, cavity in enumerate(self._cavities):
            if cavity in observation.clipped:
                reached[index] = observation.pressures[cavity]
        if "base_translation" in observation.clipped:
            reached[TRANSLATION] = observation.base_translation
        if "base_rotation" in observation.clipped:
            reached[ROTATION] = observation.base_rotation
        return reached

    def _begin(self, time: float, start: np.ndarray) -> StepInProgress:
        """The step after those that have begun, or, after the last, one that does not end."""
        index = len(self._begun)
        self._begun.append(time)
        if index == len(self._steps):
            return StepInProgress(time, Ramp(start, start, np.zeros(len(start)), False), None, math.inf)
        step = self._steps[index]
        return StepInProgress(time, self._way(index, start), self._waiting[index], step.hold or 0.0)

    def _way(self, index: int, start: np.ndarray) -> Ramp:
        """The way from the values at the start of a step to its targets."""
        step, target = self._steps[index], start.copy()
        for cavity, pressure in self._pressures(index).items():
            target[self._cavities.index(cavity)] = self._factor * pressure
        if step.base_translation is not None:
            target[TRANSLATION] = step.base_translation
        if step.base_rotation is not None:
            target[ROTATION] = np.radians(step.base_rotation)
        if step.duration is not None:
            return Ramp(start, target, np.full(len(start), step.duration), self._smooth)
        change = np.abs(target - start)
        change[TRANSLATION] = np.linalg.norm(change[TRANSLATION])
        change[ROTATION] = np.linalg.norm(np.degrees(change[ROTATION]))
        rate = np.full(len(start), math.inf)  # where none is given nothing moves
        if step.pressure_rate is not None:
            rate[PRESSURES] = self._factor * step.pressure_rate
        if step.base_speed is not None:
            rate[TRANSLATION] = step.base_speed
        if step.base_turning_speed is not None:
            rate[ROTATION] = step.base_turning_speed
        return Ramp(start, target, change / rate, smooth=False)

    def _pressures(self, index: int) -> dict[str, float]:
        """Pressures of the cavities that a step names [kPa]."""
        pressure = self._steps[index].pressure
        try:
            return pressures_by_cavity({} if pressure is None else pressure, self._cavities)
        except SceneError as error:
            raise SceneError(f"{self._path}: steps.{index}.pressure: {error}") from error

    def _label(self, index: int) -> str:
        """The name of a step in messages."""
        name = self._steps[index].name
        return f"steps.{index} '{name}'" if name else f"steps.{index}"
