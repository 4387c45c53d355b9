"""A controller that follows keyframes: values at given times, interpolated between them."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from taichisoft.control.control import Control
from taichisoft.control.controller import Controller
from taichisoft.control.observation import Observation
from taichisoft.errors import SceneError
from taichisoft_controllers.model_names import pressures_by_cavity
from taichisoft_controllers.scripted.script_file import Keyframe
from taichisoft_controllers.scripted.targets import as_control, smoothed

if TYPE_CHECKING:
    from taichisoft.model import Model


class KeyframeController(Controller):
    """Depends on the time alone; before the first keyframe and after the last it holds."""

    def __init__(self, path: Path, keyframes: Sequence[Keyframe], smooth: bool, factor: float):
        """Take the keyframes of a file; `factor` scales all pressures."""
        self._path, self._keyframes, self._smooth, self._factor = path, keyframes, smooth, factor
        self._times = np.array([frame.time for frame in keyframes])

    def reset(self, model: "Model") -> None:
        """Lay out the values by the model's cavities.

        Raises:
            SceneError: a keyframe names a finger or cavity that there is not, or leaves out one that there is.
        """
        self._cavities = model.cavities.names
        pressures = [self._pressures(index) for index in range(len(self._keyframes))]
        rotations = np.radians([frame.base_rotation for frame in self._keyframes])
        translations = [frame.base_translation for frame in self._keyframes]
        self._values = np.column_stack([np.array(pressures) * self._factor, translations, rotations])

    def control(self, observation: Observation) -> Control:
        """The values at the start of the coming step."""
        return as_control(self._cavities, self._at(observation.time))

    def _pressures(self, index: int) -> list[float]:
        """The pressures of all cavities at a keyframe [kPa], shape (cavity_count,)."""
        where = f"{self._path}: keyframes.{index}.pressure"
        try:
            by_cavity = pressures_by_cavity(self._keyframes[index].pressure, self._cavities)
        except SceneError as error:
            raise SceneError(f"{where}: {error}") from error
        missing = [cavity for cavity in self._cavities if cavity not in by_cavity]
        if missing:
            raise SceneError(f"{where}: does not name '{missing[0]}'; a keyframe has the pressure of every cavity")
        return [by_cavity[cavity] for cavity in self._cavities]

    def _at(self, time: float) -> np.ndarray:
        after = int(np.searchsorted(self._times, time, side="right"))
        if after == 0 or after == len(self._times):
            return self._values[min(after, len(self._times) - 1)]
        start, end = self._times[after - 1], self._times[after]
        share = (time - start) / (end - start)
        if self._smooth:
            share = smoothed(share)
        return (1.0 - share) * self._values[after - 1] + share * self._values[after]
