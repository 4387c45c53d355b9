"""Reasons for which components are refused: the inverse solver, and types that are not known here."""

import difflib
from collections.abc import Sequence
from typing import TYPE_CHECKING

from taichisoft_sofa.components.component_table import UNDERSTOOD
from taichisoft_sofa.components.typed_values import described

if TYPE_CHECKING:
    from taichisoft_sofa.tree.component import Component

INVERSE = {
    "QPInverseProblemSolver",
    *("PositionEffector", "BarycentricCenterEffector", "CableEffector", "VolumeEffector", "ForceEffector"),
    *("JointActuator", "CableActuator", "SurfacePressureActuator", "ForcePointActuator", "ForceSurfaceActuator"),
    *("SlidingActuator", "YoungModulusActuator", "ForceLocalizationActuator", "AffineActuator"),
    *("CableEquality", "PositionEquality", "SurfacePressureEquality", "ForcePointEquality", "SlidingEquality"),
    *("CableSensor", "PositionSensor", "SurfacePressureSensor", "ForceSurfaceSensor", "BarycentricCenterSensor"),
}
"""Types of SoftRobots.Inverse."""

PURPOSES = {
    "ForceField": "forces on the bodies",
    "Mass": "the mass of a body",
    "Solver": "how bodies move in time",
    "ConstraintCorrection": "how constraints move a body",
    "Constraint": "what bodies must not do, or an actuator",
    "CollisionModel": "a surface that touches others",
    "Intersection": "how contacts are found",
    "Mapping": "points that follow a body",
    "Loader": "a mesh",
    "Container": "the topology of a body",
    "Topology": "the topology of a body",
    "ROI": "a selection of points",
    "Engine": "data that other components read",
    "Controller": "what happens while the scene runs",
    "Actuator": "an actuator",
}
"""Purpose of a type of component, by the end of its name."""


def refuse_unknown(component: "Component") -> str:
    """Reason for which a component of a type that is not known here is refused."""
    kind = component.type_name
    purpose = next((what for ending, what in PURPOSES.items() if kind.endswith(ending)), "an unknown purpose")
    near = difflib.get_close_matches(kind, UNDERSTOOD, n=1, cutoff=0.9)  # a misspelt name, not another component
    hint = f"; did you mean '{near[0]}'?" if near else ""
    return f"{described(component)}: is not known here; it would be needed for {purpose}{hint}"


def refuse_inverse(components: "Sequence[Component]") -> str:
    """Reason for which a scene with components of the inverse solver is refused, in one line for all of them."""
    others = sorted({component.type_name for component in components} - {components[0].type_name})
    beside = f", beside {', '.join(others)}" if others else ""
    return (
        f"{described(components[0])}: belongs to the inverse solver of SoftRobots.Inverse{beside}, whose method is "
        "patented and not built here; a controller of the scene's own, or `taichisoft study optimise`, can find what "
        "reaches a goal"
    )
