"""The gradient of a run: how an objective of it changes with controls, start, materials and coefficients."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Any

import numpy as np

from taichisoft.contact.kernels.constraint_problem import PREFERRED
from taichisoft.contact.model import Model
from taichisoft.control.control import Control
from taichisoft.control.observation import Observation, find_figure
from taichisoft.control.observer import Fingertips
from taichisoft.control.requests import DRIVES, as_array
from taichisoft.errors import ControlError, TaichisoftError, nearest
from taichisoft.mechanics.model_actuators import ACTUATOR_KINDS
from taichisoft.mechanics.state import State
from taichisoft.running.figure_slopes import FigureSlopes
from taichisoft.running.simulation import Simulation, check_simulation
from taichisoft.step.linearisation import AXES, BASE, asking, forces
from taichisoft.step.step_adjoint import CoefficientSlopes, RestSlopes, Slopes, StepAdjoint, coefficients
from taichisoft.step.step_derivative import Multipliers, StepDerivative

Objective = Callable[[Observation], tuple[float, Mapping[str, Any]]]
"""Gives its part of the objective after a step, and the derivatives of this part by figures that it reads."""
Controls = Sequence[Control | None] | Mapping[str, Any]
HALF_WIDTHS = (1e-3, 1e-5)
"""Half widths of differences by translations [mm] and rotations [rad] of the base."""
PROBE = 1e-6
"""By how much a target is moved to see whether the next one follows it."""


@dataclass(frozen=True)
class RunGradient:
    """The value of an objective over a run, and its derivatives.

    `found["pressure.finger1.cavity"]` has an entry for each step, 0 where a step asks for nothing; the unit of all is
    the objective's over that of the quantity.

    Attributes:
        value: sum of the objective over all steps.
        names: names of the derivatives.
        observation: what is observed after the last step; exact, without the scene's sensors.
        step_count: number of steps.
        edge_share: share of the steps with a contact nearer to a change between open, sticking and sliding than the
            solvers' tolerances tell; derivatives there are those of one side. By the start also the first step, if
            surfaces just touch there and `contact.depth` is "position".
        inexact_share: share of the contacts whose derivatives leave something out: those of round and curved surfaces,
            where normal and points are taken to move along with the body, of bodies that turn much in a step, and of
            surfaces that meet within a step, where the time of the meeting is taken as it is.
        shifted_share: share of the steps in which overlapping surfaces were shifted apart; the shift is constant.
        unconverged_share: share of the steps in which `time.newton` linearisations left more than
            `time.newton_tolerance`; derivatives are those of converged ones.
    """

    value: float
    names: tuple[str, ...]
    observation: Observation
    step_count: int
    edge_share: float
    inexact_share: float
    shifted_share: float
    unconverged_share: float
    _found: Mapping[str, np.ndarray]

    def __getitem__(self, name: str) -> np.ndarray:
        """The derivative by what a name means, see `taichisoft.gradient`.

        Raises:
            TaichisoftError: it was not asked for.
        """
        if name not in self._found:
            raise TaichisoftError(f"gradient: no '{name}'; {nearest(str(name), list(self.names), 'there are')}")
        return self._found[name]


class LeastSquares:
    """Objective: the sum of squares of the differences from measured curves.

    Attributes:
        curves: values of figures after each step, by their names; NaN where nothing was measured.
        first_step: number of the step before the first value.
    """

    def __init__(self, curves: Mapping[str, Any], first_step: int = 0):
        """Compare with these curves, arrays of shape (step_count, ...).

        Raises:
            TaichisoftError: a curve is not an array of numbers.
        """
        if not isinstance(curves, Mapping):
            raise TaichisoftError(f"curves = {curves!r}: must be arrays of numbers by the names of figures")
        self.curves = {name: np.atleast_1d(as_array(values, f"curves['{name}']")) for name, values in curves.items()}
        self.first_step = first_step

    def __call__(self, observation: Observation) -> tuple[float, Mapping[str, np.ndarray]]:
        """The squares of a step, and their derivatives."""
        row, total, slopes = observation.step - self.first_step - 1, 0.0, {}
        for name, values in self.curves.items():
            if 0 <= row < len(values):
                seen = figure_value(name, observation)
                if seen.shape != values.shape[1:]:
                    raise TaichisoftError(
                        f"curves['{name}']: has rows of shape {values.shape[1:]}, must be {seen.shape}"
                    )
                missed = np.nan_to_num(seen - values[row])
                total += float((missed**2).sum())
                slopes[name] = 2.0 * missed
        return total, slopes


def figure_value(name: str, observation: Observation) -> np.ndarray:
    """The value of a figure by its name, with two bodies in any order."""
    pair = tuple(name.partition(".")[2].split("|"))
    orders = {pair, pair[::-1]} if len(pair) == 2 else {()}
    values: list[np.ndarray] = [find_figure(name, observation, bodies).of(observation) for bodies in orders]
    return sum(values[1:], values[0])  # in one of the orders there is nothing


def gradient(
    simulation: Simulation,
    controls: Controls,
    objective: Objective,
    by: Sequence[str],
    moves: Mapping[str, np.ndarray] | None = None,
    memory: float = 200.0,
) -> RunGradient:
    """The gradient of an objective of the run from the simulation's present state; the simulation stays as it is.

    It is that of the steps themselves: of each, contacts and actuators as they acted, linearised and transposed
    (adjoint). So all parameters together take about as long as two more runs. It is exact where contacts stay open,
    sticking or sliding for small changes; `RunGradient` says how far that was so.

    Args:
        simulation: where the run starts.
        controls: a control, or None, for each step; or values for each step by the names of controls, as
            `Linearisation` has them: {"pressure.finger1.cavity": [0.0, 1.0, 2.0]}.
        objective: is called with the observation after each step, and gives its part of the objective with the
            derivatives of this part by figures, such as `(seen.volumes["finger1.cavity"], {"volumes": [1, 0, 0]})`.
        by: what to derive by. For each step: names of `controls`, "base_translation.x", "force.finger1.y". In all:
            "start.position", "start.velocity", "start.rigid_position", "start.rigid_rotation" (by turns about the
            axes of the world), "start.rigid_velocity" (linear and angular); "young_modulus.MATERIAL",
            "c10.MATERIAL" and other coefficients of laws of rubber that the scene gives, "density.BODY",
            "rayleigh_stiffness.BODY", "rayleigh_mass.BODY", "mass.BODY", and "friction" or "friction.BODY|BODY".
        moves: how dimensions of the bodies move all soft nodes at rest [mm per unit], shape (node_count, 3), by name;
            `by` has "rest.NAME" then, of a run from the simulation's first state, which moves along.
        memory: states are kept up to so much [MB]; beyond, they are made again from every few steps.

    Raises:
        TaichisoftError: a name, a value or the objective is not valid, or the scene has something of which steps have
            no derivative by their start.
        SimulationDiverged: a step failed.
    """
    check_simulation(simulation)
    run = _Run(simulation, controls, objective, by, moves or {}, memory)
    before = simulation.state, simulation.report
    try:
        return run.back()
    finally:
        simulation.state, simulation.report = before


class _Run:
    """A run forwards, with states that are kept, and back."""

    def __init__(
        self,
        simulation: Simulation,
        controls: Controls,
        objective: Objective,
        by: Sequence[str],
        moves: Mapping[str, np.ndarray],
        memory: float,
    ):
        self._simulation, self._model, self._objective = simulation, simulation.model, objective
        if not callable(objective):
            raise TaichisoftError(f"objective = {objective!r}: must be a function of an observation")
        if isinstance(memory, bool) or not isinstance(memory, int | float) or not memory > 0.0:
            raise TaichisoftError(f"memory = {memory!r}: must be a number of megabytes above 0")
        self._controls, self._count = _checked_controls(controls)
        self._adjoint = StepAdjoint(self._model)
        self._by = _checked_names(by, self._model, moves, self._adjoint)
        self._figures = FigureSlopes(self._model)
        self._of_steps = {name: np.zeros(self._count) for name in self._by if _is_of_steps(name)}
        self._moves = _checked_moves(self._by, moves, simulation)
        coefficient_names = coefficients(self._model)
        self._sides: dict[str, RestSlopes | CoefficientSlopes] = {
            **{f"rest.{name}": RestSlopes(self._model, move) for name, move in self._moves.items()},
            **{name: CoefficientSlopes(self._model, name) for name in self._by if name in coefficient_names},
        }
        self._by_sides = dict.fromkeys(self._sides, 0.0)
        self._interval = _interval(self._count, simulation.state, 1e6 * memory)

    def back(self) -> RunGradient:
        """Run forwards, and then take the derivatives back from the end to the start."""
        states, parts, value = self._forwards()
        end, observation = self._simulation.state, self._simulation.observe_state(self._simulation.state)
        slopes, carried = Slopes.none(self._model), _Carried(self._model)
        edges = shifted = unconverged = 0
        tolerance = self._model.scene.time.newton_tolerance
        for step in reversed(range(self._count)):
            if step not in states:
                self._again(states, step - step % self._interval, step)
            self._simulation.state = states.pop(step)
            control = self._control(step)
            derivative = self._simulation.derivative(control)
            impulse = np.zeros(len(derivative.impulse))
            self._figures.add(parts[step], derivative, end, slopes, impulse, carried.target)
            slopes, found = self._adjoint.back(derivative, slopes, impulse)
            touching = step == 0 and self._adjoint.touching and any(name.startswith("start.") for name in self._by)
            edges += bool(derivative.edges()) or touching
            shifted += derivative.shift is not None
            unconverged += (derivative.solution.newton_residual or 0.0) > tolerance
            carried.add(derivative, found)
            self._keep_forces(step, derivative, found)
            for name, sides in self._sides.items():
                self._by_sides[name] += sides.along(derivative, found)
            if any(name.startswith(tuple(BASE)) for name in self._of_steps):
                _refuse_turning(derivative.start)
                carried.add_pose(derivative, found, self._adjoint, self._figures.of_frames)
            carried.hand_over(step, control, self._simulation, derivative.start, self._of_steps)
            end = self._simulation.state
        by = {name: self._of_steps[name] if name in self._of_steps else self._of_run(name, slopes) for name in self._by}
        inexact, count = self._adjoint.inexact / max(self._adjoint.contacts, 1), self._count
        shares = edges / count, inexact, shifted / count, unconverged / count
        return RunGradient(value, tuple(self._by), observation, self._count, *shares, by)

    def _control(self, step: int) -> Control:
        """The control of a step from the simulation's present state."""
        if isinstance(self._controls, Mapping):
            values = {name: float(values[step]) for name, values in self._controls.items()}
            return asking(self._simulation.state, values)
        return self._controls[step] or Control()

    def _forwards(self) -> tuple[dict[int, State], list[dict[str, np.ndarray]], float]:
        """States at every few steps, derivatives of each part of the objective, and its value."""
        simulation, states, parts, total = self._simulation, {}, [], 0.0
        for step in range(self._count):
            if step % self._interval == 0:
                states[step] = simulation.state
            simulation.step(self._control(step))
            self._refuse(simulation.state)
            value, slopes = self._part(simulation.observe_state(simulation.state))
            total += value
            parts.append(slopes)
        return states, parts, total

    def _refuse(self, state: State) -> None:
        """Refuse a step to a state, of which not all has a derivative."""
        for name, table, pose in zip(
            self._model.frames.names, self._model.scene.all_frames.values(), state.frame_pose, strict=True
        ):
            holds = any((body.anchor_frame == name).any() for body in self._model.soft_bodies)
            if self._moves and table.pivot is None and holds and pose[1].any():
                moved = next(iter(self._moves))
                raise TaichisoftError(f"by: 'rest.{moved}' moves the pivot of '{name}', which turns: give a pivot")
        external = self._model.external_forces
        for number in np.flatnonzero(state.external_force_steps).tolist():
            name, is_soft = external.names[number], external.is_soft(number)
            without = [by for by in self._by if (by.startswith("rest.") if is_soft else by == f"mass.{name}")]
            if without:
                raise TaichisoftError(f"by: '{without[0]}' has no gradient in a run with a force on '{name}'")
            if is_soft and state.external_force_own_axes[number]:
                raise TaichisoftError(f"controls: no gradient with forces['{name}'].axes = 'own'; take 'world'")

    def _again(self, states: dict[int, State], first: int, last: int) -> None:
        self._simulation.state = states[first]
        for step in range(first, last):
            self._simulation.step(self._control(step))
            states[step + 1] = self._simulation.state

    def _part(self, observation: Observation) -> tuple[float, dict[str, np.ndarray]]:
        """What the objective says of an observation, checked."""
        answer = self._objective(observation)
        if not isinstance(answer, tuple) or len(answer) != 2 or not isinstance(answer[1], Mapping):
            raise TaichisoftError(f"objective gave {answer!r}: must be a number and derivatives by names of figures")
        value, slopes = answer
        if not isinstance(value, Real) or not np.isfinite(value):
            raise TaichisoftError(f"objective = {value!r} at {observation.time:g} s: must be a finite number")
        checked = {}
        for name, given in slopes.items():
            shape = find_figure(str(name), observation, self._model.body_names).of(observation).shape
            slope = as_array(given, f"objective: its derivative by '{name}'")
            if slope.shape != shape or not np.isfinite(slope).all():
                raise TaichisoftError(f"objective: its derivative by '{name}' must be finite numbers of shape {shape}")
            self._figures.check(name)
            if self._moves and str(name).startswith("bending_angles"):
                raise TaichisoftError("objective: bending_angles have no derivative by moves of the nodes at rest")
            checked[name] = slope
        return float(value), checked

    def _keep_forces(self, step: int, derivative: StepDerivative, found: Multipliers) -> None:
        if any(name.startswith("force.") for name in self._of_steps):
            for one in forces(self._model, derivative):
                if one.name in self._of_steps:
                    part = (found.node * one.node_impulse).sum() + (found.rigid * one.rigid_velocity).sum()
                    self._of_steps[one.name][step] = part

    def _of_run(self, name: str, slopes: Slopes) -> np.ndarray:
        """A derivative by something that holds for the whole run."""
        key, _, of = name.partition(".")
        if name in self._by_sides:
            of_start = (slopes.position * self._moves[of]).sum() if key == "rest" else 0.0
            return np.asarray(self._by_sides[name] + of_start)
        if key == "friction":
            return np.asarray((_friction_pairs(self._model, of) * self._adjoint.by_friction).sum())
        return np.asarray(_by_name(self._model, self._adjoint, slopes)[name])


