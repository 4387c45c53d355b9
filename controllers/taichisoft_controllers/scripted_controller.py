"""The controller "scripted": follows a file of keyframes, or of steps that may wait for conditions."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft.control import Control, Controller, Force, Observation, checked_force
from taichisoft.errors import ControlError, ControllerFailed, SceneError, StateError, nearest
from taichisoft.mechanics import ActuatorKind, Drive, kind_of
from taichisoft.scene import Number, Positive, find_file
from taichisoft_controllers.script_file import SUFFIXES, Interpolation, Keyframe, Script, Step, read_script
from taichisoft_controllers.script_targets import BaseMover, CommonWay, FreeBase, Ramp, Targets, Way, smoothed
from taichisoft_controllers.settings import DRIVES, ControllerSettings, table_of_drives
from taichisoft_controllers.step_in_progress import StepInProgress, Waiting

if TYPE_CHECKING:
    from taichisoft.contact import Model

# Forces from outside in keyframes and steps.


def read_forces(entry: Keyframe | Step, model: "Model", where: str) -> dict[str, Force]:
    """What a keyframe or step pushes with, by body or frame; `where` begins errors."""
    forces = {name: Force(**dict(table)) for name, table in entry.forces.items()}
    for name, force in forces.items():
        places = model.external_forces
        if name not in places.names:
            known = nearest(name, list(places.names), "there are")
            raise SceneError(f"{where}.forces: no body or frame is called '{name}'; {known}")
        try:
            checked_force(places, name, force, f"{where}.forces.{name}")
        except ControlError as error:
            raise SceneError(str(error)) from error
    return forces


# A controller that follows keyframes: values at given times, interpolated between them.


class KeyframeController(Controller):
    """Depends on the time alone; before the first keyframe and after the last it holds."""

    def __init__(self, path: Path, keyframes: Sequence[Keyframe], smooth: bool, factors: Mapping[Drive, float]):
        """Take the keyframes of a file; `factors` scale all pressures, pulls and tensions."""
        self._path, self._keyframes, self._smooth, self._factors = path, keyframes, smooth, factors
        self._times = np.array([frame.time for frame in keyframes])

    def reset(self, model: "Model") -> None:
        """Lay out the values by the model's cavities and cables."""
        self._targets = targets = Targets(model, FreeBase())
        places = [f"{self._path}: keyframes.{index}" for index in range(len(self._keyframes))]
        entries = list(zip(self._keyframes, places, strict=True))
        efforts = [targets.read_efforts(keyframe, where, self._factors) for keyframe, where in entries]
        named = np.zeros(len(targets.places), dtype=bool)
        named[[place for values in efforts for place in values]] = True
        self._driven = named | targets.driven_first
        self._check_complete(efforts)
        rotations = np.radians([frame.base_rotation for frame in self._keyframes])
        translations = [frame.base_translation for frame in self._keyframes]
        table = np.zeros((len(efforts), len(targets.places)))
        for row, values in zip(table, efforts, strict=True):
            row[list(values)] = list(values.values())
        poses = {name: np.zeros((len(entries), 6)) for name in targets.frames}
        for index, (keyframe, where) in enumerate(entries):
            for name, pose in targets.read_frames(keyframe, where).items():
                poses[name][index] = np.nan_to_num(pose)
        self._values = np.column_stack([table, *poses.values(), translations, rotations])
        self._read_forces(model, entries)

    def control(self, observation: Observation) -> Control:
        """The values at the start of the coming step."""
        control = self._targets.control(self._at(self._values, observation.time), self._driven)
        rows = zip(self._pushed.items(), self._at(self._pushes, observation.time), strict=True)
        return replace(control, forces={name: replace(like, force=f, torque=t) for (name, like), (f, t) in rows})

    def save(self) -> dict[str, Any]:
        """Nothing: the time says it all."""
        return {}

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Go on by the time."""

    def base_stops_at(self, observation: Observation) -> float:
        """The time of the last keyframe that has the base elsewhere than the one before."""
        base = self._values[:, self._targets.base]
        moved = np.flatnonzero((base[1:] != base[:-1]).any(axis=1))
        return max(observation.time, float(self._times[moved[-1] + 1])) if len(moved) else observation.time

    def _read_forces(self, model: "Model", entries: Sequence[tuple[Keyframe, str]]) -> None:
        self._pushed: dict[str, Force] = {}
        each = [read_forces(keyframe, model, where) for keyframe, where in entries]
        for forces, (_, where) in zip(each, entries, strict=True):
            for name, force in forces.items():
                first = self._pushed.setdefault(name, force)
                if (first.point, first.axes) != (force.point, force.axes):
                    raise SceneError(
                        f"{where}.forces.{name}: point and axes must be those of the keyframe that has it first"
                    )
        none = Force()
        of_each = [[forces.get(name, none) for name in self._pushed] for forces in each]
        rows = [[(force.force, force.torque) for force in forces] for forces in of_each]
        self._pushes = np.array(rows, dtype=np.float64).reshape(len(each), len(self._pushed), 2, 3)

    def _check_complete(self, efforts: Sequence[Mapping[int, float]]) -> None:
        """Refuse keyframes between which something would be undefined."""
        driven = [place for place, is_driven in zip(self._targets.places, self._driven, strict=True) if is_driven]
        actuators = [actuator for _, actuator in driven]
        for actuator in actuators:
            if actuators.count(actuator) > 1:
                drives = " and a ".join(drive.words for drive, other in driven if other == actuator)
                raise SceneError(f"{self._path}: '{actuator}' is given a {drives}; keyframes have one of them")
        for index, values in enumerate(efforts):
            for drive, actuator in driven:
                if self._targets.places[drive, actuator] not in values:
                    kind = kind_of(drive)
                    every = f"the {drive.name} of every {kind.name}"
                    every += "" if kind.always_driven and drive is kind.effort else " that another one names"
                    where = f"{self._path}: keyframes.{index}.{drive.name}"
                    raise SceneError(f"{where}: does not name '{actuator}'; a keyframe has {every}")

    def _at(self, values: np.ndarray, time: float) -> np.ndarray:
        after = int(np.searchsorted(self._times, time, side="right"))
        if after == 0 or after == len(self._times):
            return values[min(after, len(self._times) - 1)]
        start, end = self._times[after - 1], self._times[after]
        share = (time - start) / (end - start)
        if self._smooth:
            share = smoothed(share)
        return (1.0 - share) * values[after - 1] + share * values[after]


# A controller that follows steps one after the other, each until its way is done or its condition is true.

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
        """Check all names; the first step begins with the first observation."""
        self._targets = Targets(model, self._base)
        self._driven = self._targets.driven_first
        self._pushes = [
            read_forces(step, model, f"{self._path}: steps.{index}") for index, step in enumerate(self._steps)
        ]
        for index, waiting in enumerate(self._waiting):
            self._efforts(index)
            self._frames(index)
            if waiting is not None:
                waiting.reset(model)
        self._current, self._begun = None, []

    def control(self, observation: Observation) -> Control:
        """The values that the present step asks for."""
        values = self._values(observation)
        index = len(self._begun) - 1
        acting = self._pushes[index] if index < len(self._steps) else {}
        control = self._targets.control(values, self._driven, {SIGNAL: float(index)})
        return replace(control, forces={name: acting.get(name) for pushes in self._pushes for name in pushes})

    def save(self) -> dict[str, Any]:
        """When the steps began, what they drive, and how far the present one is."""
        return {
            "begun": list(self._begun),
            "driven": self._driven.tolist(),
            "step": self._current.save() if self._current is not None else None,
        }

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Go on in the step in which the run was."""
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
            text = ("not begun", "from {:.2f} s, not done", "{:.2f} to {:.2f} s")[len(times)]
            rows[self._label(index)] = text.format(*times)
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
        """The way from the values at the start of a step to its targets; after the last step it ends at once."""
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
        rates = dict(step)
        for drive, part in self._targets.parts.items():
            if rates[drive.rate] is not None:
                rate[part] = self._factors[drive] * rates[drive.rate]
        for name, frame in step.frames.items():
            speeds = [math.inf if speed is None else speed for speed in (frame.speed, frame.turning_speed)]
            rate[self._targets.frames[name]] = np.repeat(speeds, 3)
        return Ramp(start, target, change / rate, smooth=False)

    def _frames(self, index: int) -> dict[str, np.ndarray]:
        return self._targets.read_frames(self._steps[index], f"{self._path}: steps.{index}")

    def _efforts(self, index: int) -> dict[int, float]:
        """What a step requests of actuators, by the place in the array of targets."""
        where = f"{self._path}: steps.{index}"
        values = self._targets.read_efforts(self._steps[index], where, self._factors)
        actuators = [actuator for (_, actuator), place in self._targets.places.items() if place in values]
        twice = next((actuator for actuator in actuators if actuators.count(actuator) > 1), None)
        if twice is not None:
            raise SceneError(f"{where}: '{twice}' is given a pull and a tension; give one of them")
        return values

    def _label(self, index: int) -> str:
        """The name of a step in messages."""
        name = self._steps[index].name
        return f"steps.{index} '{name}'" if name else f"steps.{index}"


