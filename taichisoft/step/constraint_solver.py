"""The solver of a step's constraint problem: contacts and actuators, solved together."""

import math
from dataclasses import replace

import numpy as np

from taichisoft.base.processes import stop_if_asked
from taichisoft.contact.constraint_rows import GROWTH, TELLING, ConstraintRows, FollowedLaw
from taichisoft.contact.contact_solver import Impacts, load_stages
from taichisoft.contact.detection import NO_CONTACTS, ContactReduction, ContactTable
from taichisoft.contact.kernels import row_velocities
from taichisoft.contact.kernels import separation as kernels
from taichisoft.contact.kernels.constraint_problem import ReportedContacts, report_contacts
from taichisoft.contact.kernels.row_compliance import lay_out_columns, soft_compliance, soft_compliance_serially
from taichisoft.contact.kernels.row_velocities import PairLaws
from taichisoft.contact.kernels.separation import renew_rows
from taichisoft.contact.model import Model
from taichisoft.mechanics.kernels.actuator_coordinates import Coordinates, Gradient
from taichisoft.mechanics.kernels.rigid_integration import RigidState
from taichisoft.mechanics.kernels.sparse_columns import GROUP
from taichisoft.mechanics.state import State
from taichisoft.runtime.language import THREADS
from taichisoft.step.points_of_step import PointsOfStep
from taichisoft.step.rigid_motion import RigidMotion
from taichisoft.step.soft_motion import SoftMotion
from taichisoft.step.solution import Shift, StepProblem, StepSolution, moving_velocity

# Free velocities and compliance matrix of the constraint rows.

# Rows times non-zeros of the factor; less than about 0.5 ms of work does not justify waking threads.
SMALL_COMPLIANCE = 30e6
NO_VELOCITY = np.zeros((0, 3))


def assemble_compliance(
    problem: ConstraintRows,
    coordinates: Coordinates,
    gradient: Gradient,
    own_compliances: tuple[tuple[int, np.ndarray], ...],
    soft: SoftMotion | None,
    rigid: RigidState,
) -> None:
    """Fill in the rows' velocities without impulses, and W of soft bodies, rigid bodies and actuators."""
    rows, w = problem.rows, problem.compliance
    contact_count, row_count, moment_count = problem.contact_count, problem.row_count, problem.moment_count
    actuator_count = row_count - 3 * (contact_count + moment_count)
    known_velocity = soft.known_velocity if soft is not None else NO_VELOCITY
    if contact_count:
        row_velocities.free_contact_velocity(rows, known_velocity, rigid)
    if actuator_count:
        row_velocities.free_actuator_velocity(rows, coordinates, gradient, known_velocity, rigid)
    if soft is not None and row_count:
        _assemble_soft_compliance(row_count, problem, coordinates, gradient, soft)
    else:
        w[: row_count**2] = 0.0
    if contact_count:
        row_velocities.add_rigid_compliance(row_count, rows, rigid, w)
    if actuator_count:
        square = w[: row_count**2].reshape(row_count, row_count)
        for row, own in own_compliances:
            place = slice(3 * contact_count + row, 3 * contact_count + row + len(own))
            square[place, place] += own
        if len(gradient.rigid):
            row_velocities.add_rigid_actuator_compliance(rows, coordinates, gradient, rigid, w)
    if moment_count:
        row_velocities.free_moment_velocity(rows, rigid)
        row_velocities.add_moment_compliance(row_count, rows, coordinates, gradient, rigid, w)


