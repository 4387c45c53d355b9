"""The time step: implicit Euler, contact and cavities solved together."""

import time
from dataclasses import replace

import numpy as np

from taichisoft.contact.detection import ContactDetection
from taichisoft.contact.moving_surfaces import MovingSurfaces
from taichisoft.contact.reduction import ContactReduction
from taichisoft.control.control import Control
from taichisoft.control.limits import clipped
from taichisoft.control.observation import Observation
from taichisoft.control.observer import Observer
from taichisoft.control.requests import apply_control
from taichisoft.kernels.contacts import Contacts
from taichisoft.model import Model
from taichisoft.state import State
from taichisoft.step.active_set import ActiveSet
from taichisoft.step.constraints import ConstraintProblem
from taichisoft.step.divergence import DivergenceCheck
from taichisoft.step.report import StepReport
from taichisoft.step.rigid_motion import RigidMotion
from taichisoft.step.soft_motion import SoftMotion


class Simulation:
    """A model and its state.

    Attributes:
        model: what does not change.
        state: replaced by every step; see `restore`.
        report: of the last step, None before the first.
    """

    def __init__(self, model: Model):
        """Begin at the model's initial state."""
        self.model = model
        self.state = model.initial_state()
        self.report: StepReport | None = None
        self._moving = MovingSurfaces(model.surfaces)
        self._detection = ContactDetection(model.surfaces, self._moving)
        self._reduction = ContactReduction(model.surfaces.body_size, model.scene.contact.spacing)
        self._soft = SoftMotion(self.model)
        self._rigid = RigidMotion(self.model)
        self._problem = ConstraintProblem(self.model, self._rigid)
        self._active_set = ActiveSet(self.model, self._rigid)
        self._check_divergence = DivergenceCheck(self.model)
        self._observer = Observer(self.model)

    def restore(self, state: State) -> None:
        """Go on from a state of this model, an earlier one or one read from a file.

        Raises:
            StateError: it belongs to another model.
        """
        self.model.check(state)
        self.state = state

    def step(self, control: Control | None = None) -> StepReport:
        """Advance by one time step.

        Raises:
            ControlError: `control` asks for something impossible; nothing has changed.
            SimulationDiverged: the step failed; `state` is the last good one.
        """
        started = time.perf_counter()
        control = control or Control()
        state = apply_control(self.model, self.state, control)
        self._soft.update(state)
        self._rigid.update(state)
        candidates = self._find_contacts(state)
        contacts, last_impulse = self._choose_contacts(state, candidates)
        velocity, contact_impulse, contact_slip = self._solve_contacts(state, contacts, last_impulse)
        next_state = self._move(state, velocity, contacts, contact_impulse, contact_slip)
        self._check_divergence(state, next_state)
        self.state = next_state
        self.report = self._make_report(candidates, control, started)
        return self.report

    def observe(self) -> Observation:
        """What a controller sees: it depends on the state alone, so that a restored run is observed alike."""
        return self._observer.observe(self.state)

    def _find_contacts(self, state: State) -> Contacts:
        if self._detection.is_needed:
            self._moving.update(state.position, state.rigid_position, self._rigid.rotation)
        alarm = self.model.scene.contact.alarm_distance
        return self._detection.find(reach=alarm, depth=alarm)

    def _choose_contacts(self, state: State, candidates: Contacts) -> tuple[Contacts, np.ndarray]:
        """The contacts that become constraints, and the impulse of each in the last step."""
        settings = self.model.scene.contact
        contacts = self._reduction.reduce(candidates, state)
        radius = max(settings.spacing, settings.contact_distance)
        last_impulse = self._reduction.last_impulses(contacts, state, radius)
        return contacts.trimmed(), last_impulse[: contacts.count[0]]

    def _solve_contacts(
        self, state: State, contacts: Contacts, last_impulse: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Velocities of the nodes with contacts and imposed volumes; impulse and sliding speed of each contact.

        Contacts that are expected to stay open are left out at first, see `active_set`.
        """
        problem, active_set = self._problem, self._active_set
        problem.iterations = 0
        active_set.begin(contacts, last_impulse, state.velocity)
        while True:
            problem.lay_out(state, contacts.take(np.flatnonzero(active_set.chosen)))
            problem.measure(self._soft.velocity)
            problem.solve(last_impulse[active_set.chosen])
            velocity = self._push(problem)
            if not active_set.add_missed(velocity):
                break
        impulse = np.zeros((len(last_impulse), 3))
        impulse[active_set.chosen] = problem.rows.contact_impulse
        slip = np.zeros(len(last_impulse))
        slip[active_set.chosen] = problem.slip
        return velocity, impulse, slip

    def _push(self, problem: ConstraintProblem) -> np.ndarray:
        """Velocities after the impulses: of the rigid bodies in place, of the soft nodes as a result."""
        if not problem.rows.count:
            self._rigid.impulse[:] = 0.0
        self._rigid.push()
        if problem.rows.count and self.model.elasticity is not None:
            velocity = self._soft.response(problem.node_impulse)
            velocity += self._soft.velocity
            return velocity
        return self._soft.velocity

    def _move(
        self,
        state: State,
        node_velocity: np.ndarray,
        contacts: Contacts,
        contact_impulse: np.ndarray,
        contact_slip: np.ndarray,
    ) -> State:
        """The state that the velocities lead to."""
        time_step, rigid = self.model.scene.time.step, self._rigid
        rigid.move()
        position = time_step * node_velocity
        position += state.position
        return replace(
            state,
            time=(state.step + 1) * time_step,
            step=state.step + 1,
            position=position,
            velocity=node_velocity,
            rigid_position=rigid.position.copy(),
            rigid_rotation=rigid.quaternion.copy(),
            rigid_velocity=rigid.linear.copy(),
            rigid_angular_velocity=rigid.angular.copy(),
            cavity_impulse=self._problem.cavity_impulse,
            cavity_volume=self.model.cavities.volumes(position),
            contact_body_pair=contacts.bodies,
            contact_point=contacts.middle,
            contact_normal=contacts.normal,
            contact_impulse=contact_impulse,
            contact_slip=contact_slip,
        )

    def _make_report(self, candidates: Contacts, control: Control, started: float) -> StepReport:
        contact, time_step, problem = self.model.scene.contact, self.model.scene.time.step, self._problem
        summary = self._observer.contacts(self.state)
        nearest = candidates.distance[: candidates.count[0]].min(initial=np.inf)
        return StepReport(
            step=self.state.step - 1,
            time=self.state.time,
            pressures=self._by_cavity(self.state.cavity_impulse / time_step),
            volumes=self._by_cavity(self.state.cavity_volume),
            normal_forces=summary.normal_forces,
            friction_forces=summary.friction_forces,
            slip_speeds=summary.slip_speeds,
            contact_count=len(self.state.contact_point),
            contact_points=self.state.contact_point,
            contact_forces=self.state.contact_impulse / time_step,
            max_penetration=float(max(0.0, contact.contact_distance - nearest)),
            iterations=problem.iterations,
            residual=problem.residual,
            converged=problem.residual < contact.tolerance,
            clipped=clipped(self.model, self.state),
            signals=dict(control.signals),
            step_time=time.perf_counter() - started,
        )

    def _by_cavity(self, values: np.ndarray) -> dict[str, float]:
        return dict(zip(self.model.cavities.names, values.tolist(), strict=True))
