"""What a scene's limits leave of a controller's requests, and which of them they clipped."""

import math

import numpy as np

from taichisoft.bodies.rotations import turn_towards
from taichisoft.model import Model
from taichisoft.scenes.scene import Limits
from taichisoft.state import State


def limit_cavities(model: Model, state: State, volume_imposed: np.ndarray, request: np.ndarray) -> np.ndarray:
    """Pressures [kPa] and growths [mm^3] within the cavities' own ranges, pressures not too far from the last ones."""
    if not len(request):
        return request
    limits, time_step, cavities = model.scene.limits, model.scene.time.step, model.cavities
    low, high = np.where(volume_imposed, cavities.growth_range.T, cavities.pressure_range.T)
    # As np.clip, whose checks take several times as long as so few numbers.
    allowed = request = np.minimum(np.maximum(request, low), high)
    if limits.lowest_pressure is not None:
        allowed = np.maximum(allowed, limits.lowest_pressure)
    if limits.highest_pressure is not None:
        allowed = np.minimum(allowed, limits.highest_pressure)
    if limits.pressure_rate is not None:
        # A cavity that was driven by its volume goes on from the pressure which that took.
        last = np.where(state.cavity_volume_imposed, state.cavity_pressure, state.cavity_target)
        furthest = limits.pressure_rate * time_step
        allowed = np.minimum(np.maximum(allowed, last - furthest), last + furthest)
    return np.where(volume_imposed, request, allowed)


def limit_cables(model: Model, state: State, pull_imposed: np.ndarray, request: np.ndarray) -> np.ndarray:
    """Tensions [mN] and pulls [mm] within the cables' own ranges and not too far from the last ones."""
    limits, time_step, cables = model.scene.limits, model.scene.time.step, model.cables
    lowest, highest = np.where(pull_imposed, cables.pull_range.T, cables.tension_range.T)
    allowed = np.clip(request, lowest, highest)
    tension_rate = math.inf if limits.tension_rate is None else limits.tension_rate
    pull_speed = math.inf if limits.pull_speed is None else limits.pull_speed
    # A cable that was driven in the other way goes on from where that has led.
    pulls = cables.pulls(state.cable_length, state.cable_tension, state.cable_tension_loss)
    last = np.where(pull_imposed, pulls, state.cable_tension)
    last = np.where(pull_imposed == state.cable_pull_imposed, state.cable_target, last)
    furthest = np.where(pull_imposed, pull_speed, tension_rate) * time_step
    return np.clip(allowed, last - furthest, last + furthest)


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
    """What of the last request was held back: names of cavities and cables, "base_translation", "base_rotation"."""
    names = [
        name
        for actuators, requests, targets in (
            (model.cavities.names, state.cavity_request, state.cavity_target),
            (model.cables.names, state.cable_request, state.cable_target),
        )
        for name, request, target in zip(actuators, requests.tolist(), targets.tolist(), strict=True)
        if request != target
    ]
    if (state.base_request[0] != state.base_translation).any():
        names.append("base_translation")
    if (state.base_request[1] != state.base_rotation).any():
        names.append("base_rotation")
    return tuple(names)
