"""The time step: implicit Euler, contacts and actuators solved together."""

import time
from functools import partial

import numpy as np

from taichisoft.bodies.actuators import ActuatorGeometry
from taichisoft.contact.kernels.contacts import Contacts
from taichisoft.control.control import Control
from taichisoft.control.observation import Observation
from taichisoft.control.observer import Observer
from taichisoft.control.requests import apply_control
from taichisoft.errors import SceneError
from taichisoft.model import Model
from taichisoft.solver.actuator_rows import ActuatorRows
from taichisoft.state import State
from taichisoft.step.constraints import Constraints
from taichisoft.step.contact_prediction import ContactPrediction, Found
from taichisoft.step.divergence import DivergenceCheck
from taichisoft.step.newton import NewtonIteration
from taichisoft.step.report import StepReport
from taichisoft.step.rigid_motion import RigidMotion
from taichisoft.step.soft_motion import SoftMotion

NO_CONTACTS = Found(Contacts.with_room(0), np.zeros(0))


class Simulation:
    """A model, which it shares with others, and a state, with the work space of a step.

    Attributes:
        model: everything that does not change.
        state: everything that changes; every step puts a new one in its place, see `restore`.
        report: report of the last step; None before the first.
    """

    def __init__(self, model: Model):
        """Begin at the model's initial state."""
        self.model = model
        self.state = model.initial_state()
        self.report: StepReport | None = None
        self._geometry = ActuatorGeometry(model.actuators, model.node_count)
        self._actuators = ActuatorRows(model, self._geometry)
        self._soft = SoftMotion(model, model.elasticity, self._geometry) if model.elasticity is not None else None
        self._rigid = RigidMotion(model)
        self._prediction = ContactPrediction(model, self._rigid.state)
        self._constraints = Constraints(model, self._soft, self._rigid, self._geometry, self._actuators)
        self._newton: NewtonIteration | None = None
        if model.elasticity is not None and self._soft is not None and model.scene.time.newton > 1:
            parts = (self._soft, self._rigid, self._geometry, self._actuators, self._constraints)
            self._newton = NewtonIteration(model, model.elasticity, *parts)
        self._divergence_check = DivergenceCheck(model)
        self._observer = Observer(model)

    def restore(self, state: State) -> None:
        """Go on from a state of this model, an earlier one or one read from a file.

        Raises:
            StateError: it belongs to another model, or has a value that is not a finite number.
        """
        self.model.check(state)
        self.state = state

    def change_model(self, model: Model) -> None:
        """Go on with a variant of the model, see `Model.varied`; the state stays as it is.

        It costs a fraction of a millisecond, where a simulation made of the variant needs work space of its own.

        Raises:
            SceneError: it is the model of something else.
        """
        if model.surfaces is not self.model.surfaces:
            raise SceneError("change_model takes a variant of the simulation's own model, as `Model.varied` makes it")
        self.model = model
        # All other parts read of their model only what variants share.
        self._rigid.take_masses(model)
        self._constraints.take_friction(model)

    def step(self, control: Control | None = None) -> StepReport:
        """Advance by one time step.

        Raises:
            ControlError: `control` asks for something impossible; nothing has changed.
            SimulationDiverged: the step failed; `state` is the last good one.
        """
        started = time.perf_counter()
        control = Control() if control is None else control
        start = apply_control(self.model, self.state, control)
        self._begin_actuators(start)
        self._begin_motion(start)
        found = self._find_contacts(start)
        self._constraints.solve(start, found)
        if self._newton is not None:
            self._newton.improve(start, found)
        self._constraints.end(found)
        end = self._integrate(start)
        self._divergence_check.check(start, end)
        self.state = end
        self.report = self._make_report(end, control, started)
        return self.report

    def observe(self) -> Observation:
        """What a controller sees: it depends on the state alone, so that a restored run is observed alike."""
        return self._observer.observe(self.state)

    def _begin_actuators(self, start: State) -> None:
        """Volumes and lengths with their gradients, and what is asked of them."""
        self._geometry.update(start, self.model.placed_pull_points(start))
        self._actuators.begin(start)
        if self.model.elasticity is not None:
            self._actuators.look_ahead(start, self.model.elasticity.node_lead)

    def _begin_motion(self, start: State) -> None:
        """Forces and matrices of all bodies, and their motion as far as it needs no contacts."""
        if self._soft is not None:
            self._soft.begin(start, self._actuators.load)
        self._rigid.solve_free_motion(start)

    def _find_contacts(self, start: State) -> Found:
        """The contacts that may become constraints, each where the surfaces are about to be."""
        if not self._prediction.is_needed:
            return NO_CONTACTS
        return self._prediction.find(start)

    def _integrate(self, start: State) -> State:
        """The state that the velocities lead to."""
        time_step, rigid, solved = self.model.scene.time.step, self._rigid.state, self._constraints
        self._rigid.integrate()
        position = time_step * solved.node_velocity
        position += start.position
        if solved.node_shift is not None:
            position += time_step * solved.node_shift
        told, count = solved.told, int(solved.told.count[0])
        end = start.changed(
            time=(start.step + 1) * time_step,
            step=start.step + 1,
            position=position,
            velocity=solved.node_velocity,
            rigid_position=rigid.position.copy(),
            rigid_rotation=rigid.quaternion.copy(),
            rigid_velocity=rigid.linear.copy(),
            rigid_angular_velocity=rigid.angular.copy(),
            cavity_pressure=solved.cavity_pressure,
            cavity_volume=self._geometry.volumes.volumes(position),
            cable_tension=solved.cable_tension,
            cable_tension_loss=solved.cable_tension_loss,
            contact_body_pair=told.bodies[:count].copy(),
            contact_point=told.point[:count].copy(),
            contact_normal=told.normal[:count].copy(),
            contact_impulse=told.impulse[:count].copy(),
            contact_slip=told.slip[:count].copy(),
        )
        if self.model.cables.names:
            lengths = self._geometry.measure_cables(end, self.model.placed_pull_points(end))
            end = end.changed(cable_length=lengths)
        return end

    def _make_report(self, end: State, control: Control, started: float) -> StepReport:
        solved, time_step, names = self._constraints, self.model.scene.time.step, self.model.body_names
        return StepReport(
            step=end.step - 1,
            time=end.time,
            contact_points=end.contact_point,
            contact_forces=end.contact_impulse / time_step,
            contact_bodies=end.contact_body_pair,
            body_names=names,
            max_penetration=solved.penetration,
            iterations=solved.iterations,
            residual=solved.residual,
            converged=solved.residual < self.model.scene.contact.tolerance and self._newton_converged,
            signals=dict(control.signals),
            step_time=time.perf_counter() - started,
            observe=partial(self._observer.observe, end),
            deepest=(names[solved.deepest[0]], names[solved.deepest[1]]) if solved.deepest else None,
            inverted_elements=self._divergence_check.inverted,
            linearisations=self._newton.linearisations if self._newton is not None else 1,
            newton_residual=self._newton.residual if self._newton is not None else None,
        )

    @property
    def _newton_converged(self) -> bool:
        return self._newton is None or self._newton.residual <= self.model.scene.time.newton_tolerance
