"""The time step: implicit, with contacts and actuators solved together."""

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from taichisoft.base.text import warn_caller
from taichisoft.contact.constraint_rows import ActuatorRequests, request
from taichisoft.contact.detection import ContactTable
from taichisoft.contact.kernels.constraint_problem import ReportedContacts
from taichisoft.contact.model import Model
from taichisoft.control.control import NOTHING, Control
from taichisoft.control.observation import Observation
from taichisoft.control.observer import Observer
from taichisoft.control.requests import Requests
from taichisoft.errors import SceneError
from taichisoft.mechanics.body_geometry import PosesAhead
from taichisoft.mechanics.model_actuators import ActuatorGeometry
from taichisoft.mechanics.state import State
from taichisoft.step.constraint_solver import ConstraintSolver
from taichisoft.step.contact_prediction import ContactPrediction
from taichisoft.step.divergence import DivergenceCheck, Imbalance, StrainWatch
from taichisoft.step.equilibrium_search import EquilibriumSearch, FoundEquilibrium, StabilityCheck
from taichisoft.step.frame_wrenches import FrameWrenches
from taichisoft.step.nonlinear_step import NonlinearStep
from taichisoft.step.points_of_step import PointsOfStep
from taichisoft.step.rigid_motion import RigidMotion
from taichisoft.step.soft_motion import SoftMotion
from taichisoft.step.solution import Shift, StepProblem, StepReport, StepSolution, moving_velocity
from taichisoft.step.step_derivative import StepDerivative

MOST_SEARCHES = 8
"""Most searches for contacts in a step; a second one is rare, see `ContactPrediction`."""


