"""The controller "scripted": follows a file of keyframes, or of steps that may wait for conditions."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from taichisoft.actuators import ActuatorKind, Drive
from taichisoft.control import Controller
from taichisoft.errors import SceneError
from taichisoft.scenes import Number, Positive, find_file
from taichisoft_controllers.drives import DRIVES, table_of_drives
from taichisoft_controllers.scripted.keyframe_controller import KeyframeController
from taichisoft_controllers.scripted.script_file import SUFFIXES, Interpolation, Script, read_script
from taichisoft_controllers.scripted.step_controller import StepController
from taichisoft_controllers.settings import ControllerSettings


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
    """The controller that does what a script says; `ScriptSettings` describes the arguments.

    Raises:
        SceneError: the script is missing, or something in it or in the settings is not valid.
    """
    ScriptSettings.checked(script=script, interpolation=interpolation, **largest)
    path = find_file(script, "scripts", SUFFIXES, error=SceneError)
    content = read_script(path, Script)
    factors = scaling(content, path, largest)
    smooth = (interpolation or content.interpolation) == "smooth"
    if content.steps is not None:
        return StepController(path, content.steps, smooth, factors)
    return KeyframeController(path, content.keyframes or (), smooth, factors)


def scaling(content: Script, path: Path, largest: Mapping[str, float | None]) -> dict[Drive, float]:
    """The factors that make the largest pressure, pull and so on of a script what the settings want.

    Raises:
        SceneError: the script at `path` has nothing to scale.
    """
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
