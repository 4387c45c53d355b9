"""The datasets of a recording with their units; docs/reference/recording.md describes the whole file."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from taichisoft.control import FIGURES, PAIRS, In
from taichisoft.errors import TaichisoftError
from taichisoft.mechanics import ACTUATOR_KINDS, ActuatorKind

if TYPE_CHECKING:
    from taichisoft.mechanics import Actuators, State

FILE_NAME = "recording.h5"
LAYOUT = 14
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
class RecordedQuantity:
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


def _quantities(kind: ActuatorKind) -> dict[str, RecordedQuantity]:
    effort, coordinate, value = kind.effort, kind.coordinate, kind.value
    either = f"{effort.unit} or {coordinate.unit}"
    found = {
        f"steps/{kind.imposed}": RecordedQuantity("1", "actuator_imposed", kind=kind),
        f"steps/{kind.name}_request": RecordedQuantity(either, "actuator_request", kind=kind),
        f"steps/{kind.name}_target": RecordedQuantity(either, "actuator_target", kind=kind),
        f"steps/{effort.name}": RecordedQuantity(effort.unit, "actuator_effort", kind=kind),
        f"steps/{value.name}": RecordedQuantity(value.unit, "actuator_value", kind=kind),
    }
    for figure in kind.figures:
        found[f"steps/{figure.name}"] = RecordedQuantity(figure.unit, figure.field)
    if kind.loss:
        found[f"steps/{kind.loss}"] = RecordedQuantity(effort.unit, "actuator_loss", kind=kind)
    if coordinate.observed:
        found[f"steps/{coordinate.name}"] = RecordedQuantity(coordinate.unit, kind=kind)
    return found


def _controls(kind: ActuatorKind) -> dict[str, RecordedQuantity]:
    paths = (f"steps/{kind.imposed}", f"steps/{kind.name}_target")
    return {path.replace("steps/", "controls/"): _quantities(kind)[path] for path in paths}


COUNTS = {
    "states": "steps/state_count",
    "controls": "steps/control_count",
    "controllers": "steps/controller_count",
    "contacts": "steps/contact_count",
}
"""Groups that have any number of rows in an instant, and the quantity that counts them."""
OF_PAIRS = [figure for figure in FIGURES if figure.per is PAIRS and In.RECORDING in figure.recorded]
"""Figures with a column for each pair of bodies."""

QUANTITIES = {
    "steps/time": RecordedQuantity("s", "time"),
    "steps/step": RecordedQuantity("1", "step"),
    "steps/position": RecordedQuantity("mm", "position", single=True),
    "steps/rigid_position": RecordedQuantity("mm", "rigid_position"),
    "steps/rigid_rotation": RecordedQuantity("quaternion w, x, y, z", "rigid_rotation"),
    "steps/rigid_velocity": RecordedQuantity("mm/s", "rigid_velocity"),
    "steps/rigid_angular_velocity": RecordedQuantity("rad/s", "rigid_angular_velocity"),
    "steps/frame_pose": RecordedQuantity("mm, rad", "frame_pose"),
    "steps/frame_request": RecordedQuantity("mm, rad", "frame_request"),
    "steps/frame_velocity": RecordedQuantity("mm/s, rad/s", "frame_velocity"),
    "steps/frame_wrench": RecordedQuantity("mN, mN mm", "frame_wrench"),
    "steps/external_force": RecordedQuantity("mN, mN mm, mm", "external_force"),
    "steps/external_force_steps": RecordedQuantity("1", "external_force_steps"),
    "steps/external_force_own_axes": RecordedQuantity("1", "external_force_own_axes"),
    "steps/anchor_position": RecordedQuantity("mm", "anchor_position"),
    "steps/gravity": RecordedQuantity("mm/s^2", "gravity"),
    "steps/young_modulus": RecordedQuantity("kPa", "young_modulus"),
    **{path: quantity for kind in ACTUATOR_KINDS for path, quantity in _quantities(kind).items()},
    "steps/tube_air_mass": RecordedQuantity("kg", "tube_air_mass"),
    "steps/warm_air_space": RecordedQuantity("mm^3", "warm_air_space"),
    "steps/valve_request": RecordedQuantity("1", "valve_request"),
    "steps/supply_pressure": RecordedQuantity("kPa", "supply_pressure"),
    "steps/delayed_requests": RecordedQuantity("1 or kPa", "delayed_requests"),
    "steps/network_pressure": RecordedQuantity("kPa", "network_pressure"),
    "steps/network_flow": RecordedQuantity("kg/s", "network_flow"),
    "steps/network_air_mass": RecordedQuantity("kg", "network_air_mass"),
    "steps/network_request": RecordedQuantity("1 or kPa", "network_request"),
    "steps/network_target": RecordedQuantity("1 or kPa", "network_target"),
    "steps/network_drive": RecordedQuantity("1 or kPa", "network_drive"),
    "steps/network_delayed": RecordedQuantity("1 or kPa", "network_delayed"),
    "steps/pull_point": RecordedQuantity("mm", "pull_point"),
    "steps/sensor_memory": RecordedQuantity("of the quantities", "sensor_memory"),
    **{f"steps/{figure.name}": RecordedQuantity(figure.unit) for figure in OF_PAIRS},
    "steps/slide": RecordedQuantity("mm"),
    "steps/signals": RecordedQuantity("of the controller"),
    **dict.fromkeys(COUNTS.values(), RecordedQuantity("1")),
    "steps/max_penetration": RecordedQuantity("mm"),
    "steps/iterations": RecordedQuantity("1"),
    "steps/residual": RecordedQuantity("mm/s"),
    "steps/converged": RecordedQuantity("1"),
    "steps/step_time": RecordedQuantity("s"),
    "states/position": RecordedQuantity("mm", "position"),
    "states/velocity": RecordedQuantity("mm/s", "velocity"),
    "controls/frame_pose": RecordedQuantity("mm, rad", "frame_pose"),
    "controls/external_force": RecordedQuantity("mN, mN mm, mm", "external_force"),
    "controls/external_force_steps": RecordedQuantity("1", "external_force_steps"),
    "controls/external_force_own_axes": RecordedQuantity("1", "external_force_own_axes"),
    "controls/anchor_position": RecordedQuantity("mm", "anchor_position"),
    "controls/gravity": RecordedQuantity("mm/s^2", "gravity"),
    "controls/young_modulus": RecordedQuantity("kPa", "young_modulus"),
    **{path: quantity for kind in ACTUATOR_KINDS for path, quantity in _controls(kind).items()},
    "controls/valve_request": RecordedQuantity("1", "valve_request"),
    "controls/network_target": RecordedQuantity("1 or kPa", "network_target"),
    "controls/pull_point": RecordedQuantity("mm", "pull_point"),
    "controllers/saved": RecordedQuantity("byte"),
    "contacts/bodies": RecordedQuantity("1", "contact_body_pair"),
    "contacts/point": RecordedQuantity("mm", "contact_point"),
    "contacts/normal": RecordedQuantity("1", "contact_normal"),
    "contacts/impulse": RecordedQuantity("mN s", "contact_impulse"),
    "contacts/slip": RecordedQuantity("mm/s", "contact_slip"),
}
"""All datasets of instants by their paths. `steps` have a row for every instant. Other groups have as many rows for one
as `COUNTS` says: `states` one where a run can go on, `controls` one for each step between it and the instant before,
`controllers` one for each byte of what the controller remembers, `contacts` one for each contact."""
FIELDS = [path for path in QUANTITIES if path == "steps/position" or not path.startswith("steps/")]
"""The large part of an instant; the other quantities are its figures, which are read of many instants at once."""
CONTROLS = [path for path in QUANTITIES if path.startswith("controls/")]
"""What a controller acts through: parts of the state that a step takes over from its control."""


def group_of(path: str) -> str:
    """The group of a quantity: "steps", or one of `COUNTS`."""
    return path.split("/")[0]
