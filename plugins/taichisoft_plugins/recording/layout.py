"""The datasets of a recording with their units; docs/reference/recording.md describes the whole file."""

from dataclasses import dataclass

from taichisoft.errors import TaichisoftError

FILE_NAME = "recording.h5"
LAYOUT = 8
"""The only layout that this version writes and reads. Every change of what lies where in the file gets a new number."""
OUTCOME_LENGTH = 2000
"""Most bytes of the text that says how the run ended."""
SIGNAL_NAMES = "signal_names"
"""Dataset with the names of the columns of `steps/signals`, in the order in which the signals first came."""
SIGNAL_COUNT, SIGNAL_NAME_LENGTH = 32, 200
"""Signals that there is room for, and most bytes of their names: what may come is not known when a file begins."""
UNFINISHED = "unfinished"
"""This text while the run goes on, and after it was killed."""


class RecordingError(TaichisoftError):
    """A recording cannot be written or read."""


@dataclass(frozen=True)
class Quantity:
    """A dataset.

    Attributes:
        unit: unit of its numbers.
        state_field: the field of `State` that it holds; "" for what a state does not have.
    """

    unit: str
    state_field: str = ""


QUANTITIES = {
    "steps/time": Quantity("s", "time"),
    "steps/step": Quantity("1", "step"),
    "steps/position": Quantity("mm", "position"),
    "steps/velocity": Quantity("mm/s", "velocity"),
    "steps/rigid_position": Quantity("mm", "rigid_position"),
    "steps/rigid_rotation": Quantity("quaternion w, x, y, z", "rigid_rotation"),
    "steps/rigid_velocity": Quantity("mm/s", "rigid_velocity"),
    "steps/rigid_angular_velocity": Quantity("rad/s", "rigid_angular_velocity"),
    "steps/base_translation": Quantity("mm", "base_translation"),
    "steps/base_rotation": Quantity("rad", "base_rotation"),
    "steps/base_request": Quantity("mm, rad", "base_request"),
    "steps/base_velocity": Quantity("mm/s, rad/s", "base_velocity"),
    "steps/anchor_position": Quantity("mm", "anchor_position"),
    "steps/gravity": Quantity("mm/s^2", "gravity"),
    "steps/young_modulus": Quantity("kPa", "young_modulus"),
    "steps/volume_imposed": Quantity("1", "cavity_volume_imposed"),
    "steps/cavity_request": Quantity("kPa or mm^3", "cavity_request"),
    "steps/cavity_target": Quantity("kPa or mm^3", "cavity_target"),
    "steps/volume": Quantity("mm^3", "cavity_volume"),
    "steps/pressure": Quantity("kPa", "cavity_pressure"),
    "steps/pull_imposed": Quantity("1", "cable_pull_imposed"),
    "steps/cable_request": Quantity("mN or mm", "cable_request"),
    "steps/cable_target": Quantity("mN or mm", "cable_target"),
    "steps/tension": Quantity("mN", "cable_tension"),
    "steps/tension_loss": Quantity("mN", "cable_tension_loss"),
    "steps/cable_length": Quantity("mm", "cable_length"),
    "steps/pull_point": Quantity("mm", "pull_point"),
    "steps/pull": Quantity("mm"),
    "steps/normal_force": Quantity("mN"),
    "steps/friction_force": Quantity("mN"),
    "steps/slip_speed": Quantity("mm/s"),
    "steps/slide": Quantity("mm"),
    "steps/signals": Quantity("of the controller"),
    "steps/contact_offset": Quantity("1"),
    "steps/contact_count": Quantity("1"),
    "steps/max_penetration": Quantity("mm"),
    "steps/iterations": Quantity("1"),
    "steps/residual": Quantity("mm/s"),
    "steps/converged": Quantity("1"),
    "steps/step_time": Quantity("s"),
    "contacts/bodies": Quantity("1", "contact_body_pair"),
    "contacts/point": Quantity("mm", "contact_point"),
    "contacts/normal": Quantity("1", "contact_normal"),
    "contacts/impulse": Quantity("mN s", "contact_impulse"),
    "contacts/slip": Quantity("mm/s", "contact_slip"),
}
"""All datasets of frames by their paths; `steps` have a row for every frame, `contacts` for each of its contacts."""
