"""All kinds of actuators: their coordinates stand in this order in every array."""

from taichisoft.actuators.cables import CABLES
from taichisoft.actuators.cavities import CAVITIES
from taichisoft.actuators.kind import ActuatorKind, Drive

ACTUATOR_KINDS: tuple[ActuatorKind, ...] = (CAVITIES, CABLES)


def kind_called(name: str) -> ActuatorKind:
    """The kind of that name."""
    return next(kind for kind in ACTUATOR_KINDS if kind.name == name)


def kind_of(drive: Drive) -> ActuatorKind:
    """The kind whose actuators are driven so."""
    return next(kind for kind in ACTUATOR_KINDS if drive in (kind.effort, kind.coordinate, *kind.figures))
