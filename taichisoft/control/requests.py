"""Validate a Control and apply it to the state within the scene's limits."""

import math
from collections.abc import Mapping, Sequence
from numbers import Integral, Real
from operator import attrgetter
from types import MappingProxyType
from typing import Any

import numpy as np

from taichisoft.base.rotations import compose_rotation_vectors, turn_towards
from taichisoft.contact.model import Model
from taichisoft.control.control import Control, Force
from taichisoft.errors import ControlError, nearest
from taichisoft.mechanics.actuator_kind import ActuatorKind, Drive
from taichisoft.mechanics.cavities import CAVITIES, VALVE
from taichisoft.mechanics.external_forces import UNTIL_ANOTHER, ExternalForces
from taichisoft.mechanics.model_actuators import ACTUATOR_KINDS
from taichisoft.mechanics.state import State
from taichisoft.scene.rigid_body import BASE, FramePath, FrameSettings, HingeSettings

# What of a controller's requests a scene's limits hold back.


def clipped(model: Model, state: State) -> tuple[str, ...]:
    """What of the last request was held back: names of actuators, "base_translation", "base_rotation" and so on."""
    requests, targets = state.actuator_request.tolist(), state.actuator_target.tolist()
    held_back = zip(model.actuators.names, requests, targets, strict=True)
    names = [name for name, request, target in held_back if request != target]
    in_network = zip(model.cavities.network.drives, state.network_request, state.network_target, strict=True)
    names += [name for name, request, target in in_network if request != target]
    missed = (state.frame_request != state.frame_pose).any(axis=2).tolist()
    for name, parts in zip(model.frames.names, missed, strict=True):
        names += [
            f"{name}_{part}" for part, is_missed in zip(("translation", "rotation"), parts, strict=True) if is_missed
        ]
    return tuple(names)


# Values in a control, checked: names that exist, numbers that are finite.


def index_of(name: str, names: tuple[str, ...], kind: str, key: str) -> int:
    """Number of what is named in a control's dictionary `key`; `kind` is a word for it."""
    if name not in names:
        raise ControlError(
            f"control.{key}: no {kind} is called {str(name)!r}; {nearest(str(name), list(names), 'there are')}"
        )
    return names.index(name)


def finite(value: object, key: str, shape: tuple[int, ...]) -> np.ndarray | float:
    """A copy as finite floating-point numbers of a shape, () or (count,)."""
    if not shape and type(value) is float and math.isfinite(value):
        return value
    array = as_array(value, key)
    if array.shape != shape or not np.isfinite(array).all():
        wanted = f"{shape[0]} finite numbers" if shape else "one finite number"
        given = f", not an array of shape {array.shape}" if array.shape != shape and array.ndim else ""
        raise ControlError(f"{key} = {_shown(value)}: must be {wanted}{given}")
    return array


def as_array(value: object, key: str) -> np.ndarray:
    """A copy as floating-point numbers; text and truth values are none, though numpy would take them for some."""
    try:
        given = np.asarray(value)
        if given.dtype.kind in "iuf":
            return np.array(given, dtype=np.float64)
    except (TypeError, ValueError):  # rows of unequal lengths
        pass
    raise ControlError(f"{key} = {_shown(value)}: must be a number or an array of numbers")


def _shown(value: object) -> str:
    return " ".join(line.strip() for line in repr(value).splitlines())


# The motion of frames: what a controller or the scene asks of them, what limits leave of it, and what is seen.

PARTS = (("translation", "velocity"), ("rotation", "angular_velocity"))
"""The rows of a pose, each with its rate: keys of a control behind "base_" and "frame_"."""
BASE_KEYS = tuple(f"{BASE}_{kind}" for part in PARTS for kind in part)
FRAME_MAPPINGS = (*(f"frame_{kind}" for part in PARTS for kind in part), "frame_angle")
"""Keys of a control that ask for the motion of the base, and of other frames by name."""


def frame_requests(
    model: Model, tables: Mapping[str, FrameSettings], state: State, control: Control
) -> tuple[np.ndarray, np.ndarray]:
    """Poses and velocities that the frames of these tables are asked for, with what they were asked for last."""
    request, velocity = state.frame_request.copy(), state.frame_velocity.copy()
    for row, (pose, rate) in enumerate(PARTS):
        poses, rates = (_requests(model, tables, control, kind) for kind in (pose, rate))
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
    return request, velocity


