"""From a scene to a simulation: its meshes are found through plug-ins."""

from taichisoft import simulation
from taichisoft.building.body_meshes import load_meshes
from taichisoft.model import Model
from taichisoft.scenes.scene import Scene


def make_model(scene: Scene) -> Model:
    """The model of a scene, with the meshes that it names.

    Raises:
        MeshError: a file is not fit to simulate.
        SceneError: something in the scene does not fit its meshes, or bodies overlap at the start.
        PluginError: the plug-in that makes a mesh failed.
    """
    return Model(scene, load_meshes(scene))


class Simulation(simulation.Simulation):
    """A simulation of a scene, or of a model already made."""

    def __init__(self, scene: Scene | Model):
        """Begin at the state that the scene describes.

        Raises:
            TaichisoftError: see `make_model`.
        """
        super().__init__(scene if isinstance(scene, Model) else make_model(scene))
