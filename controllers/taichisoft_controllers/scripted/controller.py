"""The controller "scripted": follows a file of keyframes, or of steps that may wait for conditions."""

from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import ValidationError

from taichisoft.control.control import Control
from taichisoft.control.observation import Observation
from taichisoft.errors import SceneError
from taichisoft.scenes.scene import Positive, Table
from taichisoft.scenes.shipped import find_file
from taichisoft.scenes.validation_errors import first_problem
from taichisoft_controllers.scripted.keyframe_follower import KeyframeFollower
from taichisoft_controllers.scripted.script_file import SUFFIXES, Interpolation, read_script
from taichisoft_controllers.scripted.step_follower import StepFollower

if TYPE_CHECKING:
    from taichisoft.model import Model


class Settings(Table):
    """What a scene's `controller.settings` may say."""

    script: Path
    pressure: Positive | None = None
    interpolation: Interpolation | None = None


class ScriptedController:
    """Does what a script says; docs/controllers.md says what a script may say."""

    def __init__(self, script: str | Path, pressure: float | None = None, interpolation: str | None = None):
        """Read the script, by path or by shipped name.

        Args:
            script: TOML file with `keyframes` or `steps`, or CSV file of keyframes.
            pressure: [kPa]; scales the script so that its largest pressure is this.
            interpolation: "linear" or "smooth", instead of the script's own.

        Raises:
            SceneError: the script is missing, or something in it or in the settings is not valid.
        """
        settings = {"script": script, "pressure": pressure, "interpolation": interpolation}
        try:
            Settings.model_validate(settings)
        except ValidationError as error:
            raise SceneError(first_problem(error, Settings, "controller.settings")) from error
        path = find_file(script, "scripts", SUFFIXES, error=SceneError)
        content = read_script(path)
        if pressure is not None and not content.highest_pressure > 0.0:
            raise SceneError(f"{path}: has no pressure above 0 that controller.settings.pressure could scale")
        factor = pressure / content.highest_pressure if pressure is not None else 1.0
        smooth = (interpolation or content.interpolation) == "smooth"
        self._follower: KeyframeFollower | StepFollower
        if content.steps is not None:
            self._follower = StepFollower(path, content.steps, smooth, factor)
        else:
            self._follower = KeyframeFollower(path, content.keyframes or (), smooth, factor)

    def reset(self, model: "Model") -> None:
        """Begin anew.

        Raises:
            SceneError: the script names a finger, cavity or body that the model does not have.
        """
        self._follower.reset(model)

    def control(self, observation: Observation) -> Control:
        """What the script says at the start of the coming step.

        Raises:
            ControllerFailed: a condition was not true in time.
        """
        return self._follower.control(observation)

    def summary(self) -> dict[str, str]:
        """Rows of the table that closes a run: when each step was made."""
        return self._follower.summary()
