"""The controller "arm": an arm carries the gripper, and follows a script, keys, or a script until a key is pressed."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np

from taichisoft.actuators import Drive
from taichisoft.control import Control, Controller, KeyEvent, Observation
from taichisoft.errors import SceneError
from taichisoft.model import Model
from taichisoft.scenes import find_file
from taichisoft_arm.arm_keys import ArmKeys
from taichisoft_arm.arm_script import ArmScript, CarriedBase
from taichisoft_arm.mounted_arm import ArmPlacement, MountedArm
from taichisoft_controllers.drives import DRIVES
from taichisoft_controllers.keyboard.keyboard_controller import KeyboardSettings
from taichisoft_controllers.scripted.script_file import Interpolation, read_script
from taichisoft_controllers.scripted.scripted_controller import LargestValues, scaling
from taichisoft_controllers.scripted.step_controller import StepController


class ArmSettings(ArmPlacement, LargestValues, KeyboardSettings):  # type: ignore[misc] # tables with keys of drives
    """Settings of the controller "arm"."""

    script: Path | None = None
    """The file, by path or by the name of a shipped one; the arm is jogged by keys when it is not given."""
    interpolation: Interpolation | None = None
    """`"linear"` or `"smooth"`, instead of the script's own; of pressures, pulls and tensions."""
    links: Literal["drawn", "colliding", "none"] = "drawn"
    """Whether the arm's links are bodies of the scene: those of its looks, those that it collides with, or none."""


class ArmController(Controller):
    """Follows its script until a person presses a key or moves a slider that moves something, who then steers.

    Attributes:
        sliders: joints, pressures, pulls and so on, by name.
        status: who steers, and what keys do.
    """

    def __init__(self, settings: ArmSettings):
        """Read the arm and its script.

        Raises:
            SceneError: one of them, or a setting, is not valid.
            PackageMissing: yourdfpy is not installed.
        """
        self._base = CarriedBase(MountedArm(settings), settings.tool, settings.ramp)
        keys = {key: getattr(settings, key) for key in KeyboardSettings.model_fields}
        self._keys = ArmKeys(self._base, **keys)
        self._script = _read(settings, self._base)
        self.interactive = self._script is None
        self.bindings = self._keys.bindings

    def reset(self, model: Model) -> None:
        """Begin with the first step of the script.

        Raises:
            SceneError: the script names what the model does not have.
        """
        self._base.reset(model)
        self._keys.reset(model)
        if self._script is not None:
            self._script.reset(model)
        self.bindings, self.sliders = self._keys.bindings, self._keys.sliders
        self._steered = self._script is None
        self._planned = False
        self._say()

    def key(self, event: KeyEvent) -> None:
        """Leave the script, and do what the key says."""
        if self._keys.uses(event):
            self._steered = True
            self._keys.key(event)
            self._say()

    def control(self, observation: Observation) -> Control:
        """What the script or the keys ask for.

        Raises:
            ControllerFailed: the arm cannot go a way of the script, or a condition was not true in time.
        """
        if self._script is None or self._steered:
            return self._keys.control(observation)
        if not self._planned:
            self._script.base_stops_at(observation)  # a way that the arm cannot go is found before anything moves
            self._planned = True
        asked = self._script.control(observation)
        self._keys.follow(observation, self._joints(asked))
        return asked

    def save(self) -> dict[str, Any]:
        """Where script and keys are, and who steers."""
        script = self._script.save() if self._script is not None else None
        return {"script": script, "keys": self._keys.save(), "steered": self._steered}

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Go on from there.

        Raises:
            StateError: the script is another.
        """
        self._steered = saved["steered"] or self._script is None
        if self._script is not None and saved["script"] is not None:
            self._script.restore(saved["script"])
        self._keys.restore(saved["keys"])
        self._planned = True
        self._say()

    def base_stops_at(self, observation: Observation) -> float | None:
        """The end of the script's last way of the arm; None where a person steers."""
        return None if self._script is None else self._script.base_stops_at(observation)

    def summary(self) -> dict[str, str]:
        """Rows that say when each step of the script was made."""
        return self._script.summary() if self._script is not None else {}

    def _joints(self, asked: Control) -> np.ndarray:
        joints = self._base.arm.chain.joints
        return np.array([asked.signals[joint.name] / joint.to_user for joint in joints])

    def _say(self) -> None:
        self.status = self._keys.status if self._steered else "the script steers; a key or slider of the arm takes over"


def _read(settings: ArmSettings, base: CarriedBase) -> StepController | None:
    """The controller that follows the script, if there is one."""
    if settings.script is None:
        return None
    path = find_file(settings.script, "scripts", (".toml",), error=SceneError)
    content = read_script(path, ArmScript)
    largest = {drive.name: getattr(settings, drive.name) for drive in DRIVES}
    factors: Mapping[Drive, float] = scaling(content, path, largest)
    smooth = (settings.interpolation or content.interpolation) == "smooth"
    return StepController(path, content.steps or (), smooth, factors, base)
