"""A controller that follows keyframes."""

import itertools
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from pydantic import Field, ValidationError, model_validator

from taichisoft.controller import Control, Observation
from taichisoft.errors import SceneError
from taichisoft.scene import NotNegative, Number, Positive, Table, Vector
from taichisoft.shipped import find_file
from taichisoft.validation_errors import first_problem

if TYPE_CHECKING:
    from taichisoft.model import Model


class Keyframe(Table):
    """What is asked for at a time; between two keyframes values are interpolated."""

    time: NotNegative
    """[s]"""
    pressure: Number
    """Of all cavities [kPa]."""
    base_translation: Vector = (0.0, 0.0, 0.0)
    """[mm]"""
    base_rotation: Vector = (0.0, 0.0, 0.0)
    """Rotation vector [degrees]."""


class Script(Table):
    """The file that a scripted controller follows."""

    interpolation: Literal["linear", "smooth"] = "linear"
    """"smooth" starts and ends at rest between any two keyframes (3 s^2 - 2 s^3)."""
    keyframes: list[Keyframe] = Field(min_length=1)

    @model_validator(mode="after")
    def _check_order(self) -> "Script":
        times = [keyframe.time for keyframe in self.keyframes]
        if any(later <= earlier for earlier, later in itertools.pairwise(times)):
            raise ValueError(f"the times of the keyframes must increase; they are {times}")
        return self


class Settings(Table):
    """What a scene's `controller.settings` may say."""

    script: Path
    pressure: Positive | None = None


class ScriptedController:
    """Follows the keyframes of a script; before the first and after the last it holds."""

    def __init__(self, script: str | Path, pressure: float | None = None):
        """Read the script, by path or by shipped name.

        Args:
            script: TOML file with `interpolation` and `keyframes`.
            pressure: [kPa]; scales the script so that its largest pressure is this.

        Raises:
            SceneError: the script is missing, or something in it or in the settings is not valid.
        """
        try:
            Settings.model_validate({"script": script, "pressure": pressure})
        except ValidationError as error:
            raise SceneError(first_problem(error, Settings, "controller.settings")) from error
        path = find_file(script, "scripts", (".toml",), error=SceneError)
        content = _read(path)
        frames = content.keyframes
        self._smooth = content.interpolation == "smooth"
        self._times = np.array([frame.time for frame in frames])
        rotations = np.radians([frame.base_rotation for frame in frames])
        pressures = np.array([frame.pressure for frame in frames])
        if pressure is not None:
            if not pressures.max() > 0.0:
                raise SceneError(f"{path}: has no pressure above 0 that controller.settings.pressure could scale")
            pressures *= pressure / pressures.max()
        self._values = np.column_stack([pressures, [frame.base_translation for frame in frames], rotations])
        self._cavities: tuple[str, ...] = ()

    def reset(self, model: "Model") -> None:
        """Take the names of the cavities."""
        self._cavities = model.cavities.names

    def control(self, observation: Observation) -> Control:
        """The script's values at the start of the coming step."""
        values = self._at(observation.time)
        return Control(
            pressure=dict.fromkeys(self._cavities, float(values[0])),
            base_translation=values[1:4],
            base_rotation=values[4:7],
        )

    def _at(self, time: float) -> np.ndarray:
        after = int(np.searchsorted(self._times, time, side="right"))
        if after == 0 or after == len(self._times):
            return self._values[min(after, len(self._times) - 1)]
        start, end = self._times[after - 1], self._times[after]
        share = (time - start) / (end - start)
        if self._smooth:
            share = share * share * (3.0 - 2.0 * share)
        return (1.0 - share) * self._values[after - 1] + share * self._values[after]


def _read(path: Path) -> Script:
    try:
        return Script.model_validate(tomllib.loads(path.read_text(encoding="utf-8")))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise SceneError(f"{path}: not readable as TOML: {error}") from error
    except ValidationError as error:
        raise SceneError(f"{path}: {first_problem(error, Script)}") from error
