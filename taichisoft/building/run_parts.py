"""Making the controller and the outputs of a run, which plug-ins provide by name."""

import inspect
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from taichisoft.control.controller import Controller
from taichisoft.errors import SceneError, nearest
from taichisoft.plugin_system.failure import failures_of
from taichisoft.plugin_system.hooks import find
from taichisoft.scenes.scene import Scene
from taichisoft.session.output import Output
from taichisoft.session.session import require_base


def make_controller(scene: Scene) -> Controller:
    """Make the controller that a scene names, with the settings of the scene.

    Args:
        scene: scene with a `[controller]`.

    Raises:
        SceneError: there is none, or its settings are wrong.
        PluginError: no plug-in provides it, or it cannot be made.
    """
    if scene.controller is None:
        raise SceneError("there is no [controller]; name one with --controller")
    name, settings = scene.controller.name, scene.controller.settings
    factory = find("controller", name)
    _check_settings(factory, settings)
    with failures_of(f"controller '{name}' cannot be made"):
        made: Controller = factory(**settings)
    return require_base(made, Controller)


def make_output(name: str, folder: str | Path, **settings: Any) -> Output:
    """Make an output by its name, such as "recording".

    Args:
        name: name under which a plug-in provides it.
        folder: folder into which it may write, the output folder of the run.
        settings: further arguments of the output.

    Raises:
        PluginError: no plug-in provides it, or it cannot be made.
    """
    factory = find("output", name)
    with failures_of(f"output '{name}' cannot be made"):
        made: Output = factory(Path(folder), **settings)
    return require_base(made, Output)


def _check_settings(factory: Callable[..., Any], settings: Mapping[str, Any]) -> None:
    """Compare the names of the settings with the arguments of what makes the controller."""
    arguments = inspect.signature(factory).parameters
    takes_any = any(argument.kind is argument.VAR_KEYWORD for argument in arguments.values())
    named = [a for a in arguments.values() if a.kind in (a.POSITIONAL_OR_KEYWORD, a.KEYWORD_ONLY)]
    valid = [argument.name for argument in named]
    for key in settings:
        if key not in valid and not takes_any:
            hint = nearest(key, valid, "valid keys")
            raise SceneError(f"controller.settings.{key}: unknown key; {hint}")
    for argument in named:
        if argument.default is argument.empty and argument.name not in settings:
            raise SceneError(f"controller.settings.{argument.name}: this key is missing")
