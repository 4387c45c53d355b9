"""Equilibria: where bodies come to rest under their loads, without waiting for it."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from taichisoft.building.simulation import Simulation
from taichisoft.control.control import Control
from taichisoft.control.observation import Observation
from taichisoft.control.requests import apply_control
from taichisoft.errors import EquilibriumNotFound, SimulationDiverged
from taichisoft.linearisation import Linearisation, linearise
from taichisoft.model import Model
from taichisoft.state import State
from taichisoft.step.report import StepReport
from taichisoft.time_stepper import TimeStepper

SMALLEST_INCREMENT = 2.0**-8
"""Smallest part of the change of the loads that is tried at once [-]."""


MOST_SETTLING = 100
"""Most moves from a start at which the bodies do not rest."""
STILL, MOST_MOVES = 1e-6, 300
"""Way in a move below which rigid bodies count as at rest [mm], and most moves."""
MOST_SEARCHES = 10
"""Most searches for contacts at the end: each moves the bodies to where the last one would have them touch."""


@dataclass(frozen=True)
class Equilibrium:
    """Bodies at rest.

    Attributes:
        state: the state, with the time of the state from which the search began and no velocities; `Simulation.restore`
            goes on from it.
        observation: what a controller sees in it.
        linearisations: number of linearisations of the soft bodies' equations, over all increments.
        increments: number of parts in which the loads were changed: 1 unless the equations had no solution in reach.
        residual: largest move of a node by another linearisation, or by another search for contacts [mm].
    """

    state: State
    observation: Observation
    linearisations: int
    increments: int
    residual: float
    _stepper: TimeStepper = field(repr=False, compare=False)

    def linearise(self, controls: Sequence[str] | None = None) -> Linearisation:
        """Derivatives of what is observed in the equilibrium by what is asked for: its compliance.

        As `Simulation.linearise`, of the equilibrium from here. A contact at the limit of its friction slides on in
        the direction in which friction opposes it, which is where increasing loads have driven it; where they decrease
        it would stick. Contacts do not turn with bodies, which is exact on flat obstacles, and some percent between
        pads and a rigid body.

        Args:
            controls: names of the controls by which to derive, see `Linearisation`; None: by all that can be varied.

        Raises:
            ControlError: a name in `controls` is not that of something which can be varied.
            SceneError: a contact has restitution, spinning or rolling friction.
        """
        self._stepper.restore(self.state)
        return linearise(self._stepper, None, controls)


def equilibrium(simulation: Simulation, control: Control | None = None) -> Equilibrium:
    """Find where the bodies of a simulation come to rest; the simulation stays where it is.

    The search begins with the present state: where there are several equilibria it finds one near by, and friction
    keeps what sticks. It solves the static equations with contacts and actuators by Newton's method with a line search,
    to `time.newton_tolerance` [mm]. Where that fails it changes the loads in smaller increments, and where bodies may
    touch in so small ones that no node moves by more than half of `contact.alarm_distance` at once. Limits of
    pressures and so on hold, limits of their rates do not.

    Rigid bodies go along in moves of one time step from rest, in which their inertia alone keeps them back and friction
    holds what sticks, until none moves by more than 1e-6 mm (a proximal point method: Rockafellar 1976, Monotone
    operators and the proximal point algorithm). The heavier they are, the more moves.

    Args:
        simulation: a simulation with soft bodies, all of them with anchors.
        control: pressures, pulls, base and so on, as for a step; None: as they were asked for last.

    Raises:
        ControlError: `control` requests something impossible.
        SceneError: the simulation has no soft body, or one without anchors.
        EquilibriumNotFound: the loads cannot be carried, such as a pressure beyond which a cavity grows on and on, or
            nothing holds a rigid body.
    """
    return statics_of(simulation).find(simulation.state, Control() if control is None else control)


def statics_of(simulation: Simulation) -> "Statics":
    """The static variant of a simulation's model, which it keeps.

    Raises:
        SceneError: the simulation has no soft body, or one without anchors.
    """
    statics: Statics = simulation.keep("statics", lambda: Statics(simulation.model))
    if statics.source is not simulation.model:  # changed since
        statics.set_model(simulation.model)
    return statics


class Statics:
    """A static variant of a model, with its work space.

    Attributes:
        source: the model of which it is a variant.
        model: the variant.
    """

    def __init__(self, model: Model):
        """Make the variant, see `Model.static`."""
        self.set_model(model)

    def set_model(self, model: Model) -> None:
        """Become a variant of another model."""
        self.source = model
        self._stepper = TimeStepper(model.static())
        self.model = self._stepper.model

    def close(self) -> None:
        """Nothing is left open."""

    def find(self, start: State, control: Control) -> Equilibrium:
        """The equilibrium under a control, from a state on."""
        stepper = self._stepper
        loads = _Loads(stepper.model, start, apply_control(stepper.model, start, control))
        state, share, increment, increments, linearisations, residual = start, 0.0, 1.0, 0, 0, 0.0
        is_settled = False
        while share < 1.0:
            aim = min(1.0, share + increment)
            problem = ""
            try:
                stepper.restore(loads.at(state, aim))
                with np.errstate(over="ignore", invalid="ignore"):  # an end that is not finite is refused below
                    report = stepper.step()
                linearisations += report.linearisations
                residual = report.newton_residual or 0.0
                problem = self._problem(state, report)
            except SimulationDiverged as error:
                problem = f"body '{error.body}' {error.cause}"
            if not problem:
                state, share, increment, increments = stepper.state, aim, 2.0 * increment, increments + 1
                continue
            increment *= 0.5
            if increment < SMALLEST_INCREMENT and share == 0.0 and not is_settled:
                state, more = self._settled(loads, state)
                is_settled, increment, linearisations = True, 1.0, linearisations + more
            if increment < SMALLEST_INCREMENT:
                raise EquilibriumNotFound(
                    f"no equilibrium found beyond {share:.1%} of the change of the loads: {problem}; try smaller "
                    "loads, or begin nearer to rest"
                )
        rigid = len(state.rigid_position) > 0
        tolerance = STILL if rigid else stepper.model.scene.time.newton_tolerance
        for _ in range(MOST_MOVES if rigid else MOST_SEARCHES if len(state.contact_point) else 0):
            before = state
            stepper.restore(loads.at(before, 1.0))
            report, state = stepper.step(), stepper.state
            linearisations += report.linearisations
            way = self._way(before, state)
            residual = max(report.newton_residual or 0.0, way)
            if way <= tolerance:
                break
        else:
            if rigid:
                raise EquilibriumNotFound(
                    f"bodies do not come to rest: after {MOST_MOVES} moves one still goes {residual:.2g} mm at a time; "
                    "nothing holds it, or it is heavy for what holds it"
                )
        state = loads.finished(state)
        stepper.restore(state)
        return Equilibrium(state, stepper.observe(), linearisations, increments, residual, stepper)

    def _settled(self, loads: "_Loads", state: State) -> tuple[State, int]:
        """Where bodies that do not rest at the start go under the loads there, in short moves; and linearisations."""
        stepper, linearisations = self._stepper, 0
        longest = 0.5 * stepper.model.scene.contact.alarm_distance
        for _ in range(MOST_SETTLING):
            try:
                stepper.restore(loads.at(state, 0.0))
                report = stepper.step()
            except SimulationDiverged:
                break
            way, end = self._way(state, stepper.state), stepper.state
            linearisations += report.linearisations
            if not self._problem(state, report):
                return end, linearisations
            if not way > longest:
                break
            moved = {name: getattr(state, name) for name in ("position", "rigid_position", "rigid_rotation")}
            moved = {name: before + longest / way * (getattr(end, name) - before) for name, before in moved.items()}
            moved["rigid_rotation"] /= np.linalg.norm(moved["rigid_rotation"], axis=1, keepdims=True)
            state = end.changed(**moved)
        return state, linearisations

    def _way(self, before: State, after: State) -> float:
        """Longest way of a node, or of a point of a rigid body [mm]."""
        ways = [np.linalg.norm(after.position - before.position, axis=1)]
        radius = np.array([body.radius for body in self._stepper.model.rigid_bodies])
        turn = 2.0 * np.linalg.norm(after.rigid_rotation - before.rigid_rotation, axis=1)
        ways.append(np.linalg.norm(after.rigid_position - before.rigid_position, axis=1) + turn * radius)
        return float(np.concatenate(ways).max())

    def _problem(self, before: State, report: StepReport) -> str:
        """Why the end of a static step is not to be trusted, or empty.

        Contacts are searched before a step, within the alarm distance: bodies that go farther may pass each other.
        """
        model = self._stepper.model
        if not (report.converged and (report.newton_residual or 0.0) <= model.scene.time.newton_tolerance):
            return f"not solved after {report.linearisations} linearisations and {report.iterations} sweeps"
        way = self._way(before, self._stepper.state)
        if model.surfaces.may_touch.any() and way > 0.5 * model.scene.contact.alarm_distance:
            return f"a node would move by {way:.3g} mm at once, more than half of contact.alarm_distance"
        return ""


class _Loads:
    """What acts on the bodies, from a state to that which a control asks for."""

    def __init__(self, model: Model, start: State, asked: State):
        self._start, self._asked = start, asked
        coordinates = model.actuators.own_coordinates(start)
        acting = np.where(asked.actuator_imposed, coordinates, start.actuator_effort)
        self._ends = {"actuator_target": (acting, asked.actuator_target)}
        for name in ("frame_pose", "anchor_position", "gravity", "young_modulus", "pull_point"):
            self._ends[name] = (getattr(start, name), getattr(asked, name))

    def at(self, state: State, share: float) -> State:
        """A state with the loads after a share of the change; asked for as they are, so that no limit changes them."""
        loads = {
            name: first + share * (last - first) if share < 1.0 else last for name, (first, last) in self._ends.items()
        }
        return state.changed(
            **loads,
            time=self._start.time,
            step=self._start.step,
            rigid_velocity=np.zeros_like(state.rigid_velocity),
            rigid_angular_velocity=np.zeros_like(state.rigid_angular_velocity),
            actuator_imposed=self._asked.actuator_imposed,
            actuator_request=loads["actuator_target"],
            frame_request=loads["frame_pose"],
            frame_velocity=np.zeros_like(loads["frame_pose"]),
        )

    def finished(self, state: State) -> State:
        """The state at the time of the first one, with what was asked for."""
        asked = {name: getattr(self._asked, name) for name in ("actuator_request", "frame_request")}
        return self.at(state, 1.0).changed(**asked)
