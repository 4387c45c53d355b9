"""What lies where in a recording: the groups and datasets of the HDF5 file, their units, and who asks for them.

attributes       taichisoft_version, versions (JSON), layout, scene (resolved TOML), fields, every (steps from
                 frame to frame), gravity [mm/s^2], step_size [s], outcome
frames           how many frames were written whole; written last, so that what it counts can be relied on
soft_bodies/I    attributes name and nodes (first and last+1 in the global arrays); mesh_nodes (as in its file, [mm]),
                 rest_position (placed, [mm]), elements, young_modulus [kPa] and poisson_ratio of each element,
                 element_groups/NAME, surface_groups/NAME, surface/{nodes, weights, triangles}, cavities/J/{the same}
rigid_bodies/I   attribute name; vertices (body frame), triangles
obstacles/I      attribute name; vertices and triangles, or attributes point and normal of a plane
steps/*          attributes cavities and pairs (names of columns); one row per frame; frame 0 is the state before the
                 first step. Where a user started the run anew the time goes back, and the frame there is the first
                 state again
contacts/*       the contacts of all frames, one after the other; those of frame k are the rows
                 contact_offset[k] to contact_offset[k] + contact_count[k]

Where frames are several steps apart, the quantities of the field "solver" tell of all steps since the frame before: the
worst of them, and the mean of the step times. Everything else is that of the frame's own step.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from taichisoft.errors import TaichisoftError

FILE_NAME = "recording.h5"
LAYOUT = 2
"""Counts changes that make older files lack something."""
OPENED: Any = {"libver": "latest", "locking": False}
"""How the file is opened. A reader's lock would keep a run in progress from closing it, and in one process all who open
a file must do it alike."""

FIELDS = {
    "positions": "positions of the nodes: to draw anything",
    "velocities": "of the nodes and the rigid bodies",
    "contacts": "where each contact is and how it pushes",
    "forces": "normal and friction force and slip of each pair of bodies",
    "cavities": "pressures and volumes",
    "controls": "what the controller asked for",
    "solver": "sweeps, residual, penetration and time of the steps",
}
"""What `--fields` may name; time, rigid poses and the base are always recorded."""


class RecordingError(TaichisoftError):
    """A recording cannot be written or read."""


@dataclass(frozen=True)
class Quantity:
    """A dataset.

    Attributes:
        unit: of its numbers.
        field: the one of `FIELDS` that brings it; "" for what is always recorded.
        of_state: attribute of State that it is; "" for what State does not have.
    """

    unit: str
    field: str = ""
    of_state: str = ""


STEP_QUANTITIES = {
    "time": Quantity("s", "", "time"),
    "step": Quantity("1", "", "step"),
    "position": Quantity("mm", "positions", "position"),
    "velocity": Quantity("mm/s", "velocities", "velocity"),
    "rigid_position": Quantity("mm", "", "rigid_position"),
    "rigid_rotation": Quantity("quaternion w, x, y, z", "", "rigid_rotation"),
    "rigid_velocity": Quantity("mm/s", "velocities", "rigid_velocity"),
    "rigid_angular_velocity": Quantity("rad/s", "velocities", "rigid_angular_velocity"),
    "base_translation": Quantity("mm", "", "base_translation"),
    "base_rotation": Quantity("rad", "", "base_rotation"),
    "base_request": Quantity("mm, rad", "controls", "base_request"),
    "base_velocity": Quantity("mm/s, rad/s", "controls", "base_velocity"),
    "volume_imposed": Quantity("1", "controls", "cavity_volume_imposed"),
    "cavity_request": Quantity("kPa or mm^3", "controls", "cavity_request"),
    "cavity_target": Quantity("kPa or mm^3", "controls", "cavity_target"),
    "cavity_impulse": Quantity("kPa s", "cavities", "cavity_impulse"),
    "volume": Quantity("mm^3", "cavities", "cavity_volume"),
    "pressure": Quantity("kPa", "cavities"),
    "normal_force": Quantity("mN", "forces"),
    "friction_force": Quantity("mN", "forces"),
    "slip_speed": Quantity("mm/s", "forces"),
    "contact_offset": Quantity("1", "contacts"),
    "contact_count": Quantity("1", "contacts"),
    "max_penetration": Quantity("mm", "solver"),
    "iterations": Quantity("1", "solver"),
    "residual": Quantity("mm/s", "solver"),
    "converged": Quantity("1", "solver"),
    "step_time": Quantity("s", "solver"),
}
"""Datasets of the group `steps`."""

CONTACT_QUANTITIES = {
    "body_pair": Quantity("numbers of the first and second body", "contacts", "contact_body_pair"),
    "point": Quantity("mm", "contacts", "contact_point"),
    "normal": Quantity("1", "contacts", "contact_normal"),
    "impulse": Quantity("mN s", "contacts", "contact_impulse"),
    "slip": Quantity("mm/s", "contacts", "contact_slip"),
}
"""Datasets of the group `contacts`; normal and impulse are towards the second body of its pair."""


def recorded(quantities: dict[str, Quantity], fields: Sequence[str]) -> dict[str, Quantity]:
    """Those that are in a recording of these fields."""
    return {name: quantity for name, quantity in quantities.items() if not quantity.field or quantity.field in fields}


def parse_fields(text: str) -> tuple[str, ...]:
    """The fields that `--fields` names, in the order of `FIELDS`.

    Raises:
        RecordingError: there is no such field, or none is named.
    """
    names = [name.strip() for name in text.split(",") if name.strip()]
    unknown = [name for name in names if name not in FIELDS]
    if unknown or not names:
        wrong = f"no field is called '{unknown[0]}'" if unknown else "names no field"
        raise RecordingError(f"--fields {text}: {wrong}; there are: {', '.join(FIELDS)}")
    return tuple(field for field in FIELDS if field in names)
