"""The controller "scripted": follows a file of keyframes, or of steps that may wait for conditions."""

from pathlib import Path

from taichisoft.control.controller import Controller
from taichisoft.errors import SceneError
from taichisoft.scenes.shipped import find_file
from taichisoft.scenes.table import Positive
from taichisoft_controllers.drives import DRIVES
from taichisoft_controllers.scripted.keyframe_controller import KeyframeController
from taichisoft_controllers.scripted.script_file import SUFFIXES, Interpolation, read_script
from taichisoft_controllers.scripted.step_controller import StepController
from taichisoft_controllers.settings import ControllerSettings


class ScriptSettings(ControllerSettings):
    """Settings of the controller "scripted"."""

    script: Path
    """The file, by path or by the name of a shipped one."""
    pressure: Positive | None = None
    """Largest pressure [kPa], to which all pressures and pressure rates are scaled; conditions stay as they are."""
    pull: Positive | None = None
    """Largest pull [mm], to which all pulls and pull speeds are scaled; conditions stay as they are."""
    tension: Positive | None = None
    """Largest tension [mN], to which all tensions and tension rates are scaled; conditions stay as they are."""
    interpolation: Interpolation | None = None
    """`"linear"` or `"smooth"`, instead of the file's own."""


def scripted_controller(
    script: str | Path,
    pressure: float | None = None,
    pull: float | None = None,
    tension: float | None = None,
    interpolation: str | None = None,
) -> Controller:
    """The controller that does what a script says; `ScriptSettings` describes the arguments.

    Raises:
        SceneError: the script is missing, or something in it or in the settings is not valid.
    """
    wanted = {"pressure": pressure, "pull": pull, "tension": tension}
    ScriptSettings.checked(script=script, interpolation=interpolation, **wanted)
    path = find_file(script, "scripts", SUFFIXES, error=SceneError)
    content = read_script(path)
    factors = {}
    for drive in DRIVES:
        largest, highest = wanted[drive.name], content.highest(drive)
        if largest is not None and not highest > 0.0:
            raise SceneError(f"{path}: has no {drive.name} above 0 that controller.settings.{drive.name} could scale")
        factors[drive] = largest / highest if largest is not None else 1.0
    smooth = (interpolation or content.interpolation) == "smooth"
    if content.steps is not None:
        return StepController(path, content.steps, smooth, factors)
    return KeyframeController(path, content.keyframes or (), smooth, factors)
