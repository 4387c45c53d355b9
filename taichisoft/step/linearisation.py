"""Derivatives of a step or of an equilibrium: how observations change with requests."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from taichisoft.contact.model import Model
from taichisoft.control.control import NOTHING, Control, Force
from taichisoft.control.observation import Observation, find_figure
from taichisoft.control.observer import Fingertips
from taichisoft.control.requests import DRIVES, Requests
from taichisoft.errors import ControlError, nearest
from taichisoft.mechanics.cavities import CAVITIES, VALVE, network_drives
from taichisoft.mechanics.model_actuators import ACTUATOR_KINDS
from taichisoft.mechanics.state import State
from taichisoft.step.solution import StepSolution
from taichisoft.step.step_derivative import Edge, StepDerivative
from taichisoft.step.time_stepper import TimeStepper

AXES = ("x", "y", "z")
BASE = {"base_translation": ("mm", "base_velocity"), "base_rotation": ("rad", "base_angular_velocity")}
"""Unit of a pose, and the key of `Control` that may ask for it in its place."""
FORCE = {"force": "mN", "torque": "mN mm"}
"""Parts of a `Force` that are inputs, in the order of a state's, and their units."""
HALF_WIDTHS = {"kPa": 1e-3, "mN": 0.1, "mN mm": 1.0, "mm^3": 0.1, "mm": 1e-3, "rad": 1e-5, "1": 1e-5}
"""Half widths of the differences of what acts by requests, which is nearly linear."""
MOVE = 1e-3
"""Largest move of a node between observations whose difference is taken [mm]."""
LOADS = ("actuator_target", "valve_opening", "supply_pressure", "network_drive", "frame_pose", "external_force")
"""What of a state a control changes at once."""
BOTH_SIDES = {-1.0: 1.0 / 6.0, -0.5: -4.0 / 3.0, 0.5: 4.0 / 3.0, 1.0: -1.0 / 6.0}
ONE_SIDE = {0.0: -3.0, 0.5: 4.0, 1.0: -1.0}
"""Places along a control and weights of what is observed there, by which a derivative is exact up to the third and the
second power of the way."""
Weighted = tuple[tuple[float, Observation], ...]


@dataclass(frozen=True)
class Linearisation:
    """Derivatives of observations after a step, or in an equilibrium, by requests.

    `linearisation["tip_positions.finger1"]` has a column for each control, shape (3, control_count); names of figures
    are those of `rollouts`. Its unit is the figure's, as `Observation` says, over the control's.

    Attributes:
        controls: names of the controls: "pressure.finger1.cavity", "cable_pull.finger1.tendon", "valve.finger1.cavity",
            "base_translation.x", "base_rotation.z", "forces.cube.force.x" and "forces.cube.torque.z" for a `Force` that
            acts, and "force.finger1.y" for another one on a fingertip, spread evenly over its nodes, or on the centre
            of mass of a rigid body.
        units: of the controls: kPa, mm, rad, mN and so on, in the same order.
        observation: what is observed after the step, or in the equilibrium; exact, without the scene's sensors.
        ranges: changes of each control, below and above 0, within which contacts stay open, sticking or sliding as far
            as the derivatives tell, in the control's unit; infinite where none changes; shape (control_count, 2).
            Contacts that took no part, since they were farther apart, are not in it.
        edges: contacts at such a change, nearer than the solvers' tolerances tell: derivatives are those of one side.
    """

    controls: tuple[str, ...]
    units: tuple[str, ...]
    observation: Observation
    ranges: np.ndarray
    edges: tuple[Edge, ...]
    _body_names: tuple[str, ...]
    _seen: tuple[Weighted, ...]

    def __getitem__(self, figure: str) -> np.ndarray:
        """Derivative of a figure by the controls, shape (..., control_count).

        Raises:
            TaichisoftError: there is no such figure, or it has no fixed shape.
        """
        found = find_figure(figure, self.observation, self._body_names)
        columns = [sum(weight * found.of(seen) for weight, seen in one) for one in self._seen]
        shape = found.of(self.observation).shape
        return np.stack(columns, axis=-1) if columns else np.zeros((*shape, 0))


@dataclass(frozen=True)
class Input:
    """A number that acts in a step.

    Attributes:
        name, unit: as in `Linearisation`.
        value: the request; None for a force, which no control has.
        node_impulse: impulse of a unit force on the nodes [s], shape (node_count, 3).
        rigid_velocity: change of the rigid bodies' velocities by a unit force, shape (rigid_count, 6).
    """

    name: str
    unit: str
    value: float | None = None
    node_impulse: np.ndarray | None = None
    rigid_velocity: np.ndarray | None = None