def _by_name(model: Model, adjoint: StepAdjoint, slopes: Slopes) -> dict[str, Any]:
    """Derivatives by the start, and by the properties of bodies and materials."""
    found = {f"start.{name}": values for name, values in vars(slopes).items()}
    found["start.rigid_rotation"] = found.pop("start.rigid_turn")
    found |= {f"young_modulus.{name}": by for name, by in zip(model.material_names, adjoint.by_material, strict=True)}
    parts = adjoint.by_damping, adjoint.by_drag, adjoint.by_density
    for body, by_damping, by_drag, by_density in zip(model.soft_bodies, *parts, strict=True):
        key = "density" if body.settings.mass is None else "mass"
        found[f"rayleigh_stiffness.{body.name}"], found[f"rayleigh_mass.{body.name}"] = by_damping, by_drag
        if body.modes is None:  # which are of these masses; the adjoint has those by shares
            found[f"{key}.{body.name}"] = by_density / getattr(body.settings, key)
    masses = zip(model.rigid_bodies, adjoint.by_mass / model.rigid_mass, strict=True)
    pushed = {one.body for one in model.scene.external_forces}
    free = [(body.name, by) for body, by in masses if body.follows is None]
    held = {body.name for body in model.rigid_bodies if body.springs is not None} | pushed
    return found | {f"mass.{name}": by for name, by in free if name not in held}


