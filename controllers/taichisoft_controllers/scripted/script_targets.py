"""The targets of a script as one array: pressures, pulls and tensions, poses of frames, pose of the base."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from taichisoft.actuators import Drive, kind_of
from taichisoft.control import Control, Observation
from taichisoft.errors import SceneError, nearest
from taichisoft_controllers.drives import DRIVES, driven_by, read_drive
from taichisoft_controllers.model_names import values_by_actuator

if TYPE_CHECKING:
    from taichisoft.model import Model
    from taichisoft_controllers.scripted.script_file import FramePlace

TRANSLATION, ROTATION = slice(-6, -3), slice(-3, None)
"""The base [mm] and [rad] in an array of targets."""

Share = TypeVar("Share", float, np.ndarray)


class Targets:
    """Where the targets for a model stand in an array: every way to drive every actuator, frames, then the base.

    Attributes:
        places: the place of an actuator that is driven in a way.
        parts: the places of all that can be driven in a way.
        frames: the places of the poses of frames that can be asked to move, each of 6 values [mm] and [rad], by name.
        count: number of values.
        driven_first: whether what stands at a place is asked for as a script begins: pressures of cavities always are,
            cables and valves only when the script names them; shape (len(places),).
    """

    def __init__(self, model: "Model"):
        """Lay out the array."""
        self._names = {drive: driven_by(drive, model) for drive in DRIVES}
        ways = [(drive, actuator) for drive, names in self._names.items() for actuator in names]
        self.places = {way: place for place, way in enumerate(ways)}
        self.parts: dict[Drive, slice] = {}
        place = 0
        for drive in DRIVES:
            self.parts[drive] = slice(place, place + len(self._names[drive]))
            place = self.parts[drive].stop
        tables = {name: table for name, table in model.scene.frames.items() if table.path is None}
        self.frames = {name: slice(place + 6 * n, place + 6 * n + 6) for n, name in enumerate(tables)}
        self._axes = {name: table.hinge.unit_axis for name, table in tables.items() if table.hinge is not None}
        self.count = len(ways) + 6 * len(tables) + 6
        kinds = [kind_of(drive) for drive, _ in ways]
        first = [kind.always_driven and drive is kind.effort for kind, (drive, _) in zip(kinds, ways, strict=True)]
        self.driven_first = np.array(first, dtype=bool)

    def read(self, drive: Drive, given: float | Mapping[str, float]) -> dict[int, float]:
        """Values by their places, from one for all actuators or from some by finger or actuator.

        Raises:
            SceneError: a name is unknown, or an actuator is named twice.
        """
        by_actuator = values_by_actuator(given, self._names[drive], kind_of(drive).name)
        return {self.places[drive, actuator]: value for actuator, value in by_actuator.items()}

    def read_frames(self, given: "Mapping[str, FramePlace]") -> dict[str, np.ndarray]:
        """Poses [mm] and [rad], shape (6,), by frame, NaN for what is not given.

        Raises:
            SceneError: a name is unknown, or a frame cannot move so.
        """
        poses = {}
        for name, place in given.items():
            if name not in self.frames:
                known = nearest(name, list(self.frames), "there are")
                raise SceneError(f"no frame that scripts can move is called '{name}'; {known}")
            if (name in self._axes) != (place.angle is not None):
                needed = "a hinge; give angle" if name in self._axes else "no hinge; give translation or rotation"
                raise SceneError(f"'{name}' has {needed}")
            rotation = place.rotation if place.angle is None else place.angle * self._axes[name]
            rows = [np.full(3, np.nan) if row is None else np.asarray(row) for row in (place.translation, rotation)]
            poses[name] = np.concatenate([rows[0], np.radians(rows[1])])
        return poses

    def observed(self, observation: Observation) -> np.ndarray:
        """The values in an observation, shape (count,)."""
        values = [read_drive(drive, observation, actuator) for drive, actuator in self.places]
        poses = [(observation.frame_translations[name], observation.frame_rotations[name]) for name in self.frames]
        poses.append((observation.base_translation, observation.base_rotation))
        return np.array([*values, *np.ravel(poses)])

    def drive(self, driven: np.ndarray, chosen: np.ndarray) -> np.ndarray:
        """What is asked for when the chosen places are, too: each actuator in one way only; shapes (len(places),)."""
        ways, also = list(self.places), np.flatnonzero(chosen)
        actuators = {ways[place][1] for place in also}
        kept = [asked and actuator not in actuators for asked, (_, actuator) in zip(driven, ways, strict=True)]
        return np.array(kept, dtype=bool) | chosen

    def control(self, values: np.ndarray, driven: np.ndarray, signals: Mapping[str, float] | None = None) -> Control:
        """The control that asks for values, shape (count,), at the places that are driven, shape (len(places),)."""
        asked: dict[str, dict[str, float]] = {drive.asked: {} for drive in DRIVES}
        for (drive, actuator), value, is_driven in zip(self.places, values.tolist(), driven, strict=False):
            if is_driven:
                asked[drive.asked][actuator] = value
        moved: dict[str, dict[str, Any]] = {"frame_translation": {}, "frame_rotation": {}, "frame_angle": {}}
        for name, place in self.frames.items():
            if name in self._axes:
                moved["frame_angle"][name] = float(values[place][3:] @ self._axes[name])
            else:
                moved["frame_translation"][name], moved["frame_rotation"][name] = values[place].reshape(2, 3)
        return Control(
            base_translation=values[TRANSLATION],
            base_rotation=values[ROTATION],
            signals=signals or {},
            **moved,  # type: ignore[arg-type] # keys of frames alone
            **asked,  # type: ignore[arg-type] # keys of actuators alone
        )


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
