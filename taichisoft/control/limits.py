"""What a scene's limits leave of a controller's requests, and which of them they clipped."""

import math

import numpy as np

from taichisoft.bodies.rotations import turn_towards
from taichisoft.model import Model
from taichisoft.scenes.scene import Limits
from taichisoft.state import State


def limit_pressures(
    limits: Limits, time_step: float, state: State, volume_imposed: np.ndarray, request: np.ndarray
) -> np.ndarray:
    """Pressures [kPa] within their range and not too far from the last ones; growths [mm^3] as they were asked for."""
    if not len(request):
        return request
    lowest = -math.inf if limits.lowest_pressure is None else limits.lowest_pressure
    highest = math.inf if limits.highest_pressure is None else limits.highest_pressure
    allowed = np.clip(request, lowest, highest)
    if limits.pressure_rate is not None:
        # A cavity that was driven by its volume goes on from the pressure which that took.
        last = np.where(state.cavity_volume_imposed, state.cavity_pressure, state.cavity_target)
        furthest = limits.pressure_rate * time_step
        allowed = np.clip(allowed, last - furthest, last + furthest)
    return np.where(volume_imposed, request, allowed)


def limit_base(limits: Limits, time_step: float, state: State, request: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Translation [mm] and rotation vector [rad] of the base, on the straight way to the requested ones (2, 3)."""
    translation, rotation = request
    if limits.base_speed is not None:
        way = translation - state.base_translation
        length, furthest = float(np.linalg.norm(way)), limits.base_speed * time_step
        if length > furthest:
            translation = state.base_translation + furthest / length * way
    if limits.base_turning_speed is not None:
        furthest = math.radians(limits.base_turning_speed) * time_step
        rotation = turn_towards(state.base_rotation, rotation, furthest)
    return translation.copy(), rotation.copy()


def clipped(model: Model, state: State) -> tuple[str, ...]:
    """What of the last request was held back: names of cavities, "base_translation", "base_rotation"."""
    names = [
        name
        for name, request, target in zip(
            model.cavities.names, state.cavity_request.tolist(), state.cavity_target.tolist(), strict=True
        )
        if request != target
    ]
    if (state.base_request[0] != state.base_translation).any():
        names.append("base_translation")
    if (state.base_request[1] != state.base_rotation).any():
        names.append("base_rotation")
    return tuple(names)