def frames_moved(
    tables: Mapping[str, FrameSettings], time_step: float, state: State, request: np.ndarray, velocity: np.ndarray
) -> dict[str, np.ndarray]:
    """How far the frames get in a step [s] by the poses and velocities that they are asked for."""
    request, reached = request.copy(), state.frame_pose.copy()
    for number, table in enumerate(tables.values()):
        if table.path is not None:
            request[number] = reached[number] = _on_path(table.path, (state.step + 1) * time_step)
            continue
        if velocity[number, 0].any():
            request[number, 0] = state.frame_pose[number, 0] + time_step * velocity[number, 0]
        if velocity[number, 1].any():
            request[number, 1] = compose_rotation_vectors(time_step * velocity[number, 1], state.frame_pose[number, 1])
        if (request[number] != reached[number]).any():
            reached[number] = _limited(table, time_step, reached[number], request[number])
    return {"frame_request": request, "frame_velocity": velocity, "frame_pose": reached}


def _requests(
    model: Model, tables: Mapping[str, FrameSettings], control: Control, kind: str
) -> dict[int, tuple[str, np.ndarray]]:
    """Requests of a kind, such as "translation", by number of the frame: key for messages, and value."""
    requests, of_base = {}, getattr(control, f"{BASE}_{kind}")
    if of_base is not None:
        requests[0] = (f"{BASE}_{kind}", of_base)
    for name, value in getattr(control, f"frame_{kind}").items():
        key = f"frame_{kind}['{name}']"
        number = index_of(name, model.frames.names, "frame", f"frame_{kind}")
        if number in requests:
            raise ControlError(f"control: {requests[number][0]} and {key} are both given; give one of them")
        if tables[name].path is not None:
            raise ControlError(f"control.{key}: this frame moves on its path; remove the path from the scene")
        if tables[name].hinge is not None:
            raise ControlError(f"control.{key}: this frame turns about its hinge; ask for frame_angle")
        requests[number] = (key, value)
    return requests


def _on_path(path: FramePath, time: float) -> np.ndarray:
    """Pose on a path [mm] and [rad], shape (2, 3)."""
    rows = [
        np.zeros(3) if values is None else [np.interp(time, path.times, axis) for axis in np.transpose(values)]
        for values in (path.translations, path.rotations)
    ]
    return np.array(rows) * [[1.0], [math.radians(1.0)]]


def _limited(table: FrameSettings, time_step: float, pose: np.ndarray, request: np.ndarray) -> np.ndarray:
    """Pose after a step [s] on the straight path to the requested one; all of shape (2, 3)."""
    translation, rotation = request
    if table.speed is not None:
        displacement = translation - pose[0]
        length, furthest = math.sqrt(displacement @ displacement), table.speed * time_step
        if length > furthest:
            translation = pose[0] + furthest / length * displacement
    furthest = math.inf if table.turning_speed is None else math.radians(table.turning_speed) * time_step
    if table.hinge is not None:
        rotation = _limited_turn(table.hinge, furthest, pose[1], rotation)
    elif furthest < math.inf:
        rotation = turn_towards(pose[1], rotation, furthest)
    return np.array([translation, rotation])


def _limited_turn(hinge: HingeSettings, furthest: float, last: np.ndarray, request: np.ndarray) -> np.ndarray:
    """Rotation vector of a hinge [rad], shape (3,): it goes the way of its angle, not the shortest one to a pose."""
    axis = hinge.unit_axis
    wanted, before = float(request @ axis), float(last @ axis)
    low = -math.inf if hinge.lowest_angle is None else math.radians(hinge.lowest_angle)
    high = math.inf if hinge.highest_angle is None else math.radians(hinge.highest_angle)
    angle = min(max(min(max(wanted, low), high), before - furthest), before + furthest)
    return request if angle == wanted else angle * axis


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


# A controller's wishes, checked and taken over into the state as far as the scene's limits allow.

DRIVES = tuple(drive for kind in ACTUATOR_KINDS for drive in (kind.effort, kind.coordinate))
WAYS = (*((kind, drive) for kind in ACTUATOR_KINDS for drive in (kind.effort, kind.coordinate)), (CAVITIES, VALVE))
"""All that actuators are driven by, of each kind."""
ASKED = ("actuator_imposed", "actuator_request", "valve_request", "network_request")
"""Fields of a state with what is asked for of actuators, valves of their lines, and the scene's table `air`."""
MAPPINGS = (
    *(drive.request for _, drive in WAYS),
    *FRAME_MAPPINGS,
    "pull_points",
    "anchor_positions",
    "forces",
    "young_modulus",
    "signals",
)
"""Keys of a control that ask for actuators, and all that have dictionaries by name."""
OF_FRAMES = slice(len(WAYS), len(WAYS) + len(FRAME_MAPPINGS))
_mappings_of, _base_motion_of = attrgetter(*MAPPINGS), attrgetter(*BASE_KEYS)


