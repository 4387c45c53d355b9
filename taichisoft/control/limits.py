"""What a scene's limits leave of a controller's requests, and which of them they clipped."""

import math

import numpy as np

from taichisoft.actuators.kind import Drive
from taichisoft.actuators.kinds import ACTUATOR_KINDS
from taichisoft.model import Model
from taichisoft.state import State


def limit_actuators(model: Model, state: State, imposed: np.ndarray, request: np.ndarray) -> np.ndarray:
    """Targets of all actuators within their own ranges and the scene's, and not too far from the last ones.

    Args:
        model, state: the model, and its state before what is asked for now.
        imposed: whether each actuator is asked for its coordinate, else for its effort, shape (actuator_count,).
        request: efforts [kPa] or [mN] and coordinates [mm^3] or [mm] that are asked for, shape (actuator_count,).
    """
    actuators, targets = model.actuators, []
    ranges = actuators.effort_range, actuators.coordinate_range
    for kind in ACTUATOR_KINDS:
        place = actuators.place(kind)
        if place.start == place.stop:
            continue
        reaches = [_reach(model, drive) for drive in (kind.effort, kind.coordinate)]
        # Python's own numbers: numpy takes longer to look at arrays of so few.
        for number in range(place.start, place.stop):
            if not actuators.takes_effort[number]:
                targets.append(float(request[number]))
                continue
            by_coordinate = bool(imposed[number])
            low, high = ranges[by_coordinate][number].tolist()
            lowest, highest, furthest = reaches[by_coordinate]
            last = state.actuator_target[number]
            if by_coordinate != state.actuator_imposed[number]:  # it goes on from where the other way has led
                last = (actuators.own_coordinates(state) if by_coordinate else state.actuator_effort)[number]
            allowed = min(max(min(max(float(request[number]), low), high), lowest), highest)
            targets.append(min(max(allowed, float(last) - furthest), float(last) + furthest))
    return np.array(targets, dtype=np.float64)


def _reach(model: Model, drive: Drive) -> tuple[float, float, float]:
    """Lowest and highest value in the scene's limits, and its largest change in a step."""
    limits = model.scene.limits
    low, high = getattr(limits, f"lowest_{drive.name}", None), getattr(limits, f"highest_{drive.name}", None)
    rate = getattr(limits, drive.rate) if drive.rate else None
    furthest = math.inf if rate is None else rate * model.scene.time.step
    return -math.inf if low is None else low, math.inf if high is None else high, furthest


def clipped(model: Model, state: State) -> tuple[str, ...]:
    """What of the last request was held back: names of actuators, "base_translation", "base_rotation" and so on."""
    requests, targets = state.actuator_request.tolist(), state.actuator_target.tolist()
    held_back = zip(model.actuators.names, requests, targets, strict=True)
    names = [name for name, request, target in held_back if request != target]
    missed = (state.frame_request != state.frame_pose).any(axis=2).tolist()
    for name, parts in zip(model.frames.names, missed, strict=True):
        names += [
            f"{name}_{part}" for part, is_missed in zip(("translation", "rotation"), parts, strict=True) if is_missed
        ]
    return tuple(names)
