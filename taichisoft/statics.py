"""Equilibria of soft bodies: where they come to rest under their loads, without waiting for it."""

from dataclasses import dataclass

import numpy as np

from taichisoft.building.simulation import Simulation
from taichisoft.control.control import Control
from taichisoft.control.observation import Observation
from taichisoft.control.requests import apply_control
from taichisoft.errors import EquilibriumNotFound, SimulationDiverged
from taichisoft.model import Model
from taichisoft.state import State
from taichisoft.step.report import StepReport
from taichisoft.time_stepper import TimeStepper

SMALLEST_INCREMENT = 2.0**-8
"""Smallest part of the change of the loads that is tried at once [-]."""


MOST_SEARCHES = 10
"""Most searches for contacts at the end: each moves the bodies to where the last one would have them touch."""


@dataclass(frozen=True)
class Equilibrium:
    """Soft bodies at rest.

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


def equilibrium(simulation: Simulation, control: Control | None = None) -> Equilibrium:
    """Find where the soft bodies of a simulation come to rest; the simulation stays where it is.

    The search begins with the present state: where there are several equilibria it finds one near by, and friction
    keeps what sticks. It solves the static equations with contacts and actuators by Newton's method with a line search,
    to `time.newton_tolerance` [mm]. Where that fails it changes the loads in smaller increments, and where bodies may
    touch in so small ones that no node moves by more than half of `contact.alarm_distance` at once. Limits of
    pressures and so on hold, limits of their rates do not.

    Args:
        simulation: a simulation of soft bodies with anchors, and of obstacles.
        control: pressures, pulls, base and so on, as for a step; None: as they were asked for last.

    Raises:
        ControlError: `control` requests something impossible.
        SceneError: the simulation has a rigid body, or a soft body without anchors.
        EquilibriumNotFound: the loads cannot be carried, such as a pressure beyond which a cavity grows on and on.
    """
    statics: _Statics = simulation.keep("statics", lambda: _Statics(simulation.model))
    if statics.source is not simulation.model:  # changed since
        statics.set_model(simulation.model)
    return statics.find(simulation.state, Control() if control is None else control)


class _Statics:
    """A static variant of a model, with its work space."""

    def __init__(self, model: Model):
        self.set_model(model)

    def set_model(self, model: Model) -> None:
        self.source = model
        self._stepper = TimeStepper(model.static())

    def close(self) -> None:
        """Nothing is left open."""

    def find(self, start: State, control: Control) -> Equilibrium:
        """The equilibrium under a control, from a state on."""
        stepper = self._stepper
        loads = _Loads(stepper.model, start, apply_control(stepper.model, start, control))
        state, share, increment, increments, linearisations, residual = start, 0.0, 1.0, 0, 0, 0.0
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
            if increment < SMALLEST_INCREMENT:
                raise EquilibriumNotFound(
                    f"no equilibrium found beyond {share:.1%} of the change of the loads: {problem}; try smaller "
                    "loads, or begin nearer to rest"
                )
        for _ in range(MOST_SEARCHES if len(state.contact_point) else 0):
            before = state
            stepper.restore(loads.at(before, 1.0))
            report, state = stepper.step(), stepper.state
            linearisations += report.linearisations
            way = float(np.linalg.norm(state.position - before.position, axis=1).max())
            residual = max(report.newton_residual or 0.0, way)
            if way <= stepper.model.scene.time.newton_tolerance:
                break
        state = loads.finished(state)
        stepper.restore(state)
        return Equilibrium(state, stepper.observe(), linearisations, increments, residual)

    def _problem(self, before: State, report: StepReport) -> str:
        """Why the end of a static step is not to be trusted, or empty.

        Contacts are searched before a step, within the alarm distance: bodies that go farther may pass each other.
        """
        model = self._stepper.model
        if not (report.converged and (report.newton_residual or 0.0) <= model.scene.time.newton_tolerance):
            return f"not solved after {report.linearisations} linearisations and {report.iterations} sweeps"
        way = np.linalg.norm(self._stepper.state.position - before.position, axis=1).max()
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
            actuator_imposed=self._asked.actuator_imposed,
            actuator_request=loads["actuator_target"],
            frame_request=loads["frame_pose"],
            frame_velocity=np.zeros_like(loads["frame_pose"]),
        )

    def finished(self, state: State) -> State:
        """The state at the time of the first one, with what was asked for."""
        asked = {name: getattr(self._asked, name) for name in ("actuator_request", "frame_request")}
        return state.changed(time=self._start.time, step=self._start.step, **asked)