class TimeStepper:
    """A shared model, a state, and the work space of a step.

    Attributes:
        model: constant data.
        state: current state; every step replaces it, see `restore`.
        report: report of the last step; None before the first step.
        requests: takes over what controllers ask for.
        strain_watch: measures how far soft bodies are stretched, over what their laws hold for.
    """

    def __init__(self, model: Model):
        """Start at the model's initial state."""
        self.model = model
        self.state = model.initial_state()
        self.report: StepReport | None = None
        self.strain_watch = StrainWatch(model)
        self.requests = Requests(model)
        self._geometry = ActuatorGeometry(model.actuators, model.node_count)
        self._soft = SoftMotion(model, model.elasticity, self._geometry) if model.elasticity is not None else None
        self._rigid = RigidMotion(model)
        points = PointsOfStep(model)
        self._prediction = ContactPrediction(model, self._rigid.state, points)
        self._constraint_solver = ConstraintSolver(model, self._soft, self._rigid, points)
        self._solver: ConstraintSolver | NonlinearStep = self._constraint_solver
        self._ends_linearised = model.scene.time.most_linearisations > 1  # solved at the end of the step
        if model.elasticity is not None and self._soft is not None and self._ends_linearised:
            self._solver = NonlinearStep(model, model.elasticity, self._soft, self._rigid, self._constraint_solver)
        equations = self._solver.equations if isinstance(self._solver, NonlinearStep) else None
        self._frame_wrenches = FrameWrenches(model, points, self._soft, equations)
        self._divergence_check = DivergenceCheck(model, points)
        self._observer = Observer(model)
        self._has_reduced_bodies = any(body.modes is not None for body in model.soft_bodies)
        self._imbalance: Imbalance | None = None
        self._solved: tuple[StepProblem, StepSolution] | None = None
        self._is_static = model.scene.time.dynamics == "static"
        self._warned: set[tuple[int, ...]] = set()
        self.state = self._observer.with_samples(self.state)

    def restore(self, state: State) -> None:
        """Continue from a state of this model, such as an earlier one or one read from a file.

        Raises:
            StateError: the state belongs to another model, or has a value that is not finite.
        """
        self.model.check(state)
        self.state = self._observer.with_samples(state)

    def change_model(self, model: Model) -> None:
        """Continue with a variant of the model, see `Model.varied`; the state is unchanged.

        This takes a fraction of a millisecond, while a new simulation needs work space of its own.

        Raises:
            SceneError: the model is not a variant of the present one.
        """
        if model.surfaces is not self.model.surfaces:
            raise SceneError("change_model takes a variant of the simulation's own model, as `Model.varied` makes it")
        self.model = model
        # All other parts use only data that variants share.
        self._rigid.set_masses(model)
        self._constraint_solver.set_friction(model)

    def step(self, control: Control | None = None) -> StepReport:
        """Advance by one time step.

        Raises:
            ControlError: `control` requests something impossible; nothing has changed.
            SimulationDiverged: the step failed; `state` is the state before it. Of static dynamics it is
                EquilibriumNotFound where nothing holds a body.
        """
        started = time.perf_counter()
        control = NOTHING if control is None else control
        start = self.requests.apply(self.state, control)
        if self._is_static:
            found = self.find_equilibrium(self.state, start)
            taken = time.perf_counter() - started
            if found.warning:
                warn_caller(found.warning)
            self.state = found.state
            self.report = replace(
                found.report,
                signals=dict(control.signals),
                step_time=taken,
                stiffness=found.stiffness,
                left=found.left,
                unchecked=found.unchecked,
            )
        else:
            self.state, self.report = self._move(start, control, started)
        return self.report

    def find_equilibrium(self, start: State, requested: State, stable: bool = True) -> FoundEquilibrium:
        """Where the bodies of a state come to rest under the requests of another; of a model of static dynamics.

        An unstable equilibrium is left if it must be `stable`.

        Raises:
            EquilibriumNotFound: see `taichisoft.equilibrium`.
        """

        def move(state: State, tolerance: float, unmixed: int) -> tuple[State, StepReport]:
            if not isinstance(self._solver, NonlinearStep):
                return self._move(state, NOTHING, 0.0)
            self._solver.tolerance, self._solver.unmixed = tolerance, unmixed
            try:
                return self._move(state, NOTHING, 0.0)
            finally:
                self._solver.tolerance, self._solver.unmixed = self.model.scene.time.newton_tolerance, 0

        # Not kept: it would refer back to this object, which could then not be freed at once.
        return EquilibriumSearch(self.model, move, self._stability).find(start, requested, stable)

    def _stability(self, end: State) -> StabilityCheck | None:
        """Prepare to check the end of the last move."""
        if self._soft is None or not isinstance(self._solver, NonlinearStep):
            return None
        if self._solved is None:  # another problem was solved in the same work space
            self._solved = self._solve(end)
        parts = self._soft, self._rigid, self._constraint_solver, self._solver
        return StabilityCheck(self.model, *parts, *self._solved)

    def derivative(self, control: Control) -> StepDerivative:
        """Solve the step that `step` would make, and linearise it; the state stays.

        Raises:
            ControlError, SimulationDiverged: see `step`.
            SceneError: see `StepDerivative`; or steps are not those of implicit Euler.
        """
        if self.model.scene.time.theta < 1.0:
            raise SceneError("time.theta: derivatives are of implicit Euler's steps alone; leave it 1")
        start = self.requests.apply(self.state, control)
        problem, solution = self._solve(start)
        reported = self._constraint_solver.report(problem, solution)
        shift = self._constraint_solver.find_shift(problem, solution)
        self._divergence_check.check(start, self._integrate(start, solution, shift, reported))
        if shift is not None:  # which was found in the same work space
            problem, solution = self._solve(start)
        parts = self._soft, self._rigid, self._constraint_solver, self._solver
        return StepDerivative(self.model, *parts, problem, solution, shift)

    def end_along(self, derivative: StepDerivative, start: State, change: StepSolution, share: float) -> State:
        """The end of the step of a derivative from a start with other requests, and with a share of a change."""
        problem, solution, speeds = derivative.moved(start, change, share)
        answer = self._constraint_solver.rows.solver.velocity[: len(speeds)]
        before = answer.copy()
        answer += share * speeds
        reported = self._constraint_solver.report(problem, solution)
        answer[:] = before
        return self._integrate(start, solution, derivative.shift, reported)

    def observe(self) -> Observation:
        """What a controller sees; depends on the state only, so that a restored run gives the same observations."""
        return self._observer.observe(self.state)

    def observe_state(self, state: State) -> Observation:
        """The exact observation of another state of the model, without the scene's sensors."""
        return self._observer.truth(state)

    def _move(self, start: State, control: Control, started: float) -> tuple[State, StepReport]:
        """Solve the equations of a step once, and move everything."""
        problem, solution = self._solve(start)
        reported = self._constraint_solver.report(problem, solution)
        shift = self._constraint_solver.find_shift(problem, solution)
        self._solved = None if shift is not None else (problem, solution)
        gradient = self._geometry.gradient.soft.copy() if self._has_reduced_bodies else None
        end = self._integrate(start, solution, shift, reported)
        self._divergence_check.check(start, end)
        end = self._observer.with_samples(end, start)
        find_imbalance = dict if gradient is None else self._imbalance_of(start, end, solution, gradient)
        report = self._make_report(problem, solution, shift, end, control, find_imbalance, started)
        return end, report

    def _solve(self, start: State) -> tuple[StepProblem, StepSolution]:
        requests = self._request(start)
        self._begin_motion(start, requests)
        contacts: ContactTable | None = self._prediction.find(start)
        searches = 1
        while contacts is not None:
            problem = StepProblem(start, contacts, self._geometry, requests)
            solution = self._solver.solve(problem)
            moving = moving_velocity(self.model.scene.time.theta, start.velocity, solution.node_velocity)
            missed = self._prediction.missed(moving, self._rigid.moving_velocity(solution.rigid_velocity))
            if missed is None or self._divergence_check.is_torn(start.position + self.model.scene.time.step * moving):
                break
            if searches == MOST_SEARCHES:
                self._warn_of_missed(start, missed)
                break
            contacts, searches = self._prediction.find_farther(missed), searches + 1
            if contacts is not None:
                self._begin_motion(start, requests)
        return problem, solution

    def _request(self, start: State) -> ActuatorRequests:  # a phase of its own in profiles
        return request(self.model, start, self._geometry)

    def _warn_of_missed(self, start: State, missed: np.ndarray) -> None:
        """Warn of bodies that may have met unseen, once of each two."""
        for pair in np.argwhere(np.triu(missed)).tolist():
            if tuple(pair) not in self._warned:
                self._warned.add(tuple(pair))
                first, second = (self.model.body_names[number] for number in pair)
                time = start.step * self.model.scene.time.step
                warn_caller(
                    f"step {start.step} at {time:.4g} s: '{first}' and '{second}' may have gone into each other: they "
                    f"bend so much that {MOST_SEARCHES} searches found ever new contacts; take a shorter time.step"
                )

    def _begin_motion(self, start: State, requests: ActuatorRequests) -> None:
        if self._soft is not None:
            self._soft.begin(start, requests.load)
        self._rigid.begin(start)

    def _integrate(
        self,
        start: State,
        solution: StepSolution,
        shift: Shift | None,
        reported: ReportedContacts,
    ) -> State:
        """The state at the end of the step, where the mean of the velocities before and after it leads."""
        time_step, velocity = self.model.scene.time.step, solution.rigid_velocity
        moving = moving_velocity(self.model.scene.time.theta, start.velocity, solution.node_velocity)
        rigid_moving, velocity = self._rigid.moving_velocity(velocity), self._rigid.end_velocity(velocity)
        node_velocity = moving if self._soft is None else self._soft.end_velocity(moving, solution.node_velocity)
        position = time_step * moving
        position += start.position
        if shift is not None:
            position += time_step * shift.node_velocity
        velocities = (rigid_moving,) if shift is None else (rigid_moving, shift.rigid_velocity)
        rigid_position, rigid_rotation = self._rigid.end_poses(*velocities)
        if self._is_static:
            node_velocity, velocity = np.zeros_like(position), np.zeros_like(velocity)
        # Frames and so pull points have moved already: they are where the requests at the start of a step put them.
        ahead = PosesAhead(position, rigid_position, rigid_rotation)
        anchor_forces = self._frame_wrenches.anchor_forces(start, node_velocity, solution)
        cable_forces = self._frame_wrenches.cable_forces(self._geometry, solution.effort, start.position)
        self._geometry.update(ahead, self.model.placed_pull_points(start))
        if self._ends_linearised:
            cable_forces = self._frame_wrenches.cable_forces(self._geometry, solution.effort, position)
        effort, loss = self.model.actuators.split(solution.effort)
        value, count = self._geometry.value.copy(), int(reported.count[0])
        return start.changed(
            time=(start.step + 1) * time_step,
            step=start.step + 1,
            position=position,
            velocity=node_velocity,
            rigid_position=rigid_position,
            rigid_rotation=rigid_rotation,
            rigid_velocity=velocity[:, :3].copy(),
            rigid_angular_velocity=velocity[:, 3:].copy(),
            frame_wrench=self._frame_wrenches.find(
                start,
                self.state.frame_pose,
                position,
                node_velocity,
                solution,
                cable_forces,
                anchor_forces,
                self._rigid.carried,
            ),
            actuator_effort=effort,
            actuator_value=value,
            actuator_loss=loss,
            **self.model.actuators.after(start, effort, value, time_step),
            contact_body_pair=reported.bodies[:count].copy(),
            contact_point=reported.point[:count].copy(),
            contact_normal=reported.normal[:count].copy(),
            contact_impulse=reported.impulse[:count].copy(),
            contact_slip=reported.slip[:count].copy(),
        )

    def _imbalance_of(
        self, start: State, end: State, solution: StepSolution, gradient: np.ndarray
    ) -> Callable[[], dict[str, float]]:
        """The function that finds the imbalance of a step, with the actuators' gradients at its start."""
        if self._ends_linearised:
            gradient = self._geometry.gradient.soft.copy()

        def find() -> dict[str, float]:
            if self._imbalance is None:  # few look at it, and then not in every step
                self._imbalance = Imbalance(self.model)
            return self._imbalance.find(start, end.position, solution, gradient)

        return find

    def _make_report(
        self,
        problem: StepProblem,
        solution: StepSolution,
        shift: Shift | None,
        end: State,
        control: Control,
        find_imbalance: Callable[[], dict[str, float]],
        started: float,
    ) -> StepReport:
        settings, names, contacts = self.model.scene, self.model.body_names, problem.contacts
        deepest = contacts.deepest
        residual = solution.residual if shift is None else max(solution.residual, shift.residual)
        missed = solution.newton_residual or 0.0
        return StepReport(
            step=end.step - 1,
            time=end.time,
            contact_points=end.contact_point,
            contact_forces=end.contact_impulse / settings.time.step,
            contact_bodies=end.contact_body_pair,
            body_names=names,
            max_penetration=contacts.depth,
            iterations=solution.iterations + (shift.iterations if shift is not None else 0),
            residual=residual,
            converged=residual < settings.contact.tolerance and missed <= settings.time.newton_tolerance,
            signals=dict(control.signals),
            step_time=time.perf_counter() - started,
            observe=partial(self._observer.observe, end),
            deepest=(names[deepest[0]], names[deepest[1]]) if deepest else None,
            inverted_elements=self._divergence_check.inverted,
            linearisations=solution.linearisations,
            newton_residual=solution.newton_residual,
            find_imbalance=find_imbalance,
            find_stretch=partial(self.strain_watch.over_law, end),
        )
