"""taichisoft simulates soft pneumatic grippers: finite elements, cavities, contact and friction.

The names below are imported on first use, so that `import taichisoft` and `taichisoft --help` answer at once.
docs/reference/python.md describes them.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from taichisoft.contact.model import Model as Model
    from taichisoft.control.control import Control as Control
    from taichisoft.control.control import Controller as Controller
    from taichisoft.control.control import Force as Force
    from taichisoft.control.control import KeyEvent as KeyEvent
    from taichisoft.control.control import Slider as Slider
    from taichisoft.control.observation import Observation as Observation
    from taichisoft.mechanics.state import State as State
    from taichisoft.mesh.mesh_files import read_volume_mesh as read_volume_mesh
    from taichisoft.mesh.mesh_files import write_volume_mesh as write_volume_mesh
    from taichisoft.mesh.volume_mesh import VolumeMesh as VolumeMesh
    from taichisoft.running.hookspecs import RunOption as RunOption
    from taichisoft.running.hookspecs import hookimpl as hookimpl
    from taichisoft.running.loop import run as run
    from taichisoft.running.plugin_commands import group_with_default as group_with_default
    from taichisoft.running.plugin_interfaces import CameraFrame as CameraFrame
    from taichisoft.running.plugin_interfaces import CameraView as CameraView
    from taichisoft.running.plugin_interfaces import Geometry as Geometry
    from taichisoft.running.plugin_interfaces import Renderer as Renderer
    from taichisoft.running.plugins import load_plugin as load_plugin
    from taichisoft.running.plugins import register_plugin as register_plugin
    from taichisoft.running.plugins import unregister_plugin as unregister_plugin
    from taichisoft.running.rollouts import Rollouts as Rollouts
    from taichisoft.running.rollouts import rollouts as rollouts
    from taichisoft.running.run_gradient import LeastSquares as LeastSquares
    from taichisoft.running.run_gradient import RunGradient as RunGradient
    from taichisoft.running.run_gradient import gradient as gradient
    from taichisoft.running.scene_files import load_scene as load_scene
    from taichisoft.running.scene_files import make_controller as make_controller
    from taichisoft.running.scene_files import make_output as make_output
    from taichisoft.running.scene_files import scene_from_dict as scene_from_dict
    from taichisoft.running.session import Output as Output
    from taichisoft.running.session import Session as Session
    from taichisoft.running.simulation import Simulation as Simulation
    from taichisoft.running.simulation import make_model as make_model
    from taichisoft.running.statics import Equilibrium as Equilibrium
    from taichisoft.running.statics import InverseSolution as InverseSolution
    from taichisoft.running.statics import equilibrium as equilibrium
    from taichisoft.running.statics import inverse as inverse
    from taichisoft.scene.scene import Scene as Scene
    from taichisoft.step.linearisation import Linearisation as Linearisation
    from taichisoft.step.solution import StepReport as StepReport

__version__ = "0.2.0"

_NAMES = {
    "running.rollouts": ["Rollouts", "rollouts"],
    "running.run_gradient": ["LeastSquares", "RunGradient", "gradient"],
    "running.scene_files": ["load_scene", "make_controller", "make_output", "scene_from_dict"],
    "running.simulation": ["Simulation", "make_model"],
    "control.control": ["Control", "Controller", "Force", "KeyEvent", "Slider"],
    "control.observation": ["Observation"],
    "running.statics": ["Equilibrium", "InverseSolution", "equilibrium", "inverse"],
    "step.linearisation": ["Linearisation"],
    "mesh.mesh_files": ["read_volume_mesh", "write_volume_mesh"],
    "mesh.volume_mesh": ["VolumeMesh"],
    "contact.model": ["Model"],
    "running.plugin_commands": ["group_with_default"],
    "running.plugin_interfaces": ["CameraFrame", "CameraView", "Geometry", "Renderer"],
    "running.hookspecs": ["RunOption", "hookimpl"],
    "running.plugins": ["load_plugin", "register_plugin", "unregister_plugin"],
    "running.loop": ["run"],
    "scene.scene": ["Scene"],
    "running.session": ["Output", "Session"],
    "mechanics.state": ["State"],
    "step.solution": ["StepReport"],
}
_MODULES = {name: module for module, names in _NAMES.items() for name in names}
__all__ = ["__version__", "errors", *_MODULES]


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'taichisoft' has no attribute '{name}'")
    return getattr(import_module(f"taichisoft.{_MODULES[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
