"""How the end of a step moves with what acts in it, by the factor of the step."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse.linalg as sparse_linalg

from taichisoft.contact.constraint_rows import ActuatorRequests, request
from taichisoft.contact.kernels.constraint_problem import GRIP
from taichisoft.contact.model import Model
from taichisoft.errors import SceneError
from taichisoft.mechanics.model_actuators import ActuatorGeometry
from taichisoft.mechanics.state import State
from taichisoft.step.constraint_solver import ConstraintSolver
from taichisoft.step.nonlinear_step import NonlinearStep
from taichisoft.step.rigid_motion import RigidMotion
from taichisoft.step.row_conditions import AT_BOUND, find_conditions, find_jacobians, find_turning_rows
from taichisoft.step.soft_motion import SoftMotion
from taichisoft.step.solution import Shift, StepProblem, StepSolution

ACCURACY = 1e-11
"""Residual of the equations of a derivative over their right-hand side [-]."""
MOST_DIRECTIONS = 200
"""Most directions in which their solution is sought."""
WEIGHTLESS = 1e6
"""Factor of the inverse masses of rigid bodies in the derivative of an equilibrium [-]."""
LEFT_BY_SOLVERS = 10.0
"""Most that solvers leave of a contact's velocity, over their tolerance [-]."""
ROUND_OFF = 1e-9
"""Change of an impulse or a speed over the largest one that counts as none [-]."""
SMALL_MOVE = 1e-4
"""Largest move of a node in a difference of residuals [mm]: its cube and round-off are both below 1e-8 of it."""


@dataclass(frozen=True)
class Causes:
    """What acts in a step at the motion found.

    Attributes:
        node_impulse: of all forces but contacts on the nodes [mN s], shape (node_count, 3).
        rigid_velocity: of the rigid bodies without contacts, shape (rigid_count, 6).
        row_velocity: velocities of the actuators' rows at this motion, 0 of contacts, shape (row_count,).
        bounds: of the actuators' rows, shape (actuator_count, 6).
        load: known efforts, shape (coordinate_count,).
    """

    node_impulse: np.ndarray
    rigid_velocity: np.ndarray
    row_velocity: np.ndarray
    bounds: np.ndarray
    load: np.ndarray

    def difference(self, other: "Causes", share: float) -> "Causes":
        """This less the other, times a share."""
        pairs = zip(vars(self).values(), vars(other).values(), strict=True)
        return Causes(*(share * (here - there) for here, there in pairs))


@dataclass(frozen=True)
class Motion:
    """Changes of the velocities of nodes, (node_count, 3), and rigid bodies, (rigid_count, 6), and of impulses."""

    node_velocity: np.ndarray
    rigid_velocity: np.ndarray
    impulse: np.ndarray

    def velocities(self) -> np.ndarray:
        """All velocities, shape (3 node_count + 6 rigid_count,)."""
        return np.concatenate([self.node_velocity.ravel(), self.rigid_velocity.ravel()])


@dataclass(frozen=True)
class Multipliers:
    """Derivatives of a number by what acts in a step, as `Causes` has it, at the motion that follows.

    Attributes:
        node, rigid, row, bounds: by `node_impulse`, `rigid_velocity`, `row_velocity` of all rows, and `bounds`.
        condition: by the right-hand sides of the conditions of all rows, shape (row_count,).
        velocity: by velocities of the nodes that no force changes, shape (node_count, 3).
    """

    node: np.ndarray
    rigid: np.ndarray
    row: np.ndarray
    bounds: np.ndarray
    condition: np.ndarray
    velocity: np.ndarray


@dataclass(frozen=True)
class Edge:
    """A contact at a change of what it does, on which side is below what the solver tells.

    Attributes:
        bodies: names of its two bodies.
        point: where it is [mm], shape (3,).
        between: "open and pressing" or "sticking and sliding".
    """

    bodies: tuple[str, ...]
    point: np.ndarray
    between: str


@dataclass(frozen=True)
class _Contact:
    """A contact's normal and friction impulses, the most friction that it can have [mN s], and whether it has that."""

    normal: float
    friction: float
    most: float
    slides: bool

    @property
    def is_open(self) -> bool:
        return not self.normal > 0.0


