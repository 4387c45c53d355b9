"""The motion of frames: what a controller or the scene asks of them, what limits leave of it, and what is seen."""

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from taichisoft.bodies.rotations import compose_rotation_vectors, turn_towards
from taichisoft.control.control import Control
from taichisoft.control.requested_values import finite, index_of
from taichisoft.errors import ControlError
from taichisoft.model import Model
from taichisoft.scenes.frame_settings import BASE, FramePath, FrameSettings, HingeSettings
from taichisoft.state import State

PARTS = (("translation", "velocity"), ("rotation", "angular_velocity"))
"""The rows of a pose, each with its rate: keys of a control behind "base_" and "frame_"."""
BASE_KEYS = tuple(f"{BASE}_{kind}" for part in PARTS for kind in part)
FRAME_MAPPINGS = (*(f"frame_{kind}" for part in PARTS for kind in part), "frame_angle")
"""Keys of a control that ask for the motion of the base, and of other frames by name."""


def frames_move(model: Model, state: State, control: Control) -> bool:
    """Whether a frame is asked to move, follows a path, or has not arrived yet."""
    if any(getattr(control, key) is not None for key in BASE_KEYS) or any(getattr(control, k) for k in FRAME_MAPPINGS):
        return True
    if state.frame_velocity.any() or any(one.path is not None for one in model.scene.frames.values()):
        return True
    # Of so few numbers Python's lists are compared faster than arrays.
    return bool(state.frame_request.tolist() != state.frame_pose.tolist())


def frame_requests(model: Model, state: State, control: Control) -> dict[str, np.ndarray]:
    """What the frames are asked for, and how far they get in this step.

    Raises:
        ControlError: a frame is unknown, asked for in two ways, or for what it cannot do; or a value is not finite.
    """
    tables, time_step = model.scene.all_frames, model.scene.time.step
    request, velocity = state.frame_request.copy(), state.frame_velocity.copy()
    for row, (pose, rate) in enumerate(PARTS):
        poses, rates = (_asked(model, tables, control, kind) for kind in (pose, rate))
        for number, (key, _) in rates.items():
            if number in poses:
                raise ControlError(f"control: {poses[number][0]} and {key} are both given; give one of them")
        for number, (key, value) in poses.items():
            request[number, row] = finite(value, f"control.{key}", (3,))
            velocity[number, row] = 0.0
        for number, (key, value) in rates.items():
            velocity[number, row], request[number, row] = (
                finite(value, f"control.{key}", (3,)),
                state.frame_pose[number, row],
            )
    for name, angle in control.frame_angle.items():
        number = index_of(name, model.frames.names, "frame", "frame_angle")
        hinge, key = tables[name].hinge, f"control.frame_angle['{name}']"
        if hinge is None:
            raise ControlError(f"{key}: this frame has no hinge; give it one in the scene, or ask for frame_rotation")
        request[number, 1] = hinge.unit_axis * finite(angle, key, ())
    found = state.frame_pose.copy()
    for number, table in enumerate(tables.values()):
        if table.path is not None:
            request[number] = found[number] = _on_path(table.path, (state.step + 1) * time_step)
            continue
        if velocity[number, 0].any():
            request[number, 0] = state.frame_pose[number, 0] + time_step * velocity[number, 0]
        if velocity[number, 1].any():
            request[number, 1] = compose_rotation_vectors(time_step * velocity[number, 1], state.frame_pose[number, 1])
        if (request[number] != found[number]).any():
            found[number] = _limited(table, time_step, found[number], request[number])
    return {"frame_request": request, "frame_velocity": velocity, "frame_pose": found}


