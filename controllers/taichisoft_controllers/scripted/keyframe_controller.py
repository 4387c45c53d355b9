"""A controller that follows keyframes: values at given times, interpolated between them."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft.actuators import Drive, kind_of
from taichisoft.control import Control, Controller, Observation
from taichisoft.errors import SceneError
from taichisoft_controllers.drives import DRIVES
from taichisoft_controllers.scripted.script_file import Keyframe
from taichisoft_controllers.scripted.script_targets import FreeBase, Targets, smoothed

if TYPE_CHECKING:
    from taichisoft.model import Model


class KeyframeController(Controller):
    """Depends on the time alone; before the first keyframe and after the last it holds."""

    def __init__(self, path: Path, keyframes: Sequence[Keyframe], smooth: bool, factors: Mapping[Drive, float]):
        """Take the keyframes of a file; `factors` scale all pressures, pulls and tensions."""
        self._path, self._keyframes, self._smooth, self._factors = path, keyframes, smooth, factors
        self._times = np.array([frame.time for frame in keyframes])

    def reset(self, model: "Model") -> None:
        """Lay out the values by the model's cavities and cables.

        Raises:
            SceneError: a keyframe names an unknown finger, cavity or cable, leaves out a cavity, or a cable
                that another one names, or gives a cable a pull and a tension.
        """
        self._targets = targets = Targets(model, FreeBase())
        efforts = [self._efforts(index) for index in range(len(self._keyframes))]
        named = np.zeros(len(targets.places), dtype=bool)
        named[[place for values in efforts for place in values]] = True
        self._driven = named | targets.driven_first
        self._check_complete(efforts)
        rotations = np.radians([frame.base_rotation for frame in self._keyframes])
        translations = [frame.base_translation for frame in self._keyframes]
        table = np.zeros((len(efforts), len(targets.places)))
        for row, values in zip(table, efforts, strict=True):
            row[list(values)] = list(values.values())
        for drive, part in targets.parts.items():
            table[:, part] *= self._factors[drive]
        self._values = np.column_stack([table, *self._frames(), translations, rotations])

    def control(self, observation: Observation) -> Control:
        """The values at the start of the coming step."""
        return self._targets.control(self._at(observation.time), self._driven)

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

    def _efforts(self, index: int) -> dict[int, float]:
        """What a keyframe asks of actuators, by the place in the array of targets."""
        values: dict[int, float] = {}
        for drive in DRIVES:
            given = getattr(self._keyframes[index], drive.name)
            try:
                values |= self._targets.read(drive, {} if given is None else given)
            except SceneError as error:
                raise SceneError(f"{self._path}: keyframes.{index}.{drive.name}: {error}") from error
        return values

    def _frames(self) -> list[np.ndarray]:
        """Poses of each frame that can be asked to move in all keyframes, 0 where not given, (keyframe_count, 6)."""
        poses = {name: np.zeros((len(self._keyframes), 6)) for name in self._targets.frames}
        for index, keyframe in enumerate(self._keyframes):
            try:
                for name, pose in self._targets.read_frames(keyframe.frames).items():
                    poses[name][index] = np.nan_to_num(pose)
            except SceneError as error:
                raise SceneError(f"{self._path}: keyframes.{index}.frames: {error}") from error
        return list(poses.values())

    def _check_complete(self, efforts: Sequence[Mapping[int, float]]) -> None:
        """Refuse keyframes between which something would be undefined."""
        driven = [way for way, is_driven in zip(self._targets.places, self._driven, strict=True) if is_driven]
        actuators = [actuator for _, actuator in driven]
        for actuator in actuators:
            if actuators.count(actuator) > 1:
                ways = " and a ".join(drive.words for drive, other in driven if other == actuator)
                raise SceneError(f"{self._path}: '{actuator}' is given a {ways}; keyframes have one of them")
        for index, values in enumerate(efforts):
            for drive, actuator in driven:
                if self._targets.places[drive, actuator] not in values:
                    kind = kind_of(drive)
                    every = f"the {drive.name} of every {kind.name}"
                    every += "" if kind.always_driven and drive is kind.effort else " that another one names"
                    where = f"{self._path}: keyframes.{index}.{drive.name}"
                    raise SceneError(f"{where}: does not name '{actuator}'; a keyframe has {every}")

    def _at(self, time: float) -> np.ndarray:
        after = int(np.searchsorted(self._times, time, side="right"))
        if after == 0 or after == len(self._times):
            return self._values[min(after, len(self._times) - 1)]
        start, end = self._times[after - 1], self._times[after]
        share = (time - start) / (end - start)
        if self._smooth:
            share = smoothed(share)
        return (1.0 - share) * self._values[after - 1] + share * self._values[after]
