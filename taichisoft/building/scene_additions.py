"""What the controller of a scene adds to it, such as the links of the arm that carries the gripper."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from taichisoft.errors import PluginError, SceneError, TaichisoftError
from taichisoft.plugin_system.failure import failures_of
from taichisoft.plugin_system.hooks import provided


def add_what_controllers_bring(document: dict[str, Any], source: str, folder: Path) -> None:
    """Add the tables of the plug-in that belongs to the scene's controller; what the scene itself has stays.

    Args:
        document: tables of the scene, which are changed.
        source: name of the document, with which every error begins.
        folder: folder in which the plug-in looks for files first.

    Raises:
        SceneError: the controller's settings are not valid.
        PluginError: the plug-in failed.
    """
    controller = document.get("controller")
    name = controller.get("name") if isinstance(controller, dict) else None
    if not isinstance(name, str):
        return  # what else is wrong is found later, with its key
    additions = provided("scene addition")
    if name not in additions:
        return
    settings = controller.get("settings", {}) if isinstance(controller, dict) else {}
    try:
        with failures_of(f"what the controller '{name}' adds to the scene failed"):
            tables = additions[name](settings, folder)
    except PluginError:
        raise
    except TaichisoftError as error:
        raise SceneError(f"{source}: {error}") from error
    for key, added in tables.items():
        there = document.setdefault(key, {})
        if isinstance(there, Mapping):
            document[key] = {**there, **{name: one for name, one in added.items() if name not in there}}