def _interval(count: int, state: State, memory: float) -> int:
    """Steps between two states that are kept, so that these and those made again between two fit into memory [B]."""
    size = sum(value.nbytes for value in vars(state).values() if isinstance(value, np.ndarray))
    intervals = np.arange(1, max(int(np.sqrt(count)), 1) + 1)
    fits = (count / intervals + intervals) * size <= memory
    return int(intervals[fits.argmax()] if fits.any() else intervals[-1])


class _Carried:
    """Derivatives by targets, requests and the pose of the base, which last until others take their place."""

    def __init__(self, model: Model):
        self._model, count = model, len(model.actuators.names)
        self.target, self._request = np.zeros((2, count))
        self._pose, self._pose_request = np.zeros((2, 2, 3))

    def add(self, derivative: StepDerivative, found: Multipliers) -> None:
        """Those by the targets of a step: known loads, imposed coordinates, and efforts between stops."""
        actuators, h = self._model.actuators, self._model.scene.time.step
        none = np.zeros((len(self._model.rigid_bodies), 6))
        of_load = h * derivative.geometry.rates(found.node, none)
        first = 3 * derivative.contact_count
        imposed = derivative.start.actuator_imposed
        for row, coordinate in enumerate(derivative.coordinates.tolist()):
            actuator = int(np.searchsorted(actuators.first_coordinate, coordinate, side="right")) - 1
            by_rate, by_effort = -found.row[first + row] / h, found.bounds[row, PREFERRED] * h
            of_load[coordinate] = by_rate if imposed[actuator] else by_effort
        self.target += of_load[actuators.first_coordinate[:-1]]

    def add_pose(
        self,
        derivative: StepDerivative,
        found: Multipliers,
        adjoint: StepAdjoint,
        objective: Sequence[Callable[[State], float]],
    ) -> None:
        """Those by the pose of the base, by differences of what acts."""
        start = derivative.start
        for part, axis in np.ndindex(2, 3):
            half, sides = HALF_WIDTHS[part], []
            for sign in (half, -half):
                pose = start.frame_pose.copy()
                pose[0, part, axis] += sign
                moved = start.changed(frame_pose=pose)
                causes = derivative.causes(moved)
                acts = (found.node * causes.node_impulse).sum() + (found.rigid * causes.rigid_velocity).sum()
                acts += found.row @ causes.row_velocity + (found.bounds * causes.bounds).sum()
                rigid = derivative.rigid.state
                acts += (adjoint.carried * np.hstack([rigid.linear, rigid.angular])).sum()
                sides.append(acts + sum(part(moved) for part in objective))
            self._pose[part, axis] += (sides[0] - sides[1]) / (2.0 * half)
        derivative.causes(start)

    def hand_over(
        self, step: int, control: Control, simulation: Simulation, start: State, kept: dict[str, np.ndarray]
    ) -> None:
        """Give derivatives to the control of a step, and what is left to the targets and requests before it."""
        state = simulation.state
        self._request += np.where(start.actuator_target == start.actuator_request, self.target, 0.0)
        moved = state.changed(actuator_target=state.actuator_target + PROBE)
        follows = simulation.requests.apply(moved, control).actuator_target - start.actuator_target > 0.5 * PROBE
        self.target = np.where(follows, self.target, 0.0)
        for kind in ACTUATOR_KINDS:
            names, place = self._model.actuators.names_of(kind), self._model.actuators.place(kind)
            for drive in (kind.effort, kind.coordinate):
                for of in getattr(control, drive.request):
                    index = place.start + names.index(of)
                    if f"{drive.request}.{of}" in kept:
                        kept[f"{drive.request}.{of}"][step] = self._request[index]
                    self._request[index] = 0.0
        for part, (key, (_, rate)) in enumerate(BASE.items()):
            reached, request = start.frame_pose[0, part], start.frame_request[0, part]
            if getattr(control, rate) is not None or start.frame_velocity[0, part].any():  # on from the pose before
                self._pose[part] += self._pose_request[part]
                self._pose_request[part] = 0.0
            else:
                follows = np.eye(3)
                if (reached != request).any():
                    follows = _limited(reached, request, state.frame_pose[0, part])
                self._pose_request[part] += follows.T @ self._pose[part]
                self._pose[part] -= follows.T @ self._pose[part]
            if getattr(control, key) is not None:
                for axis, letter in enumerate(AXES):
                    if f"{key}.{letter}" in kept:
                        kept[f"{key}.{letter}"][step] = self._pose_request[part, axis]
                self._pose_request[part] = 0.0


