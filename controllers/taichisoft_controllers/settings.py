"""Settings of controllers, and the drives that they ask for."""

import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Self

from pydantic import Field, ValidationError, create_model

from taichisoft.control import Observation, Slider
from taichisoft.errors import SceneError
from taichisoft.mechanics import ACTUATOR_KINDS, CABLES, CAVITIES, ActuatorKind, Drive, kind_of, network_drives
from taichisoft.scene import Table, first_problem, key_descriptions

if TYPE_CHECKING:
    from taichisoft.contact import Model

# The ways to drive actuators that scripts and keys know: by pressure, by tension, by how far cables are pulled in.

PRESSURE, PULL, TENSION = CAVITIES.effort, CABLES.coordinate, CABLES.effort
DRIVES = tuple(drive for kind in ACTUATOR_KINDS for drive in kind.drives)
"""The drives of all kinds of actuators; drives of one kind exclude each other for an actuator."""


def driven_by(drive: Drive, model: "Model") -> tuple[str, ...]:
    """Names of all actuators of a model that can be driven so."""
    return model.actuators.driven_by(kind_of(drive), drive)


def driven_anywhere(drive: Drive, model: "Model") -> tuple[str, ...]:
    """The same, and names of valves and regulators of the scene's air network."""
    return (*driven_by(drive, model), *(name for name, one in network_drives(model.scene.air).items() if one is drive))


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
    """What an actuator, valve or regulator was driven with in the last step, or what came of it."""
    values: Any = getattr(observation, drive.observed)
    if drive.elsewhere and actuator not in values:
        values = getattr(observation, drive.elsewhere)
    return float(values[actuator])


# The base class of the controllers' settings.


class ControllerSettings(Table):
    """Settings of a controller, as `controller.settings` of a scene gives them."""

    @classmethod
    def checked(cls, **settings: Any) -> Self:
        """The settings as valid data."""
        try:
            return cls.model_validate(settings)
        except ValidationError as error:
            raise SceneError(first_problem(error, cls, "controller.settings")) from error


def tunable_settings(settings: type[ControllerSettings]) -> dict[str, Slider]:
    """Sliders of all settings that are numbers with a fraction, up to three times what they usually are.

    The unit is what stands in brackets at the end of a setting's docstring.
    """
    sliders, meanings = {}, key_descriptions(settings)
    for name, field in settings.model_fields.items():
        if not isinstance(field.default, float):
            continue
        step = field.default / 100.0
        lowest = max(
            (lowest_given + step if key == "gt" else lowest_given)
            for bound in field.metadata
            for key in ("gt", "ge")
            if (lowest_given := getattr(bound, key, None)) is not None
        )
        unit = re.search(r"\[([^\]]*)\]\.?$", meanings[name])
        sliders[name] = Slider(field.default, lowest, 3.0 * field.default, step, unit[1] if unit else "1")
    return sliders
