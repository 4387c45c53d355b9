"""taichisoft simulates soft pneumatic grippers: finite elements, cavities, contact and friction.

The names below are imported on first use, so that `import taichisoft` and `taichisoft --help` answer at once.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from taichisoft.controller import Control as Control
    from taichisoft.controller import Observation as Observation
    from taichisoft.hookspecs import hookimpl as hookimpl
    from taichisoft.model import Model as Model
    from taichisoft.plugins import load_plugin as load_plugin
    from taichisoft.plugins import load_plugins_folder as load_plugins_folder
    from taichisoft.plugins import register_plugin as register_plugin
    from taichisoft.plugins import unregister_plugin as unregister_plugin
    from taichisoft.running.loop import run as run
    from taichisoft.scene import Scene as Scene
    from taichisoft.scenes.file import load_scene as load_scene
    from taichisoft.scenes.file import scene_from_dict as scene_from_dict
    from taichisoft.simulation import Simulation as Simulation
    from taichisoft.state import State as State

__version__ = "0.1.0"

_WHERE = {
    "Control": "controller",
    "Model": "model",
    "Observation": "controller",
    "Scene": "scene",
    "Simulation": "simulation",
    "State": "state",
    "hookimpl": "hookspecs",
    "load_plugin": "plugins",
    "load_plugins_folder": "plugins",
    "load_scene": "scenes.file",
    "register_plugin": "plugins",
    "run": "running.loop",
    "scene_from_dict": "scenes.file",
    "unregister_plugin": "plugins",
}
__all__ = ["__version__", *_WHERE]


def __getattr__(name: str) -> Any:
    if name not in _WHERE:
        raise AttributeError(f"module 'taichisoft' has no attribute '{name}'")
    return getattr(import_module(f"taichisoft.{_WHERE[name]}"), name)
