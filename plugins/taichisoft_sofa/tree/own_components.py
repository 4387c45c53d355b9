"""Classes from which a scene derives force fields and engines of its own, which are refused by name."""

from taichisoft_sofa.tree.scene_controller import SceneController


class OwnComponent(SceneController):
    """A component whose computation is a program of the scene.

    Attributes:
        refusal: why it is refused, and a way out.
    """

    refusal = ""


class ForceField(OwnComponent):
    """A force field of the scene's own."""

    refusal = (
        "is a force field of the scene's own, whose stiffness the solver here does not take; forces that are known "
        "come from ConstantForceField, springs from RestShapeSpringsForceField, other laws from a native scene"
    )


class DataEngine(OwnComponent):
    """An engine of the scene's own."""

    refusal = (
        "is an engine of the scene's own; compute its data in createScene, or in every step by a Sofa.Core.Controller"
    )