def _asked(
    model: Model, tables: Mapping[str, FrameSettings], control: Control, kind: str
) -> dict[int, tuple[str, np.ndarray]]:
    """What is asked for of a kind, such as "translation", by number of the frame: key for messages, and value."""
    found, of_base = {}, getattr(control, f"{BASE}_{kind}")
    if of_base is not None:
        found[0] = (f"{BASE}_{kind}", of_base)
    for name, value in getattr(control, f"frame_{kind}").items():
        key = f"frame_{kind}['{name}']"
        number = index_of(name, model.frames.names, "frame", f"frame_{kind}")
        if number in found:
            raise ControlError(f"control: {found[number][0]} and {key} are both given; give one of them")
        if tables[name].path is not None:
            raise ControlError(f"control.{key}: this frame moves on its path; remove the path from the scene")
        if tables[name].hinge is not None:
            raise ControlError(f"control.{key}: this frame turns about its hinge; ask for frame_angle")
        found[number] = (key, value)
    return found


def _on_path(path: FramePath, time: float) -> np.ndarray:
    """Pose on a path [mm] and [rad], shape (2, 3)."""
    rows = [
        np.zeros(3) if values is None else [np.interp(time, path.times, axis) for axis in np.transpose(values)]
        for values in (path.translations, path.rotations)
    ]
    return np.array(rows) * [[1.0], [math.radians(1.0)]]


def _limited(table: FrameSettings, time_step: float, pose: np.ndarray, request: np.ndarray) -> np.ndarray:
    """Pose after a step [s] on the straight way to the requested one; all of shape (2, 3)."""
    translation, rotation = request
    if table.speed is not None:
        way = translation - pose[0]
        length, furthest = float(np.linalg.norm(way)), table.speed * time_step
        if length > furthest:
            translation = pose[0] + furthest / length * way
    furthest = math.inf if table.turning_speed is None else math.radians(table.turning_speed) * time_step
    if table.hinge is not None:
        rotation = _limited_turn(table.hinge, furthest, pose[1], rotation)
    elif furthest < math.inf:
        rotation = turn_towards(pose[1], rotation, furthest)
    return np.array([translation, rotation])


def _limited_turn(hinge: HingeSettings, furthest: float, last: np.ndarray, request: np.ndarray) -> np.ndarray:
    """Rotation vector of a hinge [rad], shape (3,): it goes the way of its angle, not the shortest one to a pose."""
    axis = hinge.unit_axis
    asked, before = float(request @ axis), float(last @ axis)
    low = -math.inf if hinge.lowest_angle is None else math.radians(hinge.lowest_angle)
    high = math.inf if hinge.highest_angle is None else math.radians(hinge.highest_angle)
    angle = min(max(min(max(asked, low), high), before - furthest), before + furthest)
    return request if angle == asked else angle * axis


def observed_frames(model: Model, state: State) -> dict[str, Any]:
    """The fields of an observation with the frames' poses, and what acts on them."""
    names, turns = model.frames.names, model.places(state).turn
    (force, torque), turn = state.frame_wrench[0], turns[0]
    hinges = {name: one.hinge.unit_axis for name, one in model.scene.frames.items() if one.hinge is not None}
    angles, moments = {}, {}
    for name, axis in hinges.items():
        number = names.index(name)
        angles[name] = float(state.frame_pose[number, 1] @ axis)
        moments[name] = float(state.frame_wrench[number, 1] @ turns[number] @ axis)
    return {
        "base_translation": state.base_translation,
        "base_rotation": state.base_rotation,
        "base_force": force,
        "base_torque": torque,
        "base_force_in_base": turn.T @ force,
        "base_torque_in_base": turn.T @ torque,
        "frame_translations": dict(zip(names[1:], state.frame_pose[1:, 0], strict=True)),
        "frame_rotations": dict(zip(names[1:], state.frame_pose[1:, 1], strict=True)),
        "frame_forces": dict(zip(names[1:], state.frame_wrench[1:, 0], strict=True)),
        "frame_torques": dict(zip(names[1:], state.frame_wrench[1:, 1], strict=True)),
        "frame_angles": MappingProxyType(angles),
        "frame_moments": MappingProxyType(moments),
    }