def linearise(
    stepper: TimeStepper, control: Control | None = None, controls: Sequence[str] | None = None
) -> Linearisation:
    """Linearise the step that `step(control)` would make; see `Simulation.linearise`."""
    control = Control() if control is None else control
    if isinstance(controls, str):
        raise ControlError(f"controls = {controls!r}: must be a sequence of names")
    derivative = stepper.derivative(control)
    control = replace(control, forces=acting_forces(stepper.model, derivative.start))
    known = {one.name: one for one in _find_inputs(stepper.model, derivative)}
    for name in controls or ():
        if name not in known:
            raise ControlError(
                f"controls: '{name}' cannot be varied here; {nearest(str(name), list(known), 'there are')}"
            )
    chosen = list(known.values()) if controls is None else [known[name] for name in controls]
    ends = _NearEnds(stepper, derivative, control)
    seen = tuple(ends.along(one) for one in chosen)
    names, units = tuple(one.name for one in chosen), tuple(one.unit for one in chosen)
    ranges = np.array(ends.ranges).reshape(-1, 2)
    return Linearisation(names, units, ends.here, ranges, tuple(derivative.edges()), stepper.model.body_names, seen)


class _NearEnds:
    """Ends of a step with a little more and a little less of a control."""

    def __init__(self, stepper: TimeStepper, derivative: StepDerivative, control: Control):
        self._stepper, self._derivative, self._control = stepper, derivative, control
        causes = derivative.causes(derivative.start)
        self._nothing = causes.difference(causes, 0.0)
        self._unmoved = derivative.along(self._nothing)
        self.here = self._observe(derivative.start, self._unmoved, 0.0)
        self.ranges: list[tuple[float, float]] = []

    def along(self, one: Input) -> Weighted:
        """What is observed with more and with less of a number, with the weights whose sum is the derivative."""
        derivative, low, high = self._derivative, -1.0, 1.0
        if one.value is None:
            force: dict[str, Any] = {"node_impulse": one.node_impulse, "rigid_velocity": one.rigid_velocity}
            change = derivative.along(replace(self._nothing, **force))
        else:
            width = HALF_WIDTHS[one.unit]
            down, up = (self._start(one, sign * width) for sign in (low, high))
            # At the end of a range only one side is free to move.
            low, high = (sign * self._is_moved(side) for sign, side in ((low, down), (high, up)))
            if low == high:  # limits hold it
                self.ranges.append((-np.inf, np.inf))
                return ((0.0, self.here),)
            causes = derivative.causes(up), derivative.causes(down)
            change = derivative.along(causes[0].difference(causes[1], 1.0 / (width * (high - low))))
        self.ranges.append(derivative.range_along(change))
        velocities = change.node_velocity, change.rigid_velocity[:, :3]
        speed = max(float(np.abs(velocity).max(initial=0.0)) for velocity in velocities)
        # What a control moves is seen where it moves a node by so much, what it does not move where it acts alone.
        half = MOVE / (self._stepper.model.scene.time.step * speed) if speed > 0.0 else HALF_WIDTHS[one.unit]
        if (
            one.name.startswith(VALVE.request) and one.value
        ):  # flows change their law where a valve is shut, or wholly open
            ends = sorted((0.0, math.copysign(VALVE.furthest, one.value)))
            half = min([half, *([one.value - ends[0]] if low else []), *([ends[1] - one.value] if high else [])])
        stencil = BOTH_SIDES
        if low == 0.0 or high == 0.0:
            stencil, half = ONE_SIDE, half * (low + high)
        return tuple(
            (weight / half, self._observe(self._start(one, share * half), change, share * half))
            for share, weight in stencil.items()
        )

    def _start(self, one: Input, amount: float) -> State:
        start, stepper = self._derivative.start, self._stepper
        if one.value is None or amount == 0.0:
            return start
        value = one.value + amount
        if one.name.startswith(VALVE.request):  # which no limit holds back
            value = min(max(value, VALVE.nearest), VALVE.furthest)
        return stepper.requests.apply(stepper.state, asking(start, {one.name: value}, self._control))

    def _is_moved(self, side: State) -> bool:
        start = self._derivative.start
        return any((getattr(side, name) != getattr(start, name)).any() for name in LOADS)

    def _observe(self, start: State, change: StepSolution, share: float) -> Observation:
        end = self._stepper.end_along(self._derivative, start, change, share)
        return self._stepper.observe_state(end)


