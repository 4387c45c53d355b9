"""What lies where in a recording: the groups and datasets of the HDF5 file, and how they are made.

attributes       taichisoft_version, scene (resolved TOML), gravity [mm/s^2], step_size [s], outcome
soft_bodies/I    attributes name and nodes (first and last+1 in the global arrays); rest_position, elements,
                 surface/{nodes, weights, triangles}, cavities/J/{the same}
rigid_bodies/I   attribute name; vertices (body frame), triangles
obstacles/I      attribute name; vertices and triangles, or attributes point and normal of a plane
steps/*          one row per frame; frame 0 is the state before the first step. Where a user started the run anew the
                 time goes back, and the frame there is the first state again
contacts/*       the contacts of all frames, one after the other; those of frame k are the rows
                 contact_offset[k] to contact_offset[k] + contact_count[k]
"""

from itertools import combinations_with_replacement
from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft.errors import TaichisoftError

if TYPE_CHECKING:
    from taichisoft.mapped_surface import MappedSurface
    from taichisoft.model import Model
    from taichisoft.simulation import StepReport
    from taichisoft.state import State

FILE_NAME = "recording.h5"

STATE_UNITS = {
    "time": "s",
    "step": "1",
    "position": "mm",
    "velocity": "mm/s",
    "rigid_position": "mm",
    "rigid_rotation": "quaternion w, x, y, z",
    "rigid_velocity": "mm/s",
    "rigid_angular_velocity": "rad/s",
    "base_translation": "mm",
    "base_rotation": "rad",
}
"""Datasets under `steps` that are taken from State as they are."""

REPORT_UNITS = {
    "pressure": "kPa",
    "volume": "mm^3",
    "normal_force": "mN",
    "friction_force": "mN",
    "contact_offset": "1",
    "contact_count": "1",
    "max_penetration": "mm",
    "iterations": "1",
    "residual": "mm/s",
    "converged": "1",
    "step_time": "s",
}
"""Datasets under `steps` that are taken from StepReport."""

CONTACT_UNITS = {"point": "mm", "force": "mN"}
"""Datasets under `contacts`; a force acts on the second body of its pair."""


class RecordingError(TaichisoftError):
    """A recording cannot be written or read."""


def cavity_names(model: "Model") -> list[str]:
    """Names of the columns of `pressure` and `volume`."""
    return [cavity.name for body in model.soft_bodies for cavity in body.cavities]


def pair_names(model: "Model") -> list[str]:
    """Names of the columns of `normal_force` and `friction_force`: every pair that could ever touch."""
    names = [body.name for body in model.soft_bodies]
    names += [body.name for body in model.rigid_bodies]
    names += [obstacle.name for obstacle in model.obstacles]
    return ["|".join(pair) for pair in combinations_with_replacement(names, 2)]


def state_row(state: "State") -> dict[str, np.ndarray]:
    """One row of each of the state's datasets."""
    return {name: np.array(getattr(state, name)) for name in STATE_UNITS}


def report_row(
    report: "StepReport | None", contact_offset: int, cavities: list[str], pairs: list[str]
) -> dict[str, np.ndarray]:
    """One row of each of the report's datasets; without a report (frame 0) NaN and zeros."""
    row: dict[str, Any] = {
        "pressure": _columns(report.pressures if report else None, cavities, np.nan),
        "volume": _columns(report.volumes if report else None, cavities, np.nan),
        "normal_force": _columns(report.normal_forces if report else None, pairs, 0.0),
        "friction_force": _columns(report.friction_forces if report else None, pairs, 0.0),
        "contact_offset": contact_offset,
        "contact_count": len(report.contact_points) if report else 0,
        "max_penetration": float(report.max_penetration) if report else 0.0,
        "iterations": int(report.iterations) if report else 0,
        "residual": float(report.residual) if report else 0.0,
        "converged": bool(report.converged) if report else True,
        "step_time": float(report.step_time) if report else 0.0,
    }
    return {name: np.array(value) for name, value in row.items()}


def write_bodies(file: Any, model: "Model") -> None:
    """Write what does not change during a run."""
    for index, body in enumerate(model.soft_bodies):
        group = file.create_group(f"soft_bodies/{index}")
        group.attrs["name"] = body.name
        group.attrs["nodes"] = (body.nodes.start, body.nodes.stop)
        group["rest_position"] = body.rest_position
        group["elements"] = body.elements
        _write_surface(group.create_group("surface"), body.surface)
        for number, cavity in enumerate(body.cavities):
            cavity_group = group.create_group(f"cavities/{number}")
            cavity_group.attrs["name"] = cavity.name
            _write_surface(cavity_group, cavity.surface)
    for index, rigid in enumerate(model.rigid_bodies):
        group = file.create_group(f"rigid_bodies/{index}")
        group.attrs["name"] = rigid.name
        group["vertices"], group["triangles"] = rigid.vertices, rigid.triangles
    for index, obstacle in enumerate(model.obstacles):
        group = file.create_group(f"obstacles/{index}")
        group.attrs["name"] = obstacle.name
        if obstacle.vertices is None:
            group.attrs["point"], group.attrs["normal"] = obstacle.point, obstacle.normal
        else:
            group["vertices"], group["triangles"] = obstacle.vertices, obstacle.triangles


def _write_surface(group: Any, surface: "MappedSurface") -> None:
    group["nodes"], group["weights"], group["triangles"] = surface.nodes, surface.weights, surface.triangles


def _columns(values: dict[str, float] | None, names: list[str], missing: float) -> np.ndarray:
    """The values in the order of `names`; a pair may come with its bodies the other way round."""
    row = np.full(len(names), missing)
    column = {name: index for index, name in enumerate(names)}
    for name, value in (values or {}).items():
        row[column[name] if name in column else column["|".join(reversed(name.split("|")))]] = value
    return row
