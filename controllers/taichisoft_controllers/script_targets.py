"""The targets of a script as one array: pressures, pulls and tensions, poses of frames, then what moves the base."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import numpy as np

from taichisoft.control import Control, Observation
from taichisoft.errors import SceneError, nearest
from taichisoft.mechanics import Drive, kind_of
from taichisoft_controllers.model_names import values_by_actuator
from taichisoft_controllers.settings import DRIVES, driven_anywhere, read_drive

if TYPE_CHECKING:
    from taichisoft.contact import Model
    from taichisoft_controllers.script_file import Keyframe, Step

TRANSLATION, ROTATION = slice(0, 3), slice(3, 6)
"""Translation [mm] and rotation vector [rad] in the values of a base that moves freely."""

Share = TypeVar("Share", float, np.ndarray)


class Way(Protocol):
    """The way of values from `start` to `target`, within `length` [s]."""

    @property
    def start(self) -> np.ndarray: ...
    @property
    def target(self) -> np.ndarray: ...
    @property
    def length(self) -> float: ...
    def at(self, elapsed: float) -> np.ndarray:
        """The values some time after the start [s], shape (value_count,)."""


class BaseMover(Protocol):
    """What moves the base of a script, by values of its own.

    Attributes:
        frames: names of the frames that it moves with the base, and that the script leaves alone.
    """

    frames: Collection[str]

    def reset(self, model: "Model") -> None:
        """Prepare for a run."""

    def observed(self, observation: Observation) -> np.ndarray:
        """The values in an observation, shape (value_count,)."""

    def reached(self, observation: Observation, values: np.ndarray) -> np.ndarray:
        """What the scene's limits have left of the values that were asked for, shape (value_count,)."""

    def way(self, step: "Step", start: np.ndarray, smooth: bool) -> Way:
        """The way from the values at the start of a step to its targets."""

    def control(self, values: np.ndarray) -> dict[str, Any]:
        """Arguments of the `Control` that asks for values."""


class FreeBase:
    """A base that goes to translations and rotations, as if nothing carried it."""

    frames: Collection[str] = ()

    def reset(self, model: "Model") -> None:
        """Nothing depends on the model."""

    def observed(self, observation: Observation) -> np.ndarray:
        """Where the base is, shape (6,)."""
        return np.concatenate([observation.base_translation, observation.base_rotation])

    def reached(self, observation: Observation, values: np.ndarray) -> np.ndarray:
        """Where the base is, as far as limits hold it back, shape (6,)."""
        reached, observed = values.copy(), self.observed(observation)
        for name, part in (("base_translation", TRANSLATION), ("base_rotation", ROTATION)):
            if name in observation.clipped:
                reached[part] = observed[part]
        return reached

    def way(self, step: "Step", start: np.ndarray, smooth: bool) -> Way:
        """The straight way to a step's translation and rotation."""
        target = start.copy()
        if step.base_translation is not None:
            target[TRANSLATION] = step.base_translation
        if step.base_rotation is not None:
            target[ROTATION] = np.radians(step.base_rotation)
        if step.duration is not None:
            return Ramp(start, target, np.full(len(start), step.duration), smooth)
        durations = np.zeros(len(start))
        if step.base_speed is not None:
            durations[TRANSLATION] = np.linalg.norm((target - start)[TRANSLATION]) / step.base_speed
        if step.base_turning_speed is not None:
            turn = np.degrees((target - start)[ROTATION])
            durations[ROTATION] = np.linalg.norm(turn) / step.base_turning_speed
        return Ramp(start, target, durations, smooth=False)

    def control(self, values: np.ndarray) -> dict[str, Any]:
        """The base's translation and rotation."""
        return {"base_translation": values[TRANSLATION], "base_rotation": values[ROTATION]}


