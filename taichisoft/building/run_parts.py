"""Construction of the controller and the outputs of a run, which plug-ins provide by name."""

from pathlib import Path
from typing import Any

from taichisoft.building.controller_settings import checked_arguments
from taichisoft.control.controller import Controller
from taichisoft.errors import SceneError
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
        SceneError: the scene has no controller, or its settings are not valid.
        PluginError: no plug-in provides the controller, or it cannot be made.
    """
    if scene.controller is None:
        raise SceneError("there is no [controller]; name one with --controller")
    name, settings = scene.controller.name, scene.controller.settings
    factory = find("controller", name)
    with failures_of(f"controller '{name}' cannot be made"):
        made: Controller = factory(**checked_arguments(factory, settings))
    return require_base(made, Controller)


def make_output(name: str, folder: str | Path, **settings: Any) -> Output:
    """Make an output by its name, such as "recording".

    Args:
        name: name under which a plug-in provides the output.
        folder: output folder of the run, into which the output may write.
        settings: further arguments of the output.

    Raises:
        PluginError: no plug-in provides it, or it cannot be made.
    """
    factory = find("output", name)
    with failures_of(f"output '{name}' cannot be made"):
        made: Output = factory(Path(folder), **settings)
    return require_base(made, Output)