def _assemble_soft_compliance(
    row_count: int, problem: ConstraintRows, coordinates: Coordinates, gradient: Gradient, soft: SoftMotion
) -> None:
    """Fill in W of the soft bodies, and the effect of their forces on the rows' velocities."""
    solver, rows = soft.system.solver, problem.rows
    symbolic = solver.symbolic
    if row_count * symbolic.factor_entries < SMALL_COMPLIANCE:
        # The largest possible size is small here, and allocating it saves a launch.
        assemble, workers, entries = soft_compliance_serially, 1, -(-row_count // GROUP) * 3 * len(symbolic.order)
    else:
        lay_out_columns(rows, coordinates, soft.system.modes, symbolic.tree, symbolic.fronts, problem.columns)
        assemble, workers, entries = soft_compliance, THREADS, int(problem.columns.size[0])
    problem.make_room_for_columns(entries)
    columns = problem.columns
    columns.progress[:] = 0
    tree, fronts, w = symbolic.tree, symbolic.fronts, problem.compliance
    modes, factor, begun = soft.system.modes, solver.factor, solver.begun
    assemble(rows, coordinates, gradient, modes, tree, fronts, factor, columns, begun, w, workers, 1)


# The active set: contacts that take part in the constraint problem of a step.
#
# Most contacts found stay open: in a grasp five of six, on a finely triangulated ball nearly all. Their compliance rows
# cost as much as others, and only give inequalities that hold. So the problem is solved with the contacts that pushed
# in the last step or are expected to push; then the motion is checked against all other contacts, and if some would
# close, the problem is solved again with the worst of each neighbourhood. The result keeps all contacts apart, whatever
# the initial choice (constraint generation).

# Most times that the rows of a step are renewed, usually two, and how often for contacts that are lifted.
MOST_RENEWALS, MOST_LOWERINGS = 40, 10


class ActiveSet:
    """Measures the separation of the contacts of a step, and chooses the contacts that take part.

    Attributes:
        table: the contacts of the step.
        resting_speed: approach without restitution, the change of speed by gravity in a step [mm/s].
    """

    def __init__(self, model: Model, rigid: RigidState, points: PointsOfStep):
        """Prepare for the bodies of `model`, with the rigid bodies in `rigid` and nodes in `points`."""
        settings = model.scene.contact
        self._surfaces, self._rigid, self._first_rigid = model.surfaces, rigid, len(model.soft_bodies)
        self._time_step, self._tolerance = model.scene.time.step, settings.tolerance
        self._reduction = ContactReduction(model.surfaces.body_size, settings.spacing, settings.contact_distance)
        self._terms = terms = np.zeros(kernels.TERM_COUNT)
        terms[kernels.TIME_STEP], terms[kernels.CONTACT_DISTANCE] = model.scene.time.step, settings.contact_distance
        terms[kernels.TOLERANCE], terms[kernels.KEEPS_DEPTH] = settings.tolerance, settings.depth == "position"
        terms[kernels.HAS_RESTITUTION], terms[kernels.THETA] = model.restitution.any(), model.scene.time.theta
        self._follows_turns = model.scene.time.theta == 1.0
        self._violated_count, self._missed = np.zeros(1, dtype=np.int32), np.zeros(1)
        self._points = points
        self.table, self.resting_speed, self._renewals = NO_CONTACTS, 0.0, 0

    def begin(self, table: ContactTable, state: State) -> None:
        """Choose the contacts that are expected to push; the rigid bodies have the velocities of the start."""
        self.table, self._renewals = table, 0
        self._points.begin(state)
        self._reduction.begin(table, state)
        kernels.begin_separation(
            self._first_rigid,
            self._terms,
            table.found,
            table.fraction,
            self._surfaces.gap_tolerance,
            self._surfaces.vertex_is_round,
            self._surfaces.carriers,
            self._points.node_velocity,
            self._rigid,
            table.separation,
            table.choice,
        )
        self.resting_speed = max(self._tolerance, self._time_step * math.sqrt(state.gravity @ state.gravity))
        self._reduction.add_wanted(table, beside=False)

    def add_violated(self, node_velocity: np.ndarray) -> bool:
        """Add contacts that close with these node velocities [mm/s] and the rigid bodies' own; True if any.

        Where that turns bodies so far that a gap is another than its row's, the row is renewed, which counts as well.
        """
        self._find_violated(node_velocity)
        self._missed[0] = 0.0
        if self._violated_count[0] and self._reduction.add_wanted(self.table, beside=True):
            return True  # rows are renewed for a motion of all contacts: what turns about some of them does not
        if not (self._follows_turns and np.count_nonzero(self._rigid.angular)):
            return False
        self._terms[kernels.MAY_LIFT] = self._renewals >= MOST_LOWERINGS
        renew_rows(
            self._first_rigid,
            self._terms,
            self.table.found,
            self._surfaces.vertex_is_round,
            self._surfaces.carriers,
            self._points.node_before,
            node_velocity,
            self._rigid,
            self.table.separation,
            self.table.choice,
            self._violated_count,
            self._missed,
        )
        added = bool(self._violated_count[0]) and self._reduction.add_wanted(self.table, beside=True)
        self._renewals += bool(self._missed[0])
        return added or (self.missed > 0.0 and self._renewals < MOST_RENEWALS)

    @property
    def missed(self) -> float:
        """Largest velocity by which a gap at the end of the step is another than its row's [mm/s]."""
        return float(self._missed[0]) / self._time_step

    def add_deep(self, moving: np.ndarray | None) -> bool:
        """Add contacts that overlap at the end of the step; True if any.

        Args:
            moving: velocities along which the step moves the nodes, and the rigid bodies have theirs, where these are
                not the velocities after it [mm/s], shape (node_count, 3); else None.
        """
        if moving is not None:
            self._find_violated(moving)
            self.table.gap[:] -= self._time_step * self.table.separation.unhurried[: self.table.contact_count]
        gap = self.table.gap
        deep = gap < self._deepest_left
        if not np.count_nonzero(deep):
            return False
        self._reduction.add(self.table, deep, gap, beside=True)
        return True

    def add_left_deep(self, node_velocity: np.ndarray) -> bool:
        """Add contacts that overlap after a shift by these node velocities [mm/s] and the rigid bodies' own."""
        gap = self.table.gap.copy()
        self._find_violated(node_velocity)
        left = gap + self._time_step * self.table.separation.speed[: self.table.contact_count]
        added = self._reduction.add(self.table, left < self._deepest_left, left, beside=True)
        self.table.gap[:] = gap
        return added

    @property
    def _deepest_left(self) -> np.ndarray:
        """Gap of each contact below which it is an overlap to remove [mm], shape (contact_count,).

        A contact at the depth `touching` counts as an overlap, on whichever side of it the solver's tolerance leaves
        the contact: when round-off decided, the final speed of a rolling ball varied by 0.5 % between runs.
        """
        return self._time_step * self._tolerance - self.table.separation.touching[: self.table.contact_count]

    def _find_violated(self, node_velocity: np.ndarray) -> None:
        kernels.find_violated(
            self._first_rigid,
            self._terms,
            self.table.found,
            self._surfaces.carriers,
            node_velocity,
            self._rigid,
            self.table.separation,
            self.table.choice,
            self._violated_count,
        )


FIRST_CAPACITY = 16
# Most tangents to the law of actuators in a solve; usually three.
MOST_TANGENTS = 40


class ConstraintSolver:
    """Finds impulses such that velocities after the step obey contact, friction and actuators.

    The velocity of each row after the step is v = free + W impulse. A contact has three rows: normal (velocity plus
    gap / h, at least 0), and two tangents. An actuator whose effort is not a known load has one row: the rate of its
    coordinate less the rate that reaches its target at the end of the step. With spinning and rolling friction of rigid
    bodies, a contact has three more rows, of moments.
    """

    def __init__(self, model: Model, soft: SoftMotion | None, rigid: RigidMotion, points: PointsOfStep):
        """Allocate the work space, and load the kernels of the contact solver if bodies may touch."""
        self._model, self._soft, self._rigid = model, soft, rigid
        self._time_step, self._settings = model.scene.time.step, model.scene.contact
        self._active_set = ActiveSet(model, rigid.state, points)
        self._has_restitution = bool(model.restitution.any())
        self._impacts = Impacts(self._settings.tolerance, self._settings.max_iterations)
        if model.surfaces.may_touch.any():
            load_stages()
        self._rows = ConstraintRows(model, FIRST_CAPACITY)
        self._laws = PairLaws(model.friction.copy(), model.spinning_friction, model.rolling_friction)
        self._reported = ReportedContacts.with_room(0, len(model.body_names))
        # Arrays of kernels are reused.
        self._velocity = np.zeros((model.node_count, 3))
        self._velocity_before = np.zeros((model.node_count, 3))
        self._node_impulse = np.zeros((model.node_count, 3))
        self._contact_node_impulse = np.zeros((model.node_count, 3))

    @property
    def rows(self) -> ConstraintRows:
        """The rows that were last solved for."""
        return self._rows

    def set_friction(self, model: Model) -> None:
        """Set the friction coefficients of a variant of the model."""
        self._laws.friction[:] = model.friction

    def solve(self, problem: StepProblem, start: StepSolution | None = None) -> StepSolution:
        """Find the impulses, and the velocities of all bodies with them.

        Contacts that are expected to stay open are excluded at first, see `active_set`.

        Args:
            problem: contacts and actuators of the step.
            start: a solution of this step with another linearisation, whose impulses and contacts are the initial
                guess; None: the impulses of the last step are.
        """
        if not problem.contacts.contact_count and not len(problem.requests.coordinates):
            self._rows.rows.size[:] = 0
            self._rows.count_rows()
            return self._solution(problem, self._velocities_after(problem), 0)
        if start is None:
            self._active_set.begin(problem.contacts, problem.start)
        else:
            problem.contacts.impulse[:] = start.contact_impulse
        iterations = 0
        while True:
            stop_if_asked()
            self._build_rows(problem)
            self._assemble_compliance(problem)
            problem, sweeps = self._find_impulses(problem, self._strike(problem))
            iterations += sweeps
            self._velocity[:] = node_velocity = self._velocities_after(problem)
            if not self._active_set.add_violated(self._velocity):
                return self._solution(problem, node_velocity, iterations)

    def report(self, problem: StepProblem, solution: StepSolution) -> ReportedContacts:
        """Contacts that took part, and the closest contact of other bodies near each other."""
        table, reported = problem.contacts, self._reported
        if not table.contact_count:
            reported.count[0] = 0
            return reported
        if len(table.impulse) > len(reported.slip):
            reported = self._reported = ReportedContacts.with_room(len(table.impulse), len(self._model.body_names))
        table.impulse[:] = solution.contact_impulse
        alarm_distance = self._settings.alarm_distance
        report_contacts(alarm_distance, table.found, table.choice, table.impulse, self._rows.solver.answer, reported)
        return reported

    def find_shift(self, problem: StepProblem, solution: StepSolution) -> Shift | None:
        """Find velocities that separate overlapping bodies at the end of the step (split impulses), or None.

        Solved with the same compliance, without friction and actuators: u_n >= -gap / h with the gap at the end of the
        step (Cline and Pai 2003, Post-stabilization for rigid body simulation with contact and constraints). The free
        motion of the bodies is overwritten.
        """
        table, rigid, theta = problem.contacts, self._rigid, self._model.scene.time.theta
        if self._settings.depth != "position" or not table.contact_count:
            return None
        moving = None
        if theta < 1.0:
            moving = moving_velocity(theta, problem.start.velocity, solution.node_velocity)
            rigid.state.linear[:], rigid.state.angular[:] = np.hsplit(rigid.moving_velocity(solution.rigid_velocity), 2)
        if not self._active_set.add_deep(moving):
            return None
        rigid.state.free[:] = 0.0
        if self._soft is not None:
            self._soft.leave_out_forces()
        iterations, residual = 0, 0.0
        while True:
            stop_if_asked()
            self._build_rows(problem, with_actuators=False)
            rows, count, solver = self._rows.rows, self._rows.contact_count, self._rows.solver
            self._assemble_compliance(problem)
            rows.friction[:count], rows.moment_length[:] = 0.0, 0.0
            rows.free[: 3 * count] = 0.0
            rows.free[: 3 * count : 3] = table.gap[rows.contact[:count]] / self._time_step
            solver.impulse[: self._rows.row_count] = 0.0
            solver.solve(self._settings.tolerance, self._settings.max_iterations)
            iterations, residual = iterations + solver.iterations, max(residual, solver.residual)
            self._velocity[:] = node_velocity = self._velocities_after(problem)
            if not self._active_set.add_left_deep(self._velocity):
                return Shift(node_velocity, rigid.velocity, iterations, residual)

    def _build_rows(self, problem: StepProblem, with_actuators: bool = True) -> None:
        """Find the nodes and bodies on which the rows of the chosen contacts and of the actuators act."""
        table, requests, count = problem.contacts, problem.requests, problem.contacts.chosen_count
        if count > self._rows.contact_capacity:
            self._rows.release()
            self._rows = ConstraintRows(self._model, int(GROWTH * count))
        rows = self._rows.rows
        actuator_count = len(requests.coordinates) if with_actuators else 0
        rows.size[:] = count, actuator_count, 0
        if actuator_count:
            rows.coordinate[:actuator_count] = requests.coordinates
            rows.target_rate[:actuator_count] = requests.target_rate
            self._rows.bounds[:actuator_count] = requests.bounds
        if count:
            row_velocities.build_rows(
                len(self._model.soft_bodies),
                table.found,
                table.choice,
                table.separation,
                self._model.surfaces.carriers,
                self._laws,
                self._rigid.state,
                table.impulse,
                rows,
                self._rows.solver.impulse,
            )
        self._rows.count_rows()

    def _assemble_compliance(self, problem: StepProblem) -> None:
        coordinates, gradient = self._model.actuators.coordinates, problem.geometry.gradient
        compliances = problem.requests.compliances
        assemble_compliance(self._rows, coordinates, gradient, compliances, self._soft, self._rigid.state)

    def _strike(self, problem: StepProblem) -> np.ndarray | None:
        """Impulses of impacts with restitution, the initial guess of the contacts; None without impacts."""
        count, rows, rigid = self._rows.contact_count, self._rows.rows, self._rigid.state
        if not self._has_restitution or not count:
            return None
        bodies = problem.contacts.found.bodies[rows.contact[:count]]
        restitution = self._model.restitution[tuple(bodies.T)]
        if not restitution.any():
            return None
        end, row_count = 3 * count, self._rows.row_count
        free, free_motion = rows.free[:end].copy(), rigid.free.copy()
        self._velocity_before[:] = problem.start.velocity
        rigid.free[:] = np.hstack([problem.start.rigid_velocity, problem.start.rigid_angular_velocity])
        row_velocities.free_contact_velocity(rows, self._velocity_before, rigid)
        before = rows.free[:end].copy()
        before[::3] -= rows.gap_rate[:count]
        rigid.free[:], rows.free[:end] = free_motion, free
        compliance = self._rows.compliance[: row_count**2].reshape(row_count, row_count)
        pair = bodies[:, 0] * len(self._model.body_names) + bodies[:, 1]
        touching = self._model.surfaces.gap_tolerance[tuple(bodies.T)] / self._time_step
        slowest = self._active_set.resting_speed
        strike = self._impacts.find(
            compliance[:end, :end], before, free, touching, pair, restitution, rows.friction[:count], slowest
        )
        rows.free[:row_count] += compliance[:, :end] @ strike
        return strike

    def _find_impulses(self, problem: StepProblem, strike: np.ndarray | None) -> tuple[StepProblem, int]:
        """Solve for the impulses of the rows, with the law of actuators followed to where it holds.

        The initial guess are the impulses of the last step, or of the solution with fewer contacts.

        Returns:
            The problem with the lines that stand for the law there, and the number of iterations.
        """
        solver, rows = self._rows.solver, self._rows
        if not rows.row_count:
            solver.residual = 0.0
            return problem, 0
        solver.impulse[rows.actuators] = problem.requests.first_impulse
        solver.impulse[rows.actuators.stop : rows.row_count] = 0.0  # moments
        solver.solve(self._settings.tolerance, self._settings.max_iterations)
        iterations = solver.iterations
        if problem.requests.law is not None:
            problem, iterations = self._follow_law(problem, problem.requests.law)
        # The deformation of soft bodies determines the impulses of their contacts.
        on_rigid = int(rows.rows.on_rigid_count[0]) if rows.contact_count else 0
        solver.choose_smallest(rows.rows.on_rigid[:on_rigid], self._settings.tolerance)
        if strike is not None:
            solver.impulse[: len(strike)] += strike
        return problem, iterations

    def _follow_law(self, problem: StepProblem, law: FollowedLaw) -> tuple[StepProblem, int]:
        """Solve again until the law of actuators holds; what is left counts as residual of the solver."""
        solver, rows, time, time_step = self._rows.solver, self._rows, self._model.scene.time, self._time_step
        iterations, row_count = solver.iterations, self._rows.row_count
        compliance = rows.compliance[: row_count**2].reshape(row_count, row_count)
        own = np.ix_(rows.actuators.start + law.rows, rows.actuators.start + law.rows)
        bodies, last, last_line = time.stage**2 * compliance[own] + law.slope, None, np.zeros(0)
        for _ in range(MOST_TANGENTS):
            before = problem.requests
            impulse = solver.impulse[rows.actuators].copy()
            effort = impulse[law.rows] / time_step
            law = law.measured(effort)
            if law.holds:
                return problem, iterations
            line = law.line(effort)
            if last is not None and np.abs(effort - last).max() > TELLING * np.abs(effort).max():
                change = effort - last
                bodies += np.outer(line - last_line - bodies @ change, change) / (change @ change)
            last, last_line = effort, line
            slope, law = law.slope, law.next(effort, bodies)
            requests = replace(before.following(law, time), first_impulse=impulse)
            problem = replace(problem, requests=requests)
            rows.rows.free[rows.actuators] -= requests.target_rate - before.target_rate
            compliance[own] += (slope - law.slope) / time.stage**2
            solver.solve(self._settings.tolerance, self._settings.max_iterations)
            iterations += solver.iterations
        missed = law.missed * float(law.law.scale.max())
        solver.residual = max(solver.residual, missed / time_step)
        return problem, iterations

    def _velocities_after(self, problem: StepProblem) -> np.ndarray:
        """Apply the impulses to the rigid bodies; returns the velocities of the soft nodes [mm/s]."""
        rows = self._rows
        if rows.row_count:
            row_velocities.apply_impulses(
                rows.rows,
                self._model.actuators.coordinates,
                problem.geometry.gradient,
                rows.solver.impulse,
                problem.contacts.impulse,
                self._contact_node_impulse,
                self._node_impulse,
                self._rigid.state,
            )
            if rows.moment_count:
                row_velocities.apply_moments(rows.rows, rows.solver.impulse, self._rigid.state)
        self._rigid.apply_impulses()
        if self._soft is None:
            return self._velocity.copy()
        return self._complete(self._soft)

    def _complete(self, soft: SoftMotion) -> np.ndarray:
        """Velocities of the soft nodes after the impulses [mm/s]; with few rows L^-1 J^T is already known."""
        rows, columns = self._rows, self._rows.columns
        if rows.row_count and GROUP * int(columns.size[0]) > soft.system.solver.symbolic.factor_entries:
            return soft.complete_with(self._node_impulse)
        return soft.complete(columns, rows.solver.impulse, rows.row_count)

    def _solution(self, problem: StepProblem, node_velocity: np.ndarray, iterations: int) -> StepSolution:
        rows, solver, rigid = self._rows, self._rows.solver, self._rigid
        acts = rows.row_count > 0
        if not acts:
            self._node_impulse[:] = self._contact_node_impulse[:] = 0.0
        return StepSolution(
            node_velocity=node_velocity,
            node_impulse=self._node_impulse.copy(),
            contact_node_impulse=self._contact_node_impulse.copy(),
            rigid_velocity=rigid.velocity,
            rigid_impulse=rigid.state.impulse.copy(),
            contact_impulse=problem.contacts.impulse.copy(),
            effort=problem.requests.efforts(solver.impulse[rows.actuators], self._time_step),
            iterations=iterations,
            residual=max(solver.residual, self._active_set.missed) if acts else 0.0,
        )
