"""What a scene's limits leave of a controller's requests, and which of them they clipped."""

import math

import numpy as np

from taichisoft.bodies.rotations import turn_towards
from taichisoft.model import Model
from taichisoft.scenes.scene import Limits
from taichisoft.state import State


def limit_cavities(model: Model, state: State, volume_imposed: np.ndarray, request: np.ndarray) -> np.ndarray:
    """Pressures [kPa] and growths [mm^3] within the cavities' own ranges, pressures not too far from the last ones."""
    limits, cavities = model.scene.limits, model.cavities
    lowest = -math.inf if limits.lowest_pressure is None else limits.lowest_pressure
    highest = math.inf if limits.highest_pressure is None else limits.highest_pressure
    furthest = math.inf if limits.pressure_rate is None else limits.pressure_rate * model.scene.time.step
    target = []
    # Python's own numbers: numpy takes longer to look at arrays of so few.
    for cavity, (value, by_volume) in enumerate(zip(request.tolist(), volume_imposed.tolist(), strict=True)):
        low, high = (cavities.growth_range if by_volume else cavities.pressure_range)[cavity].tolist()
        allowed = min(max(value, low), high)
        if not by_volume:
            # A cavity that was driven by its volume goes on from the pressure which that took.
            of_last = state.cavity_pressure if state.cavity_volume_imposed[cavity] else state.cavity_target
            last = float(of_last[cavity])
            allowed = min(max(allowed, lowest), highest)
            allowed = min(max(allowed, last - furthest), last + furthest)
        target.append(allowed)
    return np.array(target)


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
