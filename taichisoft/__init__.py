"""taichisoft simulates soft pneumatic grippers: finite elements, cavities, contact and friction.

The names below are imported on first use, so that `import taichisoft` and `taichisoft --help` answer at once.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from taichisoft.building.run_parts import make_controller as make_controller
    from taichisoft.building.run_parts import make_output as make_output
    from taichisoft.building.scene_files import load_scene as load_scene
    from taichisoft.building.simulation import Simulation as Simulation
    from taichisoft.building.simulation import make_model as make_model
    from taichisoft.control.control import Control as Control
    from taichisoft.control.controller import Controller as Controller
    from taichisoft.control.controller import Slider as Slider
    from taichisoft.control.keys import KeyEvent as KeyEvent
    from taichisoft.control.observation import Observation as Observation
    from taichisoft.model import Model as Model
    from taichisoft.plugin_system.geometry import Geometry as Geometry
    from taichisoft.plugin_system.hookspecs import hookimpl as hookimpl
    from taichisoft.plugin_system.plugins import load_plugin as load_plugin
    from taichisoft.plugin_system.plugins import load_plugins_folder as load_plugins_folder
    from taichisoft.plugin_system.plugins import register_plugin as register_plugin
    from taichisoft.plugin_system.plugins import unregister_plugin as unregister_plugin
    from taichisoft.running.loop import run as run
    from taichisoft.scenes.file import scene_from_dict as scene_from_dict
    from taichisoft.scenes.scene import Scene as Scene
    from taichisoft.session.output import Output as Output
    from taichisoft.state import State as State

__version__ = "0.1.0"

_WHERE = {
    "Control": "control.control",
    "Controller": "control.controller",
    "Geometry": "plugin_system.geometry",
    "KeyEvent": "control.keys",
    "Model": "model",
    "Observation": "control.observation",
    "Output": "session.output",
    "Scene": "scenes.scene",
    "Simulation": "building.simulation",
    "Slider": "control.controller",
    "State": "state",
    "hookimpl": "plugin_system.hookspecs",
    "load_plugin": "plugin_system.plugins",
    "load_plugins_folder": "plugin_system.plugins",
    "load_scene": "building.scene_files",
    "make_controller": "building.run_parts",
    "make_model": "building.simulation",
    "make_output": "building.run_parts",
    "register_plugin": "plugin_system.plugins",
    "run": "running.loop",
    "scene_from_dict": "scenes.file",
    "unregister_plugin": "plugin_system.plugins",
}
__all__ = ["__version__", *_WHERE]


def __getattr__(name: str) -> Any:
    if name not in _WHERE:
        raise AttributeError(f"module 'taichisoft' has no attribute '{name}'")
    return getattr(import_module(f"taichisoft.{_WHERE[name]}"), name)
