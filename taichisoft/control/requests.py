"""A controller's wishes, checked and taken over into the state as far as the scene's limits allow."""

from collections.abc import Mapping
from numbers import Real
from typing import Any

import numpy as np

from taichisoft.actuators.cavities import CAVITIES, VALVE
from taichisoft.actuators.kind import ActuatorKind, ActuatorSet
from taichisoft.actuators.kinds import ACTUATOR_KINDS
from taichisoft.control.control import Control
from taichisoft.control.frame_motion import FRAME_MAPPINGS, frame_requests, frames_move
from taichisoft.control.limits import limit_actuators
from taichisoft.control.requested_values import as_array, finite, index_of
from taichisoft.errors import ControlError, nearest
from taichisoft.model import Model
from taichisoft.state import State

DRIVES = tuple(drive.asked for kind in ACTUATOR_KINDS for drive in (kind.effort, kind.coordinate))
MAPPINGS = (*DRIVES, VALVE.asked, *FRAME_MAPPINGS, "pull_points", "anchor_positions", "young_modulus", "signals")
"""Keys of a control that ask for actuators, and all that have dictionaries by name."""


def apply_control(model: Model, state: State, control: Control) -> State:
    """The state with what `control` asks for; what it does not mention stays as it was asked for last.

    Raises:
        ControlError: no `Control`, a request that an actuator cannot follow, an unknown cavity, cable, soft body or
            material, something driven in two ways, a value that is not a finite number, or a Young's modulus that is
            not positive.
    """
    if not isinstance(control, Control):
        raise ControlError(f"control = {control!r}: must be a taichisoft.Control")
    for key in MAPPINGS:
        given = getattr(control, key)
        if type(given) is not dict and not isinstance(given, Mapping):  # which takes several times as long to find out
            raise ControlError(f"control.{key}: must be a dictionary by name, not {type(given).__name__}")
    for name, value in control.signals.items():
        if not isinstance(value, Real) or isinstance(value, bool):
            raise ControlError(f"control.signals['{name}'] = {value!r}: must be a number")
    changes = _actuator_requests(model, state, control)
    if control.valve or model.cavities.valves.lines:
        changes |= _valves(model, state, control, changes["actuator_target"])
    if control.pull_points:
        changes["pull_point"] = _pull_point(model, state, control)
    if frames_move(model, state, control):
        changes |= frame_requests(model, state, control)
    if control.anchor_positions:
        changes["anchor_position"] = _anchor_position(model, state, control)
    if control.gravity is not None:
        changes["gravity"] = finite(control.gravity, "control.gravity", (3,))
    if control.young_modulus:
        changes["young_modulus"] = _young_modulus(model, state, control)
    return state.changed(**changes)


def _actuator_requests(model: Model, state: State, control: Control) -> dict[str, Any]:
    """What the actuators are asked for, and how much of it the limits allow."""
    imposed, request = state.actuator_imposed, state.actuator_request
    if any(getattr(control, key) for key in DRIVES):
        imposed, request = imposed.copy(), request.copy()
        for kind in ACTUATOR_KINDS:
            place = model.actuators.place(kind)
            _drive(kind, model.actuators.sets[kind.name], control, imposed[place], request[place])
    target = limit_actuators(model, state, imposed, request)
    return {"actuator_imposed": imposed, "actuator_request": request, "actuator_target": target}


def _drive(
    kind: ActuatorKind, actuators: ActuatorSet, control: Control, imposed: np.ndarray, request: np.ndarray
) -> None:
    """Fill in whether each actuator of a kind is driven by its coordinate, else by its effort, and the value."""
    efforts, coordinates = (getattr(control, drive.asked) for drive in (kind.effort, kind.coordinate))
    both = sorted(efforts.keys() & coordinates.keys())
    if both:
        words = f"{kind.effort.words} and a {kind.coordinate.words}"
        raise ControlError(f"control: {kind.name} '{both[0]}' is given a {words}; give one of them")
    for drive, wishes in ((kind.effort, efforts), (kind.coordinate, coordinates)):
        for name, value in wishes.items():
            index = index_of(name, actuators.names, kind.name, drive.asked)
            why_not = actuators.why_not(drive, index)
            if why_not:
                raise ControlError(f"control.{drive.asked}['{name}']: cannot be asked for, {why_not}")
            imposed[index] = drive is kind.coordinate
            request[index] = finite(value, f"control.{drive.asked}['{name}']", ())


def _valves(model: Model, state: State, control: Control, target: np.ndarray) -> dict[str, np.ndarray]:
    """How valves and regulators of air lines are in the step, by what they and (actuator_count,) are asked for."""
    request, cavities = state.valve_request.copy(), model.cavities
    for name, value in control.valve.items():
        index = index_of(name, cavities.names, CAVITIES.name, VALVE.asked)
        key = f"control.{VALVE.asked}['{name}']"
        why_not = cavities.why_not(VALVE, index)
        if why_not:
            raise ControlError(f"{key}: cannot be asked for, {why_not}")
        request[index] = opening = finite(value, key, ())
        if not -1.0 <= opening <= 1.0:
            raise ControlError(f"{key} = {value!r}: must be from -1 (open to the exhaust) to 1 (open to the source)")
    return cavities.valves.moved(state, model.actuators.of(CAVITIES, target), request)


def _pull_point(model: Model, state: State, control: Control) -> np.ndarray:
    """Places of all cables' pull points [mm], (cable_count, 3), with those that are asked for."""
    pull_point, cables = state.pull_point.copy(), model.cables
    for name, place in control.pull_points.items():
        cable = index_of(name, cables.names, "cable", "pull_points")
        if not cables.has_pull_point[cable]:
            raise ControlError(f"control.pull_points['{name}']: this cable has none; give it one in the scene")
        pull_point[cable] = finite(place, f"control.pull_points['{name}']", (3,))
    return pull_point


def _anchor_position(model: Model, state: State, control: Control) -> np.ndarray:
    """Positions of all anchors [mm], (anchor_count, 3), with those that are asked for."""
    position = state.anchor_position.copy()
    rows = {
        body.name: slice(*np.searchsorted(model.anchored_nodes, [body.nodes.start, body.nodes.stop]).tolist())
        for body in model.soft_bodies
        if body.anchored.any()
    }
    for name, value in control.anchor_positions.items():
        if name not in rows:
            known = nearest(str(name), list(rows), "there are")
            raise ControlError(f"control.anchor_positions: no soft body with anchors is called {str(name)!r}; {known}")
        key = f"control.anchor_positions['{name}']"
        asked, needed = as_array(value, key), position[rows[name]].shape
        if asked.shape != needed:
            raise ControlError(f"{key} has shape {asked.shape}: must have {needed}, a row for each anchored node")
        if not np.isfinite(asked).all():
            raise ControlError(f"{key} has a number that is not finite: all must be")
        position[rows[name]] = asked
    return position


def _young_modulus(model: Model, state: State, control: Control) -> np.ndarray:
    """Young's moduli of all materials [kPa], (material_count,), with those that are asked for."""
    moduli = state.young_modulus.copy()
    for name, value in control.young_modulus.items():
        material = index_of(name, model.material_names, "material", "young_modulus")
        key = f"control.young_modulus['{name}']"
        modulus = finite(value, key, ())
        if modulus <= 0.0:
            raise ControlError(f"{key} = {value!r}: must be above 0")
        moduli[material] = modulus
    return moduli