def _find_inputs(model: Model, derivative: StepDerivative) -> Iterator[Input]:
    start = derivative.start
    for kind in ACTUATOR_KINDS:
        actuators, place = model.actuators.sets[kind.name], model.actuators.place(kind)
        for index, name in enumerate(actuators.names):
            driven = kind.coordinate if start.actuator_imposed[place][index] else kind.effort
            values = {driven: float(start.actuator_request[place][index])}
            if kind is CAVITIES:
                values[VALVE] = float(start.valve_request[index])
            for drive, value in values.items():
                if not actuators.why_not(drive, index):
                    yield Input(f"{drive.request}.{name}", drive.unit, value)
    for number, (name, drive) in enumerate(network_drives(model.scene.air).items()):
        yield Input(f"{drive.request}.{name}", drive.unit, float(start.network_request[number]))
    if all(body.modes is None for body in model.soft_bodies):
        for row, (key, (unit, _)) in enumerate(BASE.items()):
            for axis, letter in enumerate(AXES):
                yield Input(f"{key}.{letter}", unit, float(start.frame_request[0, row, axis]))
    external = model.external_forces
    for name in acting_forces(model, start):
        number = external.names.index(name)
        for row, (part, unit) in enumerate(FORCE.items()):
            if row == 0 or not external.is_soft(number):
                for axis, letter in enumerate(AXES):
                    value = float(start.external_force[number, row, axis])
                    yield Input(f"forces.{name}.{part}.{letter}", unit, value)
    yield from forces(model, derivative)


def acting_forces(model: Model, state: State) -> dict[str, Force]:
    """The forces from outside in a step from a state, as a control asks for them."""
    acting = {}
    for number in np.flatnonzero(state.external_force_steps).tolist():
        force, torque, point = state.external_force[number]
        axes: Literal["own", "world"] = "own" if state.external_force_own_axes[number] else "world"
        acting[model.external_forces.names[number]] = Force(force, torque, point, axes)
    return acting


def asking(state: State, values: Mapping[str, float], control: Control = NOTHING) -> Control:
    """A control that requests values of inputs, beside the requests of another control.

    Args:
        state: has the requested pose of the base, of which an input is one coordinate.
        values: by the names of `Linearisation`.
        control: the other one.

    Raises:
        ControlError: no control has such a name.
    """
    for name, value in values.items():
        key, _, of = name.partition(".")
        if key in BASE:
            pose = getattr(control, key)
            pose = np.array(state.frame_request[0, list(BASE).index(key)] if pose is None else pose, dtype=np.float64)
            pose[_axis(name, of)] = value
            changes: dict[str, Any] = {key: pose, BASE[key][1]: None}
        elif key == "forces" and of.count(".") > 1:
            who, part, letter = of.rsplit(".", 2)
            force = control.forces.get(who) or Force()
            if part not in FORCE:
                raise ControlError(f"'{name}' is not the name of a control: must have {' or '.join(FORCE)} before .x")
            row = np.array(getattr(force, part), dtype=np.float64)
            row[_axis(name, letter)] = value
            pushed = replace(force, force=row) if part == "force" else replace(force, torque=row)
            changes = {"forces": {**control.forces, who: pushed}}
        elif key in [drive.request for drive in (*DRIVES, VALVE)] and of:
            changes = {key: {**getattr(control, key), of: value}}
        else:
            example = "pressure.finger1.cavity or base_translation.x"
            raise ControlError(f"'{name}' is not the name of a control, such as {example}")
        control = replace(control, **changes)
    return control


def asked_for(requests: Requests, state: State, name: str) -> float:
    """The present request of an input, 0 of an actuator that is driven otherwise."""
    key, _, of = name.partition(".")
    if key in BASE:
        return float(state.frame_request[0, list(BASE).index(key), _axis(name, of)])
    if place := requests.places.get(key, {}).get(of):
        field, number = place
        is_imposed = key in [kind.coordinate.request for kind in ACTUATOR_KINDS]
        if field == "actuator_request" and state.actuator_imposed[number] != is_imposed:
            return 0.0
        return float(getattr(state, field)[number])
    if key == "forces" and of.count(".") > 1:
        who, part, letter = of.rsplit(".", 2)
        names = requests.model.external_forces.names
        if who in names and part in FORCE and state.external_force_steps[names.index(who)]:
            return float(state.external_force[names.index(who), list(FORCE).index(part), _axis(name, letter)])
    return 0.0


def _axis(name: str, letter: str) -> int:
    if letter not in AXES:
        raise ControlError(f"'{name}' is not the name of a control: must end with .x, .y or .z")
    return AXES.index(letter)


def forces(model: Model, derivative: StepDerivative) -> Iterator[Input]:
    """Forces on fingertips and on the centres of mass of rigid bodies."""
    step, none = model.scene.time.step, np.zeros((len(model.rigid_bodies), 6))
    tips = Fingertips(model.soft_bodies, model.frames)
    for name, nodes in zip(tips.names, tips.nodes, strict=True):
        for axis, letter in enumerate(AXES):
            impulse = np.zeros((model.node_count, 3))
            impulse[nodes, axis] = step / len(nodes)
            yield Input(f"force.{name}.{letter}", "mN", None, impulse, none)
    for number, body in enumerate(model.rigid_bodies):
        for axis, letter in enumerate(AXES):
            velocity = none.copy()
            velocity[number] = step * derivative.inverse_mass[number][:, axis]
            yield Input(f"force.{body.name}.{letter}", "mN", None, np.zeros((model.node_count, 3)), velocity)