class Requests:
    """Takes what controllers ask for over into the states of a model, as far as the scene's limits allow.

    Attributes:
        model: the model.
        places: by key of a control, and name of what can be driven so: which of `ASKED` has its request, and where.
    """

    def __init__(self, model: Model):
        """Read the limits of a model's scene."""
        self.model, actuators = model, model.actuators
        own = actuators.effort_range, actuators.coordinate_range
        # Lowest and highest target, and its largest change in a step, of efforts and of coordinates.
        self._limits = np.empty((2, 3, len(actuators.names)))
        self._limits[:] = np.array([-math.inf, math.inf, math.inf])[:, None]
        for kind in ACTUATOR_KINDS:
            place = actuators.place(kind)
            number = np.arange(place.start, place.stop)[actuators.takes_effort[place]]
            for limits, ends, drive in zip(self._limits, own, (kind.effort, kind.coordinate), strict=True):
                lowest, highest, furthest = _reach(model, drive)
                limits[:2, number], limits[2, number] = np.clip(ends[number].T, lowest, highest), furthest
        network, reach = model.cavities.network, np.array(_reach(model, CAVITIES.effort))
        self._network_limits = np.array([*network.drive_range.T, np.full(len(network.drives), math.inf)])
        of_regulators = self._network_limits[:, len(network.valves) :]
        of_regulators[:2] = np.clip(of_regulators[:2], *reach[:2])
        of_regulators[2] = reach[2]
        self.places = {drive.request: self._places(kind, drive) for kind, drive in WAYS}
        self._frames = model.scene.all_frames
        self._follows_path = any(frame.path is not None for frame in self._frames.values())

    def _places(self, kind: ActuatorKind, drive: Drive) -> dict[str, tuple[str, int]]:
        actuators, first = self.model.actuators.sets[kind.name], self.model.actuators.place(kind).start
        field, first = ("valve_request", 0) if drive is VALVE else ("actuator_request", first)
        own = enumerate(actuators.names)
        known = {name: (field, first + number) for number, name in own if not actuators.why_not(drive, number)}
        drives = self.model.cavities.network.drives
        return known | {name: ("network_request", drives.index(name)) for name in actuators.elsewhere(drive)}

    def apply(self, state: State, control: Control) -> State:
        """The state with what `control` asks for; what it does not mention stays as it was asked for last."""
        if not isinstance(control, Control):
            raise ControlError(f"control = {control!r}: must be a taichisoft.Control")
        model, given = self.model, _mappings_of(control)
        _refuse_other_types(model, given, control)
        asked = self._asked(state, given[: len(WAYS)]) if any(given[: len(WAYS)]) else state
        target = self._targets(state, asked.actuator_imposed, asked.actuator_request)
        changes: dict[str, Any] = {"actuator_target": target}
        if model.cavities.air_lines:
            pressure = model.actuators.of(CAVITIES, target)
            changes |= model.cavities.valves_moved(state, pressure, asked.valve_request)
        if model.cavities.network.drives:
            reached = _within(asked.network_request, state.network_target, *self._network_limits)
            changes |= model.cavities.network.moved(state, asked.network_request, reached)
        if control.pull_points:
            changes["pull_point"] = _pull_point(model, state, control)
        request, velocity = state.frame_request, state.frame_velocity
        if any(given[OF_FRAMES]) or any(motion is not None for motion in _base_motion_of(control)):
            request, velocity = frame_requests(model, self._frames, state, control)
        moves = np.count_nonzero(velocity) or np.count_nonzero(request != state.frame_pose)
        if moves or velocity is not state.frame_velocity or self._follows_path:
            changes |= frames_moved(self._frames, model.scene.time.step, state, request, velocity)
        if control.anchor_positions:
            changes["anchor_position"] = _anchor_position(model, state, control)
        if control.forces or np.count_nonzero(state.external_force_steps):
            changes |= _external_forces(model, state, control)
        if control.gravity is not None:
            changes["gravity"] = finite(control.gravity, "control.gravity", (3,))
        if control.young_modulus:
            changes["young_modulus"] = _young_modulus(model, state, control)
        return asked.changed(**changes)

    def _asked(self, state: State, given: Sequence[Mapping[str, Any]]) -> State:
        """The state with what is asked for in the order of `WAYS`."""
        asked: dict[str, np.ndarray] = {name: getattr(state, name).copy() for name in ASKED}
        for kind, efforts, coordinates in zip(ACTUATOR_KINDS, given[::2], given[1::2], strict=False):
            if efforts and coordinates and (both := sorted(efforts.keys() & coordinates.keys())):
                words = f"{kind.effort.words} and a {kind.coordinate.words}"
                raise ControlError(f"control: {kind.name} '{both[0]}' is given a {words}; give one of them")
        for (kind, drive), known, requests in zip(WAYS, self.places.values(), given, strict=True):
            for name, value in requests.items():
                if name not in known:
                    raise self._refusal(kind, drive, name)
                (field, number), key = known[name], f"control.{drive.request}['{name}']"
                asked[field][number] = finite(value, key, ())
                if field == "actuator_request":
                    asked["actuator_imposed"][number] = drive is kind.coordinate
                if drive is VALVE and not -1.0 <= asked[field][number] <= 1.0:
                    range_ = "must be from -1 (open to the exhaust) to 1 (open to the source)"
                    raise ControlError(f"{key} = {float(value)!r}: {range_}")
        return state.changed(**asked)

    def _refusal(self, kind: ActuatorKind, drive: Drive, name: str) -> ControlError:
        actuators = self.model.actuators.sets[kind.name]
        elsewhere = actuators.elsewhere(drive)
        word = f"{kind.name}{' or part of [air]' * bool(elsewhere)}"
        why_not = actuators.why_not(drive, index_of(name, (*actuators.names, *elsewhere), word, drive.request))
        return ControlError(f"control.{drive.request}['{name}']: cannot be asked for, {why_not}")

    def _targets(self, state: State, imposed: np.ndarray, request: np.ndarray) -> np.ndarray:
        """Targets of all actuators within their own ranges and the scene's, and not too far from the last ones.

        Args:
            state: the state before what is asked for now.
            imposed: whether each actuator is asked for its coordinate, else for its effort, shape (actuator_count,).
            request: efforts [kPa] or [mN] and coordinates [mm^3] or [mm] that are asked for, shape (actuator_count,).
        """
        low, high, furthest = np.where(imposed, self._limits[1], self._limits[0])
        last, is_other = state.actuator_target, imposed != state.actuator_imposed
        if np.count_nonzero(is_other):  # continue from where the other drive has led
            actuators = self.model.actuators
            led = np.where(imposed, actuators.own_coordinates(state), state.actuator_effort)
            last = np.where(is_other, led, last)
        return _within(request, last, low, high, furthest)