def _largest(drive: Drive, kind: ActuatorKind) -> tuple[str, Any, str]:
    words = drive.words
    meaning = f"Largest {words} [{drive.unit}], to which all {words}s and their rates are scaled; conditions stay."
    if drive.name == "pressure":  # tendons and valves cannot push or suck
        return drive.name, Number, f"{meaning.removesuffix('.')}; below 0, suction, in keyframes."
    return drive.name, Positive, meaning


LargestValues: Any = table_of_drives("LargestValues", ControllerSettings, _largest)


class ScriptSettings(LargestValues):  # type: ignore[misc] # a table with the keys of the drives
    """Settings of the controller "scripted"."""

    script: Path
    """The file, by path or by the name of a shipped one."""
    interpolation: Interpolation | None = None
    """`"linear"` or `"smooth"`, instead of the file's own."""


def scripted_controller(script: str | Path, interpolation: str | None = None, **largest: float | None) -> Controller:
    """The controller that does what a script says; `ScriptSettings` describes the arguments."""
    ScriptSettings.checked(script=script, interpolation=interpolation, **largest)
    path = find_file(script, "scripts", SUFFIXES, error=SceneError)
    content = read_script(path, Script)
    factors = scaling(content, path, largest)
    smooth = (interpolation or content.interpolation) == "smooth"
    if content.steps is not None:
        return StepController(path, content.steps, smooth, factors)
    return KeyframeController(path, content.keyframes or (), smooth, factors)


def scaling(content: Script, path: Path, largest: Mapping[str, float | None]) -> dict[Drive, float]:
    """The factors that make the largest pressure, pull and so on of a script what the settings want."""
    factors = {}
    for drive in DRIVES:
        wanted, highest = largest.get(drive.name), content.highest(drive)
        if wanted is not None and not highest > 0.0:
            raise SceneError(f"{path}: has no {drive.name} above 0 that controller.settings.{drive.name} could scale")
        if wanted is not None and (wanted == 0.0 or (wanted < 0.0 and content.steps is not None)):
            why = "must not be 0" if wanted == 0.0 else f"{path} has steps with rates, which suction cannot turn"
            raise SceneError(f"controller.settings.{drive.name} = {wanted:g}: {why}")
        factors[drive] = wanted / highest if wanted is not None else 1.0
    return factors