class StepDerivative:
    """Linearises a solved step: contacts stay open, sticking or sliding, and actuators at their bounds.

    Where a step is a single linearisation its equations are linear in what acts, and a solution with the factor is the
    derivative. Where it solves the nonlinear equations, the factor is not their exact slope: GMRES (Saad and Schultz
    1986) solves with the slope, whose products are differences of forces, and with the factor as preconditioner.

    Attributes:
        start: state at the start of the step, with its requests.
        shift: what separates overlapping bodies at the end of the step, or None.
        geometry: geometry of the actuators at the place of the linearisation.
        problem, solution: the solved step.
        rigid: motion of the rigid bodies, shared with the stepper.
        contacts, contact_count: numbers of the contacts that have rows, and how many.
        basis: normal and tangents of these contacts, as rows, shape (contact_count, 3, 3).
        impulse: of all rows, the contacts' first [mN s, of a volume kPa s], shape (row_count,).
        coordinates: those of the actuators with rows.
        inverse_mass: of the rigid bodies [1/kg] and [1/(kg mm^2)], shape (rigid_count, 6, 6).
        time_step: h [s].
        is_nonlinear: whether the step solves the nonlinear equations.
        known_velocity: of the nodes, to which forces add in a single linearisation, shape (node_count, 3).
        reduced: the reduced bodies in the step; None without any.
    """

    def __init__(
        self,
        model: Model,
        soft: SoftMotion | None,
        rigid: RigidMotion,
        constraint_solver: ConstraintSolver,
        solver: ConstraintSolver | NonlinearStep,
        problem: StepProblem,
        solution: StepSolution,
        shift: Shift | None,
    ):
        """Linearise the step whose `problem` the solvers have just solved; the `shift` stays as it is."""
        self._model, self._soft, self.rigid = model, soft, rigid
        self.time_step, self.problem, self.solution = model.scene.time.step, problem, solution
        self._nonlinear = solver if isinstance(solver, NonlinearStep) else None
        self.is_nonlinear = self._nonlinear is not None
        self.known_velocity = problem.start.velocity if soft is None else soft.known_velocity.copy()
        self.reduced = None if soft is None else soft.system.reduced
        self.geometry: ActuatorGeometry = problem.geometry
        if self._nonlinear is not None:
            reduced = [body.name for body in model.soft_bodies if body.modes is not None]
            if reduced:
                raise SceneError(
                    f"linearise: soft_bodies.{reduced[0]}.reduced has no derivative in equilibria, or with time.newton "
                    "above 1; leave one of them out"
                )
            self._nonlinear.linearise_at(solution, problem.requests.load)
            self.geometry = self._nonlinear.geometry
        rows = constraint_solver.rows
        contacts, self.contact_count = rows.rows.contact[: rows.contact_count], rows.contact_count
        if rows.moment_count or (rows.contact_count and model.restitution.any()):
            raise SceneError(
                "linearise: contacts with restitution, rolling_friction or spinning_friction have no derivative here; "
                "leave these keys of the scene's [contact] out"
            )
        self.contacts, self.basis = contacts.copy(), rows.rows.basis[: rows.contact_count].copy()
        self.coordinates = problem.requests.coordinates
        local = np.einsum("cij,cj->ci", self.basis, solution.contact_impulse[contacts]).ravel()
        self.impulse = np.concatenate([local, solution.effort[self.coordinates] * self.time_step])
        causes = self.causes(problem.start)  # measures the actuators where they are linearised
        self._of_soft, self._of_rigid = find_jacobians(
            rows, model.actuators.coordinates, self.geometry.gradient, model.node_count, len(model.rigid_bodies)
        )
        self.start, self.shift = problem.start, shift
        self.inverse_mass = inverse_mass = rigid.state.inverse_mass.copy()
        if model.scene.time.dynamics == "static":  # masses slow the search, and do not change an equilibrium
            inverse_mass *= WEIGHTLESS
        own_response = np.einsum(
            "bij,rbj->bir", inverse_mass, self._of_rigid.reshape(len(self.impulse), len(inverse_mass), 6)
        ).reshape(self._of_rigid.shape[::-1])
        self._rigid_response, self._of_turning = own_response, self._of_rigid
        self._turning: np.ndarray = np.eye(len(own_response))
        self.turning_rows = find_turning_rows(model, problem, solution, self.contacts, self.basis, rigid.state)
        if self.turning_rows.renewed.any():
            self._add_turning(inverse_mass)
        self._own = self._own_compliance(self._requests)
        velocity = self._of_soft @ solution.node_velocity.ravel() + self._of_rigid @ solution.rigid_velocity.ravel()
        velocity[3 * self.contact_count :] = causes.row_velocity[3 * self.contact_count :]
        self._friction = rows.rows.friction[: rows.contact_count].copy()
        self._conditions = find_conditions(self._friction, causes.bounds, self.impulse, velocity)
        count = rows.row_count
        self._solved_compliance = rows.compliance[: count**2].reshape(count, count).copy()
        if self._of_turning is not self._of_rigid:
            self._solved_compliance += self._of_turning @ self._rigid_response - self._of_rigid @ own_response
        self._speed = rows.solver.velocity[: 3 * self.contact_count].copy()
        self._bodies = problem.contacts.found.bodies[contacts].copy()
        self._point = problem.contacts.found.points[contacts].mean(axis=1)

    def _add_turning(self, inverse_mass: np.ndarray) -> None:
        """Let rows and impulses turn with the bodies: w = dw + M^-1 (J^T l + T w), and rows have (J + E) w."""
        turning, count = self.turning_rows, 6 * len(inverse_mass)
        coupled = np.zeros((len(inverse_mass), 6, 6))
        coupled[:, :, 3:] = inverse_mass[:, :, 3:] @ turning.torque
        matrix = np.eye(count)
        for body, block in enumerate(coupled):
            own = slice(6 * body, 6 * body + 6)
            matrix[own, own] -= block
        self._turning = np.linalg.inv(matrix)
        self._rigid_response = self._turning @ self._rigid_response
        self._of_turning = self._of_rigid.copy()
        self._of_turning[: 3 * self.contact_count] += turning.of_rigid.reshape(-1, count)

    @cached_property
    def _row_response(self) -> np.ndarray:
        """Change of the velocities of the nodes by a unit impulse in each row, shape (row_count, 3 node_count)."""
        response = np.array([self._response(row) for row in self._of_soft.toarray()])
        return response.reshape(self._of_soft.shape)

    @cached_property
    def _compliance(self) -> np.ndarray:
        of_bodies: np.ndarray = self._of_soft @ self._row_response.T + self._of_turning @ self._rigid_response
        return of_bodies + self._own

    def causes(self, start: State) -> Causes:
        """What acts at the motion found, in a step from the same bodies with other requests or frames elsewhere."""
        self.rigid.begin(start)
        time_step, solution, first = self.time_step, self.solution, 3 * self.contact_count
        time = self._model.scene.time
        impulse = self.impulse[first:]
        effort = solution.effort.copy()
        if self._nonlinear is None:
            requests = request(self._model, start, self.geometry)
            requests = requests.tangent(impulse, time)
        else:
            requests = request(self._model, start, self.problem.geometry)
            poses = self.rigid.end_poses(solution.rigid_velocity)
            self._nonlinear.equations.move(solution.node_velocity, *poses, frames=start)
            rates = self.geometry.rates(solution.node_velocity, solution.rigid_velocity)
            growth = self.geometry.values() - requests.start_values
            requests = requests.linearised(self.geometry, growth, rates, start, impulse, time).tangent(impulse, time)
        effort = requests.load.copy()
        effort[self.coordinates] = impulse / time_step
        node_impulse = np.zeros((0, 3))
        if self._nonlinear is not None:
            node_impulse = self._nonlinear.equations.residual(effort)
        elif self._soft is not None:
            node_impulse = self._soft.impulses(start, effort)
        self._requests = requests
        shift = np.zeros(len(self.impulse))
        rates = self.geometry.rates(solution.node_velocity, solution.rigid_velocity)
        shift[first:] = rates[self.coordinates] - requests.target_rate
        shift += self._own_compliance(requests) @ self.impulse
        return Causes(node_impulse, self._rigid_by(effort), shift, requests.bounds, requests.load)

    def along(self, change: Causes) -> StepSolution:
        """The change of the solution with a change of what acts, per unit of it."""
        motion = self._solve(change)
        if self._nonlinear is not None:
            self.causes(self.start)  # frames are where they were again
            motion = self._with_exact_slope(motion)
        impulse = motion.impulse
        count, time_step = self.contact_count, self.time_step
        contact_impulse = np.zeros_like(self.solution.contact_impulse)
        world = np.einsum("cij,ci->cj", self.basis, impulse[: 3 * count].reshape(-1, 3))
        contact_impulse[self.contacts] = world
        effort = change.load.copy()
        effort[self.coordinates] = impulse[3 * count :] / time_step
        contact_rows = np.concatenate([impulse[: 3 * count], np.zeros(len(impulse) - 3 * count)])
        shape = self.solution.node_velocity.shape
        return replace(
            self.solution,
            node_velocity=motion.node_velocity,
            node_impulse=(self._of_soft.T @ impulse).reshape(shape),
            contact_node_impulse=(self._of_soft.T @ contact_rows).reshape(shape),
            rigid_velocity=motion.rigid_velocity,
            rigid_impulse=(self._of_rigid.T @ impulse).reshape(-1, 6),
            contact_impulse=contact_impulse,
            effort=effort,
        )

    def multipliers(self, node: np.ndarray, rigid: np.ndarray, impulse: np.ndarray) -> Multipliers:
        """Derivatives by what acts, of those by the velocities and by the impulses of the rows: `along`, transposed.

        What the factor's matrix has too much of the slope is symmetric, but for rows and cables over rigid bodies.
        """
        if self._nonlinear is None:
            return self._multipliers(node, rigid, impulse)
        no_rigid, no_impulse = np.zeros_like(rigid), np.zeros_like(impulse)

        def error(found: np.ndarray) -> np.ndarray:
            return self._slope_error(found.reshape(node.shape), no_rigid).node_impulse

        known = self._multipliers(node, rigid, impulse).node.ravel()
        found = solved(lambda one: self._multipliers(error(one), no_rigid, no_impulse).node.ravel(), known)
        multipliers = self._multipliers(node + error(found), rigid, impulse)
        self.causes(self.start)  # bodies are where they were again
        return multipliers

    def _multipliers(self, node: np.ndarray, rigid: np.ndarray, impulse: np.ndarray) -> Multipliers:
        response = self._response(node)
        of_rows = impulse + self._of_soft @ response + self._rigid_response.T @ rigid.ravel()
        condition = self._conditions.multipliers(of_rows, self._solved_compliance)
        row = -(self._conditions.of_velocity.T @ condition)
        of_row = self._of_soft.T @ row
        of_nodes = response + self._response(of_row)
        of_bounds = self._conditions.of_bounds * condition[3 * self.contact_count :, None]
        of_rigid = (self._turning.T @ (rigid.ravel() + self._of_turning.T @ row)).reshape(rigid.shape)
        of_free = node + of_row.reshape(-1, 3)
        return Multipliers(of_nodes.reshape(-1, 3), of_rigid, row, of_bounds, condition, of_free)

    def edges(self) -> list[Edge]:
        """Contacts that the tolerance of the solver may as well leave on the other side of a change."""
        found, scene = [], self._model.scene
        tolerance = LEFT_BY_SOLVERS * scene.contact.tolerance
        if self._nonlinear is not None:
            tolerance = max(tolerance, LEFT_BY_SOLVERS * scene.time.newton_tolerance / self.time_step)
        compliance = np.diag(self._solved_compliance)[: len(self._speed)].reshape(-1, 3)
        speed = self._speed.reshape(-1, 3)
        for number, contact in enumerate(self.contact_conditions()):
            least = tolerance / compliance[number]
            open_edge = speed[number, 0] < tolerance if contact.is_open else contact.normal < least[0]
            if contact.slides:
                friction_edge = float(np.linalg.norm(speed[number, 1:])) < tolerance
            else:
                friction_edge = contact.most > 0.0 and contact.most - contact.friction < least[1:].min()
            for is_there, between in ((open_edge, "open and pressing"), (friction_edge, "sticking and sliding")):
                if is_there:
                    pair = tuple(self._model.body_names[body] for body in self._bodies[number])
                    found.append(Edge(pair, self._point[number], between))
        return found

    def range_along(self, change: StepSolution) -> tuple[float, float]:
        """Shares of a change, below and above 0, within which all contacts stay open, sticking or sliding."""
        impulses = np.einsum("cij,cj->ci", self.basis, change.contact_impulse[self.contacts])
        count = 3 * self.contact_count
        speeds = self._of_soft[:count] @ change.node_velocity.ravel()
        speeds = (speeds + self._of_turning[:count] @ change.rigid_velocity.ravel()).reshape(-1, 3)
        noise = [ROUND_OFF * float(np.abs(part).max(initial=0.0)) for part in (impulses, speeds)]
        now, own, ends = self.impulse[:count].reshape(-1, 3), self._speed.reshape(-1, 3), []
        for number, contact in enumerate(self.contact_conditions()):
            here, more, mu = now[number], impulses[number], self._friction[number]
            if contact.is_open:
                ends += _zeros(0.0, speeds[number, 0], max(own[number, 0], 0.0), noise[1])
                continue
            ends += _zeros(0.0, more[0], here[0], noise[0])
            if contact.slides:
                along = -here[1:] / contact.friction
                ends += _zeros(
                    0.0, float(speeds[number, 1:] @ along), max(float(own[number, 1:] @ along), 0.0), noise[1]
                )
            elif contact.most > 0.0:
                square, both = (
                    (mu * more[0]) ** 2 - more[1:] @ more[1:],
                    mu**2 * here[0] * more[0] - here[1:] @ more[1:],
                )
                left = max(contact.most**2 - contact.friction**2, 0.0)
                ends += _zeros(float(square), 2.0 * float(both), left, noise[0] * contact.most)
        return max((end for end, rises in ends if rises), default=-np.inf), min(
            (end for end, rises in ends if not rises), default=np.inf
        )

    def contact_conditions(self) -> list[_Contact]:
        found = []
        for (normal, *along), mu in zip(self.impulse[: len(self._speed)].reshape(-1, 3), self._friction, strict=True):
            friction, most = float(np.hypot(*along)), float(mu * normal)
            slides = normal > 0.0 and most > 0.0 and friction >= (1.0 - AT_BOUND) * most
            found.append(_Contact(float(normal), friction, most, slides))
        return found

    def moved(self, start: State, change: StepSolution, share: float) -> tuple[StepProblem, StepSolution, np.ndarray]:
        """The solution with a share of a change, where the bodies now are, in a step from another start.

        Returns:
            Its problem, the solution, and the change of the velocities of the contacts' rows, shape (3 contact_count,).
        """
        causes = self.causes(start)
        solution = self.solution.plus(change, share)
        if self._nonlinear is not None:
            poses = self.rigid.end_poses(solution.rigid_velocity)
            self._nonlinear.equations.move(solution.node_velocity, *poses, frames=start)
        requests = replace(self._requests, load=causes.load)
        count = 3 * self.contact_count
        speeds = self._of_soft[:count] @ change.node_velocity.ravel()
        speeds += self._of_turning[:count] @ change.rigid_velocity.ravel()
        return replace(self.problem, start=start, requests=requests), solution, speeds

    def _solve(self, change: Causes) -> Motion:
        """The change of the motion by the factor alone."""
        free = self._response(change.node_impulse).reshape(-1, 3)
        of_rigid = self._turning @ change.rigid_velocity.ravel()
        rows = self._of_soft @ free.ravel() + self._of_turning @ of_rigid + change.row_velocity
        impulse = self._conditions.solve(rows, self._compliance, change.bounds)
        rigid_velocity = (of_rigid + self._rigid_response @ impulse).reshape(-1, 6)
        return Motion(free + (impulse @ self._row_response).reshape(-1, 3), rigid_velocity, impulse)

    def _with_exact_slope(self, first: Motion) -> Motion:
        """Solve (1 - P E) m = P c, where P is `_solve` and E what the factor's matrix has too much of the slope."""
        shape = self.solution.node_velocity.shape

        def correction(motion: np.ndarray) -> Motion:
            node_velocity, rigid_velocity = np.split(motion, [first.node_velocity.size])
            return self._solve(self._slope_error(node_velocity.reshape(shape), rigid_velocity.reshape(-1, 6)))

        further = correction(solved(lambda motion: correction(motion).velocities(), first.velocities()))
        return Motion(*(one + more for one, more in zip(vars(first).values(), vars(further).values(), strict=True)))

    def _slope_error(self, node_velocity: np.ndarray, rigid_velocity: np.ndarray) -> Causes:
        """What the last linearisation leaves out of the change of what acts with velocities.

        That is a difference of residuals on both sides, beside the matrix times the change. The anchors' springs are in
        neither: they are linear, and so stiff that their round-off would be all that is seen.
        """
        assert self._nonlinear is not None
        equations, solution = self._nonlinear.equations, self.solution
        largest = max(np.abs(node_velocity).max(initial=0.0), np.abs(rigid_velocity).max(initial=0.0))
        share, sides = SMALL_MOVE / max(float(largest) * self.time_step, 1e-300), []
        for sign in (1.0, -1.0):
            poses = self.rigid.end_poses(solution.rigid_velocity + sign * share * rigid_velocity)
            equations.move(solution.node_velocity + sign * share * node_velocity, *poses)
            bounds = np.zeros_like(self._requests.bounds)
            bounds[:, GRIP] = self.geometry.grip[self.coordinates]
            residual, free = equations.residual(solution.effort, with_anchors=False), self._rigid_by(solution.effort)
            sides.append(Causes(residual, free, np.zeros(len(self.impulse)), bounds, np.zeros(len(solution.effort))))
        error = sides[0].difference(sides[1], 0.5 / share)
        return replace(error, node_impulse=error.node_impulse + equations.matrix_product(node_velocity))

    def _response(self, node_impulse: np.ndarray) -> np.ndarray:
        """Change of the velocities of the nodes by impulses on them, shape (3 node_count,)."""
        if self._soft is None:
            return np.zeros(0)
        return self._soft.response(node_impulse.reshape(-1, 3)).ravel()

    def _own_compliance(self, requests: ActuatorRequests) -> np.ndarray:
        """Compliance of the actuators themselves, shape (row_count, row_count)."""
        own = np.zeros((len(self.impulse), len(self.impulse)))
        for row, compliance in requests.compliances:
            place = slice(3 * self.contact_count + row, 3 * self.contact_count + row + len(compliance))
            own[place, place] += compliance
        return own

    def _rigid_by(self, effort: np.ndarray) -> np.ndarray:
        """Velocities of the rigid bodies without contacts, with the cables as they lie now, shape (rigid_count, 6)."""
        rigid, coordinates = self.rigid.state, self._model.actuators.coordinates
        impulse, count = np.zeros_like(rigid.impulse), np.diff(coordinates.rigid_start)
        pulls = np.repeat(effort, count)[:, None] * self.geometry.gradient.rigid
        np.add.at(impulse, coordinates.rigid_body, self.time_step * pulls)
        return np.asarray(rigid.free + np.einsum("bij,bj->bi", rigid.inverse_mass, impulse))


