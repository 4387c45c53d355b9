"""Mechanical objects: their positions and velocities at the start."""

import contextlib
import re
from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft.errors import SceneError
from taichisoft_sofa.components.meshes import multiply_quaternions, placed, quaternion
from taichisoft_sofa.components.reading import (
    LOADERS,
    STATE,
    TOPOLOGIES,
    computed,
    described,
    in_node,
    inputs_of,
    is_given,
    nearest,
    node_of,
    number,
    numbers,
    text,
    vector,
)

if TYPE_CHECKING:
    from taichisoft_sofa.tree.component import Component

NO_POSE = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


WIDTHS = (3, 7)
"""Numbers of a point and of a pose."""


def is_rigid(state: "Component") -> bool:
    """Whether a mechanical object has frames of rigid bodies."""
    return width_of(state) == 7


def width_of(state: "Component") -> int:
    """Numbers per point or frame of a mechanical object; 0 for an unknown template."""
    template = text(state, "template", default="Vec3").partition(",")[0]
    if template.startswith("Rigid"):
        return 3 if template.startswith("Rigid2") else 7
    found = re.fullmatch(r"(?:Ext)?Vec(\d+)[dfiu]?", template)
    return int(found[1]) if found else 3 if not template else 0


def keep_start_position(state: "Component") -> None:
    """Keep the positions at the start, as SOFA does when it initialises a scene; later writes do not change them."""
    if not hasattr(state, "_start"):
        with contextlib.suppress(SceneError):  # refused where it is translated, if that needs it
            state._start = start_position(state)


def start_position(state: "Component") -> np.ndarray:
    """Positions at the start: points, shape (count, 3), or poses (x, y, z, qx, qy, qz, qw), shape (count, 7).

    Raises:
        SceneError: the positions are not rows of three or seven numbers, or the template is unknown.
    """
    if hasattr(state, "_start"):
        kept: np.ndarray = state._start
        return kept
    width = width_of(state)
    if width not in WIDTHS:
        raise SceneError(f"{described(state)}: template '{text(state, 'template')}'; known are Vec3 and Rigid3")
    found = _source(state, width)
    if len(found) == 0 and width == 7:
        found = np.array([NO_POSE])
    scale = vector(state, "scale3d", default=[number(state, "scale", default=1.0)] * 3)
    rotation = vector(state, "rotation", "rotation2", default=_axes(state, "r"))
    translation = vector(state, "translation", "translation2", default=_axes(state, "d"))
    points = placed(found[:, :3], scale.tolist(), rotation.tolist(), translation.tolist())
    if (scale == 1.0).all() and not rotation.any() and not translation.any():
        points = found[:, :3]
    if width == 3:
        return points
    turned = [multiply_quaternions(quaternion(rotation.tolist()), pose) for pose in found[:, 3:]]
    return np.column_stack([points, turned])


def _axes(state: "Component", letter: str) -> list[float]:
    """Translation (dx, dy, dz) or rotation (rx, ry, rz) in the older format."""
    return [number(state, f"{letter}{axis}", default=0.0) for axis in "xyz"]


def _source(state: "Component", width: int) -> np.ndarray:
    """Source of the positions of a mechanical object: its own data, a link, or its node's topology or loader."""
    for name in ("position", "rest_position"):
        if is_given(state, name):
            found = numbers(state, name)
            if found.size % width:
                raise SceneError(f"{described(state)}: {name} has {found.size} numbers; they are not rows of {width}")
            return found.reshape(-1, width)
    if width == 7:
        return np.zeros((0, 7))
    link = text(state, "src")
    source = state.linked("src") if link else in_node(node_of(state), TOPOLOGIES) or in_node(node_of(state), LOADERS)
    if source is not None and (points := computed(source, "position", 3)).size:
        return points
    if (subset := in_node(node_of(state), {"SubsetMapping"})) is not None and inputs_of(subset):
        whole, chosen = start_position(inputs_of(subset)[0]), numbers(subset, "indices").astype(np.int64)
        if len(chosen) and chosen.max() >= len(whole):
            raise SceneError(f"{described(subset)}: names point {int(chosen.max())}; there are {len(whole)}, from 0 on")
        return whole[chosen]
    if in_node(node_of(state), {"IdentityMapping"}) is not None:
        above = next((nearest(parent, {STATE}) for parent in node_of(state).parents), None)
        if above is not None:
            return start_position(above)
    return np.zeros((0, 3))


def start_velocity(state: "Component") -> np.ndarray:
    """Common initial velocity of all points of a mechanical object: (3,) [mm/s], or (6,) with [rad/s] for a frame.

    Raises:
        SceneError: the points have different velocities, or some have none.
    """
    width = 6 if is_rigid(state) else 3
    rows = numbers(state, "velocity")
    if not rows.any():
        return np.zeros(width)
    rows, count = rows.reshape(-1, width), len(start_position(state))
    if len(rows) != count or not (rows == rows[0]).all():
        raise SceneError(
            f"{described(state)}: velocity has {len(rows)} rows, not all alike or not one for each of {count} points; "
            "a body here begins with one velocity of all its points"
        )
    found: np.ndarray = rows[0]
    return found


def state_position(state: "Component") -> np.ndarray:
    if (width := width_of(state)) not in WIDTHS:  # such a state has no effect here, but its scene may read it
        return np.reshape(_given(state, "position"), (-1, max(width, 1)))
    return start_position(state)


def rest_position(state: "Component") -> np.ndarray:
    given = state.findData("rest_position")
    if given is not None and given.is_set():
        return np.reshape(given.given(), (-1, max(width_of(state), 1)))
    return state_position(state)


def _given(state: "Component", name: str) -> Any:
    data = state.findData(name)
    return np.zeros(0) if data is None else data.given()
