"""A controller that follows steps one after the other, each until its way is done or its condition is true."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft.actuators import Drive
from taichisoft.control import Control, Controller, Observation
from taichisoft.errors import ControllerFailed, SceneError, StateError
from taichisoft_controllers.drives import DRIVES
from taichisoft_controllers.scripted.script_file import Step
from taichisoft_controllers.scripted.script_targets import BaseMover, CommonWay, FreeBase, Ramp, Targets, Way
from taichisoft_controllers.scripted.step_in_progress import StepInProgress, Waiting

if TYPE_CHECKING:
    from taichisoft.model import Model

SIGNAL = "script_step"
"""Name of the signal that gives the index of the step that goes on; the number of steps when all are done."""
REST = Step(hold=1.0)
"""What follows the last step: nothing moves."""


class StepController(Controller):
    """Begins with the first step whenever it is reset; after the last one it holds."""

    def __init__(
        self,
        path: Path,
        steps: Sequence[Step],
        smooth: bool,
        factors: Mapping[Drive, float],
        base: BaseMover | None = None,
    ):
        """Read the conditions of a file's steps.

        Args:
            path: the file.
            steps: its steps.
            smooth: whether motions of a duration start and end at rest.
            factors: of pressures, pulls and tensions, and of their rates.
            base: what moves the base; None: nothing carries it.

        Raises:
            SceneError: a condition is not understood.
        """
        self._path, self._steps, self._smooth, self._factors = path, steps, smooth, factors
        self._base: BaseMover = base or FreeBase()
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
            SceneError: a step names an unknown finger, cavity, cable or body.
        """
        self._targets = Targets(model, self._base)
        self._driven = self._targets.driven_first
        for index, waiting in enumerate(self._waiting):
            self._efforts(index)
            self._frames(index)
            if waiting is not None:
                waiting.reset(model)
        self._current, self._begun = None, []

    def control(self, observation: Observation) -> Control:
        """The values that the present step asks for.

        Raises:
            ControllerFailed: a condition was not true in time.
        """
        values = self._values(observation)
        return self._targets.control(values, self._driven, {SIGNAL: float(len(self._begun) - 1)})

    def save(self) -> dict[str, Any]:
        """When the steps began, what they drive, and how far the present one is."""
        return {
            "begun": list(self._begun),
            "driven": self._driven.tolist(),
            "step": self._current.save() if self._current is not None else None,
        }

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Go on in the step in which the run was.

        Raises:
            StateError: the script has fewer steps, or drives other things.
        """
        begun, driven, step = list(saved["begun"]), np.array(saved["driven"], dtype=bool), saved["step"]
        if len(begun) > len(self._steps) + 1 or len(driven) != len(self._driven):
            raise StateError(
                f"{self._path}: not the script that the controller followed, which was at steps.{len(begun) - 1}; "
                "`taichisoft resume --reset-controller` begins with the first step"
            )
        self._begun, self._driven, index = begun, driven, len(begun) - 1
        if step is not None:
            self._current = StepInProgress.restored(step, self._way(index, step["start"]), *self._end_of(index))

    def base_stops_at(self, observation: Observation) -> float:
        """The end of the last way of the base, as if every condition were true at once."""
        time, values, base = observation.time, self._targets.observed(observation), self._targets.base
        stops = time
        for index, step in enumerate(self._steps):
            way = self._way(index, values)
            waits = self._waiting[index] is not None
            if (way.target != values)[base].any():
                stops = time + (0.0 if waits else way.base.length)
            time += (0.0 if waits else way.length) + (step.hold or 0.0)
            values = way.target
        return stops

    def summary(self) -> dict[str, str]:
        """Rows that say when each step was made."""
        rows = {}
        for index in range(len(self._steps)):
            times = self._begun[index : index + 2]
            said = ("not begun", "from {:.2f} s, not done", "{:.2f} to {:.2f} s")[len(times)]
            rows[self._label(index)] = said.format(*times)
        return rows

    def _values(self, observation: Observation) -> np.ndarray:
        """The values at the time of an observation, shape (value_count,)."""
        if self._current is None:
            self._current = self._begin(observation.time, self._targets.observed(observation), observation)
        while len(self._begun) <= len(self._steps):
            ended = self._current.advance(observation, self._targets.reached(observation, self._current.values))
            if ended is None:
                break
            self._current = self._begin(ended, self._current.values, observation)
        return self._current.values

    def _begin(self, time: float, values: np.ndarray, observation: Observation) -> StepInProgress:
        """The next step, or, after the last, a step that does not end; it continues from `values`.

        Actuators that were not driven before continue from their observed values.
        """
        index = len(self._begun)
        self._begun.append(time)
        waiting, hold = self._end_of(index)
        if index == len(self._steps):
            return StepInProgress(time, self._way(index, values), waiting, hold)
        chosen = np.zeros(len(self._driven), dtype=bool)
        chosen[list(self._efforts(index))] = True
        start = values.copy()
        begins = np.flatnonzero(chosen & ~self._driven)
        start[begins] = self._targets.observed_others(observation)[begins]
        self._driven = self._targets.drive(self._driven, chosen)
        return StepInProgress(time, self._way(index, start), waiting, hold)

    def _end_of(self, index: int) -> tuple[Waiting | None, float]:
        """What a step waits for, and how long it then rests [s]; what comes after the last step does not end."""
        if index == len(self._steps):
            return None, math.inf
        return self._waiting[index], self._steps[index].hold or 0.0

    def _way(self, index: int, start: Sequence[float] | np.ndarray) -> CommonWay:
        """The way from the values at the start of a step to its targets; after the last step it ends at once.

        Raises:
            ControllerFailed: what moves the base cannot go this way.
        """
        last = index == len(self._steps)
        step, efforts = (REST, {}) if last else (self._steps[index], self._efforts(index))
        others, base = np.split(np.asarray(start, dtype=np.float64), [self._targets.base.start])
        try:
            base_way = self._base.way(step, base, self._smooth)
        except ControllerFailed as error:
            raise ControllerFailed(f"{self._path}: {self._label(index)}: {error}") from error
        poses = {} if last else self._frames(index)
        return CommonWay(self._others_way(step, others, efforts, poses), base_way)

    def _others_way(
        self, step: Step, start: np.ndarray, efforts: Mapping[int, float], poses: Mapping[str, np.ndarray]
    ) -> Way:
        """The way of actuators and frames; `efforts` has targets by place, `poses` by frame."""
        target = start.copy()
        target[list(efforts)] = list(efforts.values())
        for name, pose in poses.items():
            place = self._targets.frames[name]
            target[place] = np.where(np.isnan(pose), start[place], pose)
        if step.duration is not None:
            return Ramp(start, target, np.full(len(start), step.duration), self._smooth)
        change = np.abs(target - start)
        for place in self._targets.frames.values():
            way = change[place].reshape(2, 3)
            change[place] = np.repeat(np.linalg.norm(way, axis=1) * [1.0, math.degrees(1.0)], 3)
        rate = np.full(len(start), math.inf)  # where none is given nothing moves
        for drive, part in self._targets.parts.items():
            given = getattr(step, drive.rate)
            if given is not None:
                rate[part] = self._factors[drive] * given
        for name, frame in step.frames.items():
            speeds = [math.inf if speed is None else speed for speed in (frame.speed, frame.turning_speed)]
            rate[self._targets.frames[name]] = np.repeat(speeds, 3)
        return Ramp(start, target, change / rate, smooth=False)

    def _frames(self, index: int) -> dict[str, np.ndarray]:
        """Poses of frames that a step asks for, NaN for what stays, shape (6,) each, by name."""
        try:
            return self._targets.read_frames(self._steps[index].frames)
        except SceneError as error:
            raise SceneError(f"{self._path}: steps.{index}.frames: {error}") from error

    def _efforts(self, index: int) -> dict[int, float]:
        """What a step asks of actuators, scaled, by the place in the array of targets."""
        step = self._steps[index]
        values: dict[int, float] = {}
        for drive in DRIVES:
            given = getattr(step, drive.name)
            try:
                read = self._targets.read(drive, {} if given is None else given)
            except SceneError as error:
                raise SceneError(f"{self._path}: steps.{index}.{drive.name}: {error}") from error
            values |= {place: self._factors[drive] * value for place, value in read.items()}
        actuators = [actuator for (_, actuator), place in self._targets.places.items() if place in values]
        for actuator in actuators:
            if actuators.count(actuator) > 1:
                where = f"{self._path}: steps.{index}"
                raise SceneError(f"{where}: '{actuator}' is given a pull and a tension; give one of them")
        return values

    def _label(self, index: int) -> str:
        """The name of a step in messages."""
        name = self._steps[index].name
        return f"steps.{index} '{name}'" if name else f"steps.{index}"