class Targets:
    """Where the targets for a model stand in an array: every way to drive every actuator, frames, the base's values.

    Attributes:
        places: the place of an actuator that is driven in a way.
        parts: the places of all that can be driven in a way.
        frames: the places of the poses of frames that can be asked to move, each of 6 values [mm] and [rad], by name.
        base: the places of the base's values, behind all others.
        driven_first: whether what stands at a place is asked for as a script begins: pressures of cavities always are,
            cables and valves only when the script names them; shape (len(places),).
    """

    def __init__(self, model: "Model", base: BaseMover):
        """Lay out the array; `base` is what moves the base."""
        self._mover = base
        base.reset(model)
        self._names = {drive: driven_anywhere(drive, model) for drive in DRIVES}
        ways = [(drive, actuator) for drive, names in self._names.items() for actuator in names]
        self.places = {way: place for place, way in enumerate(ways)}
        self.parts: dict[Drive, slice] = {}
        place = 0
        for drive in DRIVES:
            self.parts[drive] = slice(place, place + len(self._names[drive]))
            place = self.parts[drive].stop
        frames = {name: table for name, table in model.scene.frames.items() if table.path is None}
        tables = {name: table for name, table in frames.items() if name not in base.frames}
        self.frames = {name: slice(place + 6 * n, place + 6 * n + 6) for n, name in enumerate(tables)}
        self._axes = {name: table.hinge.unit_axis for name, table in tables.items() if table.hinge is not None}
        self.base = slice(len(ways) + 6 * len(tables), None)
        kinds = [kind_of(drive) for drive, _ in ways]
        first = [kind.always_driven and drive is kind.effort for kind, (drive, _) in zip(kinds, ways, strict=True)]
        self.driven_first = np.array(first, dtype=bool)

    def read_efforts(self, entry: "Keyframe | Step", where: str, factors: Mapping[Drive, float]) -> dict[int, float]:
        """What a keyframe or step requests of actuators, scaled, by places; `where` begins errors."""
        given, values = dict(entry), dict[int, float]()
        for drive, names in self._names.items():
            if given[drive.name] is None:
                continue
            try:
                by_actuator = values_by_actuator(given[drive.name], names, kind_of(drive).name)
            except SceneError as error:
                raise SceneError(f"{where}.{drive.name}: {error}") from error
            values |= {self.places[drive, actuator]: factors[drive] * value for actuator, value in by_actuator.items()}
        return values

    def read_frames(self, entry: "Keyframe | Step", where: str) -> dict[str, np.ndarray]:
        """Poses that a keyframe or step gives, shape (6,) [mm] and [rad], by frame, NaN for what it does not give."""
        poses = {}
        for name, place in entry.frames.items():
            if name not in self.frames:
                known = nearest(name, list(self.frames), "there are")
                raise SceneError(f"{where}.frames: no frame that scripts can move is called '{name}'; {known}")
            if (name in self._axes) != (place.angle is not None):
                needed = "a hinge; give angle" if name in self._axes else "no hinge; give translation or rotation"
                raise SceneError(f"{where}.frames: '{name}' has {needed}")
            rotation = place.rotation if place.angle is None else place.angle * self._axes[name]
            rows = [np.full(3, np.nan) if row is None else np.asarray(row) for row in (place.translation, rotation)]
            poses[name] = np.concatenate([rows[0], np.radians(rows[1])])
        return poses

    def observed(self, observation: Observation) -> np.ndarray:
        """The values in an observation, shape (value_count,)."""
        return np.concatenate([self.observed_others(observation), self._mover.observed(observation)])

    def observed_others(self, observation: Observation) -> np.ndarray:
        """The values of actuators and frames in an observation, which stand before those of the base."""
        values = [read_drive(drive, observation, actuator) for drive, actuator in self.places]
        poses = [(observation.frame_translations[name], observation.frame_rotations[name]) for name in self.frames]
        return np.concatenate([values, np.ravel(poses)])

    def reached(self, observation: Observation, values: np.ndarray) -> np.ndarray:
        """The values that were asked for; where the scene's limits held them back, the values that were reached."""
        if not observation.clipped:
            return values
        reached = values.copy()
        for (drive, actuator), place in self.places.items():
            if actuator in observation.clipped:
                reached[place] = read_drive(drive, observation, actuator)
        observed = self.observed_others(observation)
        for name, frame in self.frames.items():
            halves = slice(frame.start, frame.start + 3), slice(frame.start + 3, frame.stop)
            for part, half in zip(("translation", "rotation"), halves, strict=True):
                if f"{name}_{part}" in observation.clipped:
                    reached[half] = observed[half]
        reached[self.base] = self._mover.reached(observation, values[self.base])
        return reached

    def drive(self, driven: np.ndarray, chosen: np.ndarray) -> np.ndarray:
        """What is asked for when the chosen places are, too: each actuator in one way only; shapes (len(places),)."""
        ways, also = list(self.places), np.flatnonzero(chosen)
        actuators = {ways[place][1] for place in also}
        kept = [asked and actuator not in actuators for asked, (_, actuator) in zip(driven, ways, strict=True)]
        return np.array(kept, dtype=bool) | chosen

    def control(self, values: np.ndarray, driven: np.ndarray, signals: Mapping[str, float] | None = None) -> Control:
        """The control for values, shape (value_count,), at the places that are driven, shape (len(places),)."""
        asked: dict[str, dict[str, float]] = {drive.request: {} for drive in DRIVES}
        for (drive, actuator), value, is_driven in zip(self.places, values.tolist(), driven, strict=False):
            if is_driven:
                asked[drive.request][actuator] = value
        moved: dict[str, dict[str, Any]] = {"frame_translation": {}, "frame_rotation": {}, "frame_angle": {}}
        for name, place in self.frames.items():
            if name in self._axes:
                moved["frame_angle"][name] = float(values[place][3:] @ self._axes[name])
            else:
                moved["frame_translation"][name], moved["frame_rotation"][name] = values[place].reshape(2, 3)
        base = self._mover.control(values[self.base])
        for key, ones in (("signals", signals or {}), *moved.items()):
            base[key] = {**ones, **base.get(key, {})}
        return Control(**asked, **base)  # type: ignore[arg-type] # keys of actuators alone