def _within(
    request: np.ndarray, last: np.ndarray, low: np.ndarray, high: np.ndarray, furthest: np.ndarray
) -> np.ndarray:
    """Requests within a range, and not too far from the last targets, shape (count,) each."""
    allowed = np.minimum(np.maximum(request, low), high)
    targets: np.ndarray = np.minimum(np.maximum(allowed, last - furthest), last + furthest)
    return targets


def _reach(model: Model, drive: Drive) -> tuple[float, float, float]:
    """Lowest and highest value in the scene's limits, and its largest change in a step."""
    limits = model.scene.limits.model_dump()
    low, high = limits.get(f"lowest_{drive.name}"), limits.get(f"highest_{drive.name}")
    rate = limits[drive.rate] if drive.rate else None
    furthest = math.inf if rate is None else rate * model.scene.time.step
    return -math.inf if low is None else low, math.inf if high is None else high, furthest


def _refuse_other_types(model: Model, given: Sequence[object], control: Control) -> None:
    """Refuse what is no dictionary by name, and signals that are no numbers."""
    if {*map(type, given)} != {dict}:
        for key, mapping in zip(MAPPINGS, given, strict=True):
            if not isinstance(mapping, Mapping):
                needed = f"must be a dictionary by name, not {type(mapping).__name__}"
                raise ControlError(f"control.{key}: {needed}{_example(model, key, mapping)}")
    for name, value in control.signals.items():
        if not isinstance(value, Real) or isinstance(value, bool):
            raise ControlError(f"control.signals['{name}'] = {value!r}: must be a number")


def _example(model: Model, key: str, value: object) -> str:
    """How a value given without a name is written with one; "" where nothing has names."""
    names: dict[str, Sequence[str]] = dict.fromkeys(FRAME_MAPPINGS, model.frames.names[1:])
    for kind in ACTUATOR_KINDS:
        names |= dict.fromkeys((kind.effort.request, kind.coordinate.request), model.actuators.names_of(kind))
    names |= {VALVE.request: model.cavities.names, "pull_points": model.cables.names}
    names |= {"anchor_positions": [body.name for body in model.soft_bodies], "young_modulus": model.material_names}
    names["forces"] = model.external_forces.names
    written = repr(value) if isinstance(value, Real) else "..."
    return f", such as {{'{names[key][0]}': {written}}}" if names.get(key) else ""


