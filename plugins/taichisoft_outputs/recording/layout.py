"""The datasets of a recording with their units; docs/reference/recording.md describes the whole file."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from taichisoft.actuators import ACTUATOR_KINDS, ActuatorKind
from taichisoft.errors import TaichisoftError

if TYPE_CHECKING:
    from taichisoft.actuators import Actuators
    from taichisoft.state import State

FILE_NAME = "recording.h5"
LAYOUT = 10
"""The only layout that this version writes and reads. Every change of what lies where in the file gets a new number."""
SIGNAL_COUNT = 32
"""Signals that there is room for: which ones come is not known when a file begins."""
UNFINISHED = "unfinished"
"""The outcome of a run that goes on, or was killed."""


class RecordingError(TaichisoftError):
    """A recording cannot be written or read."""


class DamagedContent(ValueError):
    """Something in the file is not what was written."""


@dataclass(frozen=True)
class Quantity:
    """A dataset.

    Attributes:
        unit: unit of its numbers.
        state_field: the field of `State` that it holds; "" for what a state does not have.
        single: whether it is in single precision, otherwise in that of the state.
        kind: the kind of actuators whose part it is of that field; None for the whole field.
    """

    unit: str
    state_field: str = ""
    single: bool = False
    kind: ActuatorKind | None = None

    def of(self, state: "State", actuators: "Actuators") -> Any:
        """What it holds of a state of a model with these actuators."""
        values = getattr(state, self.state_field)
        if self.kind is None:
            return values
        part = actuators.losses_of if self.state_field == "actuator_loss" else actuators.of
        return part(self.kind, values)


def _quantities(kind: ActuatorKind) -> dict[str, Quantity]:
    """The datasets with a column for each actuator of a kind."""
    effort, coordinate, value = kind.effort, kind.coordinate, kind.value
    either = f"{effort.unit} or {coordinate.unit}"
    found = {
        f"steps/{kind.imposed}": Quantity("1", "actuator_imposed", kind=kind),
        f"steps/{kind.name}_request": Quantity(either, "actuator_request", kind=kind),
        f"steps/{kind.name}_target": Quantity(either, "actuator_target", kind=kind),
        f"steps/{effort.name}": Quantity(effort.unit, "actuator_effort", kind=kind),
        f"steps/{value.name}": Quantity(value.unit, "actuator_value", kind=kind),
    }
    for figure in kind.figures:
        found[f"steps/{figure.name}"] = Quantity(figure.unit, figure.field)
    if kind.loss:
        found[f"steps/{kind.loss}"] = Quantity(effort.unit, "actuator_loss", kind=kind)
    if coordinate.observed:
        found[f"steps/{coordinate.name}"] = Quantity(coordinate.unit, kind=kind)
    return found


def _controls(kind: ActuatorKind) -> dict[str, Quantity]:
    """What a controller acts through by the actuators of a kind."""
    paths = (f"steps/{kind.imposed}", f"steps/{kind.name}_target")
    return {path.replace("steps/", "controls/"): _quantities(kind)[path] for path in paths}


COUNTS = {"states": "steps/state_count", "controls": "steps/control_count", "contacts": "steps/contact_count"}
"""Groups that have any number of rows in a frame, and the quantity that counts them."""

QUANTITIES = {
    "steps/time": Quantity("s", "time"),
    "steps/step": Quantity("1", "step"),
    "steps/position": Quantity("mm", "position", single=True),
    "steps/rigid_position": Quantity("mm", "rigid_position"),
    "steps/rigid_rotation": Quantity("quaternion w, x, y, z", "rigid_rotation"),
    "steps/rigid_velocity": Quantity("mm/s", "rigid_velocity"),
    "steps/rigid_angular_velocity": Quantity("rad/s", "rigid_angular_velocity"),
    "steps/base_translation": Quantity("mm", "base_translation"),
    "steps/base_rotation": Quantity("rad", "base_rotation"),
    "steps/base_request": Quantity("mm, rad", "base_request"),
    "steps/base_velocity": Quantity("mm/s, rad/s", "base_velocity"),
    "steps/base_wrench": Quantity("mN, mN mm", "base_wrench"),
    "steps/anchor_position": Quantity("mm", "anchor_position"),
    "steps/gravity": Quantity("mm/s^2", "gravity"),
    "steps/young_modulus": Quantity("kPa", "young_modulus"),
    **{path: quantity for kind in ACTUATOR_KINDS for path, quantity in _quantities(kind).items()},
    "steps/tube_air_mass": Quantity("kg", "tube_air_mass"),
    "steps/valve_request": Quantity("1", "valve_request"),
    "steps/supply_pressure": Quantity("kPa", "supply_pressure"),
    "steps/delayed_requests": Quantity("1 or kPa", "delayed_requests"),
    "steps/pull_point": Quantity("mm", "pull_point"),
    "steps/normal_force": Quantity("mN"),
    "steps/friction_force": Quantity("mN"),
    "steps/slip_speed": Quantity("mm/s"),
    "steps/slide": Quantity("mm"),
    "steps/signals": Quantity("of the controller"),
    **dict.fromkeys(COUNTS.values(), Quantity("1")),
    "steps/max_penetration": Quantity("mm"),
    "steps/iterations": Quantity("1"),
    "steps/residual": Quantity("mm/s"),
    "steps/converged": Quantity("1"),
    "steps/step_time": Quantity("s"),
    "states/position": Quantity("mm", "position"),
    "states/velocity": Quantity("mm/s", "velocity"),
    "controls/base_translation": Quantity("mm", "base_translation"),
    "controls/base_rotation": Quantity("rad", "base_rotation"),
    "controls/anchor_position": Quantity("mm", "anchor_position"),
    "controls/gravity": Quantity("mm/s^2", "gravity"),
    "controls/young_modulus": Quantity("kPa", "young_modulus"),
    **{path: quantity for kind in ACTUATOR_KINDS for path, quantity in _controls(kind).items()},
    "controls/valve_request": Quantity("1", "valve_request"),
    "controls/pull_point": Quantity("mm", "pull_point"),
    "contacts/bodies": Quantity("1", "contact_body_pair"),
    "contacts/point": Quantity("mm", "contact_point"),
    "contacts/normal": Quantity("1", "contact_normal"),
    "contacts/impulse": Quantity("mN s", "contact_impulse"),
    "contacts/slip": Quantity("mm/s", "contact_slip"),
}
"""All datasets of frames by their paths. `steps` have a row for every frame. Other groups have as many rows for a frame
as `COUNTS` says: `states` one where a run can go on, `controls` one for each step since the frame before that is not a
frame, `contacts` one for each contact."""
FIELDS = [path for path in QUANTITIES if path == "steps/position" or not path.startswith("steps/")]
"""The large part of a frame; the other quantities are its figures, which are read of many frames at once."""
CONTROLS = [path for path in QUANTITIES if path.startswith("controls/")]
"""What a controller acts through: parts of the state that a step takes over from its control."""


def group_of(path: str) -> str:
    """The group of a quantity: "steps", or one of `COUNTS`."""
    return path.split("/")[0]
