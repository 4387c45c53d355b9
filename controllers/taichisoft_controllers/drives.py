"""The ways to drive actuators that scripts and keys know: by pressure, by tension, by how far cables are pulled in."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from pydantic import Field, create_model

from taichisoft.actuators import ACTUATOR_KINDS, CABLES, CAVITIES, ActuatorKind, Drive, kind_of
from taichisoft.control import Observation
from taichisoft.scenes import Table

if TYPE_CHECKING:
    from taichisoft.model import Model

PRESSURE, PULL, TENSION = CAVITIES.effort, CABLES.coordinate, CABLES.effort
DRIVES = tuple(drive for kind in ACTUATOR_KINDS for drive in kind.drives)
"""The drives of all kinds of actuators; drives of one kind exclude each other for an actuator."""


def driven_by(drive: Drive, model: "Model") -> tuple[str, ...]:
    """Names of all actuators of a model that can be driven so."""
    return model.actuators.driven_by(kind_of(drive), drive)


def table_of_drives(name: str, base: type[Table], field: Callable[[Drive, ActuatorKind], tuple[str, Any, str]]) -> Any:
    """A table with a key for each drive, None where it is not given.

    Args:
        name: name of the table.
        base: table whose keys it has as well.
        field: gives key, type and meaning for a drive and the kind of actuators that it drives.
    """
    fields = [field(drive, kind_of(drive)) for drive in DRIVES]
    made: dict[str, Any] = {key: (kind | None, Field(None, description=meaning)) for key, kind, meaning in fields}
    return create_model(name, __base__=base, **made)


def read_drive(drive: Drive, observation: Observation, actuator: str) -> float:
    """What an actuator was driven with in the last step, or what came of it."""
    value: Any = getattr(observation, drive.observed)[actuator]
    return float(value)