def solved(correction: Callable[[np.ndarray], np.ndarray], known: np.ndarray) -> np.ndarray:
    """The solution of x - correction(x) = known."""
    operator = sparse_linalg.LinearOperator((known.size, known.size), lambda x: x - correction(x), dtype=np.float64)
    # Round-off of differences may end it above the accuracy: then that is what can be known.
    found: np.ndarray
    found, _ = sparse_linalg.gmres(operator, known, rtol=ACCURACY, atol=0.0, restart=MOST_DIRECTIONS, maxiter=1)
    return found


def _zeros(square: float, slope: float, value: float, noise: float) -> list[tuple[float, bool]]:
    """Where a polynomial that is not negative at 0 becomes so, on either side; True of the end below 0."""
    if abs(slope) <= noise and abs(square) <= noise:
        return []
    if square == 0.0:
        return [(-value / slope + 0.0, slope > 0.0)]
    inside = slope**2 - 4.0 * square * value
    if inside < 0.0:
        return []
    # The stable formula: the sum never cancels.
    half = -0.5 * (slope + np.copysign(np.sqrt(inside), slope))
    roots = sorted({half / square, value / half if half != 0.0 else half / square})
    if value == 0.0:
        return [(0.0, slope > 0.0)]
    return [(float(root), root < 0.0) for root in roots]
