"""taichisoft simulates soft pneumatic grippers: finite elements, cavities, contact and friction.

The names below are imported on first use, so that `import taichisoft` and `taichisoft --help` answer at once.
docs/reference/python.md describes them.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from taichisoft import errors as errors

if TYPE_CHECKING:
    from taichisoft.branching.rollouts import Rollouts as Rollouts
    from taichisoft.branching.rollouts import rollouts as rollouts
    from taichisoft.building.run_parts import make_controller as make_controller
    from taichisoft.building.run_parts import make_output as make_output
    from taichisoft.building.scene_files import load_scene as load_scene
    from taichisoft.building.scene_files import scene_from_dict as scene_from_dict
    from taichisoft.building.simulation import Simulation as Simulation
    from taichisoft.building.simulation import make_model as make_model
    from taichisoft.control.control import Control as Control
    from taichisoft.control.controller import Controller as Controller
    from taichisoft.control.controller import Slider as Slider
    from taichisoft.control.keys import KeyEvent as KeyEvent
    from taichisoft.control.observation import Observation as Observation
    from taichisoft.inverse_statics import InverseSolution as InverseSolution
    from taichisoft.inverse_statics import inverse as inverse
    from taichisoft.linearisation import Linearisation as Linearisation
    from taichisoft.meshes.files import read_volume_mesh as read_volume_mesh
    from taichisoft.meshes.files import write_volume_mesh as write_volume_mesh
    from taichisoft.meshes.volume_mesh import VolumeMesh as VolumeMesh
    from taichisoft.model import Model as Model
    from taichisoft.plugin_system.commands import group_with_default as group_with_default
    from taichisoft.plugin_system.geometry import Geometry as Geometry
    from taichisoft.plugin_system.hookspecs import RunOption as RunOption
    from taichisoft.plugin_system.hookspecs import hookimpl as hookimpl
    from taichisoft.plugin_system.plugins import load_plugin as load_plugin
    from taichisoft.plugin_system.plugins import load_plugins_folder as load_plugins_folder
    from taichisoft.plugin_system.plugins import register_plugin as register_plugin
    from taichisoft.plugin_system.plugins import unregister_plugin as unregister_plugin
    from taichisoft.plugin_system.renderer import CameraFrame as CameraFrame
    from taichisoft.plugin_system.renderer import CameraView as CameraView
    from taichisoft.plugin_system.renderer import Renderer as Renderer
    from taichisoft.running.loop import run as run
    from taichisoft.scenes.scene import Scene as Scene
    from taichisoft.session.output import Output as Output
    from taichisoft.session.session import Session as Session
    from taichisoft.state import State as State
    from taichisoft.statics import Equilibrium as Equilibrium
    from taichisoft.statics import equilibrium as equilibrium
    from taichisoft.step.report import StepReport as StepReport

__version__ = "0.2.0"

_NAMES = {
    "branching.rollouts": ["Rollouts", "rollouts"],
    "building.run_parts": ["make_controller", "make_output"],
    "building.scene_files": ["load_scene", "scene_from_dict"],
    "building.simulation": ["Simulation", "make_model"],
    "control.control": ["Control"],
    "control.controller": ["Controller", "Slider"],
    "control.keys": ["KeyEvent"],
    "control.observation": ["Observation"],
    "inverse_statics": ["InverseSolution", "inverse"],
    "linearisation": ["Linearisation"],
    "meshes.files": ["read_volume_mesh", "write_volume_mesh"],
    "meshes.volume_mesh": ["VolumeMesh"],
    "model": ["Model"],
    "plugin_system.commands": ["group_with_default"],
    "plugin_system.geometry": ["Geometry"],
    "plugin_system.hookspecs": ["RunOption", "hookimpl"],
    "plugin_system.plugins": ["load_plugin", "load_plugins_folder", "register_plugin", "unregister_plugin"],
    "plugin_system.renderer": ["CameraFrame", "CameraView", "Renderer"],
    "running.loop": ["run"],
    "scenes.scene": ["Scene"],
    "session.output": ["Output"],
    "session.session": ["Session"],
    "state": ["State"],
    "statics": ["Equilibrium", "equilibrium"],
    "step.report": ["StepReport"],
}
_MODULES = {name: module for module, names in _NAMES.items() for name in names}
__all__ = ["__version__", "errors", *_MODULES]


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'taichisoft' has no attribute '{name}'")
    return getattr(import_module(f"taichisoft.{_MODULES[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