def _limited(reached: np.ndarray, request: np.ndarray, before: np.ndarray) -> np.ndarray:
    """Derivative, by the request, of a place on the straight way there; the rest of it is by the place before."""
    way = request - before
    length = float(np.linalg.norm(way))
    follows: np.ndarray = np.linalg.norm(reached - before) / length * (np.eye(3) - np.outer(way, way) / length**2)
    return follows


# What users give, checked.


def _checked_controls(controls: Any) -> tuple[Controls, int]:
    if isinstance(controls, Mapping):
        arrays = {}
        for name, values in controls.items():
            array = as_array(values, f"controls['{name}']")
            if array.ndim != 1 or not len(array) or not np.isfinite(array).all():
                raise ControlError(f"controls['{name}']: must be a finite number for each step")
            arrays[str(name)] = array
        counts = {len(values) for values in arrays.values()}
        if len(counts) != 1:
            raise ControlError(f"controls: must have as many values of each, not {sorted(counts)}")
        return arrays, counts.pop()
    if not isinstance(controls, Sequence) or isinstance(controls, str) or not len(controls):
        raise ControlError(f"controls = {controls!r}: must be a control for each step, or values by names of controls")
    for step, one in enumerate(controls):
        if one is not None and not isinstance(one, Control):
            raise ControlError(f"controls[{step}] = {one!r}: must be a taichisoft.Control or None")
    return list(controls), len(controls)