def smoothed(share: Share) -> Share:
    """The share of a way that is done after a share of its time, at rest at both ends."""
    return share * share * (3.0 - 2.0 * share)


@dataclass(frozen=True)
class Ramp:
    """The way of values from `start` to `target`, each within a time of its own.

    Attributes:
        start, target: values at both ends, shape (value_count,).
        durations: time of each value's way [s], shape (value_count,); 0 where it does not move.
        smooth: whether it starts and ends at rest, instead of going at a constant rate.
    """

    start: np.ndarray
    target: np.ndarray
    durations: np.ndarray
    smooth: bool

    @property
    def length(self) -> float:
        """The time until the last value has arrived [s]."""
        return float(self.durations.max(initial=0.0))

    def at(self, elapsed: float) -> np.ndarray:
        """The values some time after the start [s], shape (value_count,)."""
        moving = elapsed < self.durations
        share = np.divide(elapsed, self.durations, out=np.ones_like(self.durations), where=moving)
        if self.smooth:
            share = smoothed(share)
        return np.where(moving, self.start + share * (self.target - self.start), self.target)


@dataclass(frozen=True)
class CommonWay:
    """The ways of actuators and frames, and of the base, at the same time."""

    others: Way
    base: Way

    @property
    def start(self) -> np.ndarray:
        """Values at the beginning, shape (value_count,)."""
        return np.concatenate([self.others.start, self.base.start])

    @property
    def target(self) -> np.ndarray:
        """Values at the end, shape (value_count,)."""
        return np.concatenate([self.others.target, self.base.target])

    @property
    def length(self) -> float:
        """The time until the last value has arrived [s]."""
        return max(self.others.length, self.base.length)

    def at(self, elapsed: float) -> np.ndarray:
        """The values some time after the start [s], shape (value_count,)."""
        return np.concatenate([self.others.at(elapsed), self.base.at(elapsed)])
