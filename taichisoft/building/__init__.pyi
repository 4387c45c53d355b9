from .reduced_scene import with_reduced_bodies as with_reduced_bodies
from .run_parts import make_controller as make_controller
from .run_parts import make_output as make_output
from .scene_files import load_scene as load_scene
from .scene_files import scene_from_dict as scene_from_dict
from .simulation import Simulation as Simulation
from .simulation import make_model as make_model
