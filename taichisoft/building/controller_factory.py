"""Making the controller that a scene names, with the scene's settings."""

import inspect
from collections.abc import Callable, Mapping
from typing import Any

from taichisoft.errors import SceneError, TaichisoftError, nearest
from taichisoft.plugin_system import plugins
from taichisoft.scenes.scene import Scene


def make_controller(scene: Scene) -> Any:
    """The scene's controller.

    Raises:
        SceneError: there is none, or its settings are wrong.
        PluginError: no plug-in provides it, or it cannot be made.
    """
    if scene.controller is None:
        raise SceneError("there is no [controller]; name one with --controller")
    name, settings = scene.controller.name, scene.controller.settings
    factory = plugins.find("controller", name)
    _check_settings(factory, settings)
    try:
        return factory(**settings)
    except TaichisoftError:
        raise
    except Exception as error:
        raise plugins.plugin_failure(f"controller '{name}' cannot be made", error) from error


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