def _is_of_steps(name: str) -> bool:
    return name.partition(".")[0] in ("force", *BASE, *(drive.request for drive in DRIVES))


def _checked_moves(by: Sequence[str], moves: Mapping[str, Any], simulation: Simulation) -> dict[str, np.ndarray]:
    """The moves that are to be derived by."""
    shape, checked = (simulation.model.node_count, 3), {}
    for name in by:
        key, _, of = name.partition(".")
        if key == "rest":
            move = as_array(moves[of], f"moves['{of}']")
            if move.shape != shape or not np.isfinite(move).all():
                raise TaichisoftError(f"moves['{of}']: must be finite numbers of shape {shape}")
            if simulation.state.step or (simulation.state.position != simulation.model.rest_position).any():
                raise TaichisoftError(f"by: '{name}': the run must begin at the first state of a simulation")
            checked[of] = move
    return checked


def _checked_names(by: Any, model: Model, moves: Any, adjoint: StepAdjoint) -> list[str]:
    if not isinstance(moves, Mapping):
        raise TaichisoftError(f"moves = {moves!r}: must be arrays by name")
    if isinstance(by, str) or not isinstance(by, Sequence):
        raise TaichisoftError(f"by = {by!r}: must be a sequence of names")
    known = [*_known_names(model, adjoint), *(f"rest.{name}" for name in moves)]
    of_modes = (*BASE, "density", "mass") if any(body.modes is not None for body in model.soft_bodies) else ()
    for name in by:
        if name not in known and str(name).partition(".")[0] in of_modes:
            raise TaichisoftError(f"by: '{name}' has no gradient with reduced bodies, whose modes depend on it")
        if name not in known and not str(name).startswith("friction."):
            raise TaichisoftError(f"by: '{name}' is nothing to derive by; {nearest(str(name), known, 'there are')}")
        if str(name).startswith("friction"):
            _friction_pairs(model, str(name).partition(".")[2])
    return list(dict.fromkeys(by))