def _pull_point(model: Model, state: State, control: Control) -> np.ndarray:
    """Places of all cables' pull points [mm], (cable_count, 3), with those that are asked for."""
    pull_point, cables = state.pull_point.copy(), model.cables
    for name, place in control.pull_points.items():
        cable, key = index_of(name, cables.names, "cable", "pull_points"), f"control.pull_points['{name}']"
        if not cables.has_pull_point[cable]:
            raise ControlError(f"{key}: this cable has none; give it one in the scene")
        pull_point[cable] = finite(place, key, (3,))
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
        request, needed = as_array(value, key), position[rows[name]].shape
        if request.shape != needed:
            raise ControlError(f"{key} has shape {request.shape}: must have {needed}, a row for each anchored node")
        if not np.isfinite(request).all():
            raise ControlError(f"{key} has a number that is not finite: all must be")
        position[rows[name]] = request
    return position


LARGEST = 1e15
"""Largest amount of a force, torque or coordinate of a point [mN, mN mm, mm]: numbers overflow by its powers."""
MOST_STEPS = 2**31 - 1
"""Number of time steps that a state can count."""


def _external_forces(model: Model, state: State, control: Control) -> dict[str, np.ndarray]:
    """The forces of the step: those of the last one that go on, and what is asked for."""
    places, force = model.external_forces, state.external_force.copy()
    own, steps = state.external_force_own_axes.copy(), state.external_force_steps.copy()
    steps[steps > 0] -= 1
    for name, value in control.forces.items():
        key = f"control.forces['{name}']"
        number = index_of(name, places.names, "body or frame", "forces")
        if value is None:
            steps[number] = 0
        else:
            force[number] = checked_force(places, name, value, key)
            own[number], steps[number] = value.axes == "own", _step_count(value.steps, f"{key}.steps")
    return {"external_force": force, "external_force_steps": steps, "external_force_own_axes": own}


def checked_force(places: ExternalForces, name: str, value: object, key: str) -> np.ndarray:
    """Force, torque and point at rest of what is asked for on a body or frame, shape (3, 3); `key` begins errors.

    Raises:
        ControlError: it cannot act there.
    """
    number = places.names.index(name)
    if places.names.count(name) > 1:
        raise ControlError(f"{key}: both a body and a frame are called so; rename one of them in the scene")
    if not isinstance(value, Force):
        raise ControlError(
            f"{key} = {_shown(value)}: must be None or a taichisoft.Force, such as Force([0.0, 0.0, 10.0])"
        )
    if not (isinstance(value.axes, str) and value.axes in ("world", "own")):
        raise ControlError(f"{key}.axes = {_shown(value.axes)}: must be 'world' or 'own'")
    if places.is_soft(number) and value.point is None:
        near = np.round(places.middle[number], 2).tolist()
        raise ControlError(f"{key}.point: a soft body needs one, a place at rest [mm] such as {near}")
    given = {
        "force": value.force,
        "torque": value.torque,
        "point": places.middle[number] if value.point is None else value.point,
    }
    rows = np.array([finite(row, f"{key}.{part}", (3,)) for part, row in given.items()])
    if np.abs(rows).max() > LARGEST:
        raise ControlError(f"{key}: has a number above {LARGEST:g}, which nothing would survive")
    if places.is_soft(number):
        if rows[1].any():
            raise ControlError(f"{key}.torque: a point of a soft body takes none; give two forces, or turn its frame")
        if problem := places.outside(number, rows[2]):
            raise ControlError(f"{key}.point = {rows[2].tolist()}: {problem}")
    return rows


def _step_count(value: object, key: str) -> int:
    if value is None:
        return UNTIL_ANOTHER
    if isinstance(value, Integral) and not isinstance(value, bool) and 1 <= int(value) <= MOST_STEPS:
        return int(value)
    raise ControlError(f"{key} = {_shown(value)}: must be a whole number of time steps from 1 to {MOST_STEPS}, or None")


def _young_modulus(model: Model, state: State, control: Control) -> np.ndarray:
    """Young's moduli of all materials [kPa], (material_count,), with those that are asked for."""
    moduli = state.young_modulus.copy()
    for name, value in control.young_modulus.items():
        material, key = (
            index_of(name, model.material_names, "material", "young_modulus"),
            f"control.young_modulus['{name}']",
        )
        moduli[material] = finite(value, key, ())
        if moduli[material] <= 0.0:
            raise ControlError(f"{key} = {value!r}: must be above 0")
    return moduli