def _known_names(model: Model, adjoint: StepAdjoint) -> Iterator[str]:
    """All names to derive by, but for friction of pairs."""
    for kind in ACTUATOR_KINDS:
        for drive in (kind.effort, kind.coordinate):
            yield from (f"{drive.request}.{name}" for name in model.actuators.names_of(kind))
    if all(body.modes is None for body in model.soft_bodies):
        yield from (f"{key}.{letter}" for key in BASE for letter in AXES)
    tips = Fingertips(model.soft_bodies, model.frames)
    free = [body.name for body in model.rigid_bodies if body.follows is None]
    yield from (f"force.{name}.{letter}" for name in (*tips.names, *free) for letter in AXES)
    yield from _by_name(model, adjoint, Slopes.none(model))
    yield from coefficients(model)
    yield "friction"


def _refuse_turning(start: State) -> None:
    if start.frame_velocity[0, 1].any() or (start.frame_pose[0, 1] != start.frame_request[0, 1]).any():
        raise TaichisoftError(
            f"by: the base turns at a speed, or limits.base_turning_speed holds it back, at step {start.step}; ask for "
            "base_rotation in place of base_angular_velocity, and leave the limit out"
        )


def _friction_pairs(model: Model, pair: str) -> np.ndarray:
    """Which pairs of bodies a coefficient of friction is of, 1 or 0, shape (body_count, body_count)."""
    names, scene = model.body_names, model.scene.contact
    own = np.zeros((len(names), len(names)))
    for one in scene.pairs:
        if one.friction is not None:
            first, second = (names.index(body) for body in one.bodies)
            own[first, second] = own[second, first] = 1.0
    if not pair:
        return 1.0 - own
    bodies = pair.split("|")
    for body in bodies:
        if body not in names or len(bodies) != 2:
            hint = nearest(body, list(names), "there are")
            raise TaichisoftError(f"by: 'friction.{pair}': name two bodies, as in friction.finger1|cube; {hint}")
    first, second = (names.index(body) for body in bodies)
    chosen = np.zeros_like(own)
    chosen[first, second] = chosen[second, first] = 1.0
    return chosen
