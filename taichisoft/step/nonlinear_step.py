"""Converged steps: repeated linearisation of the soft bodies, with contacts and actuators."""

from dataclasses import replace

import numpy as np
import scipy.sparse as sparse

from taichisoft.contact.constraint_rows import ActuatorRequests
from taichisoft.contact.model import Model
from taichisoft.mechanics.body_geometry import PosesAhead
from taichisoft.mechanics.elasticity import Elasticity
from taichisoft.mechanics.model_actuators import ActuatorGeometry
from taichisoft.mechanics.state import State
from taichisoft.step.constraint_solver import ConstraintSolver
from taichisoft.step.kernels import loads as kernels
from taichisoft.step.rigid_motion import RigidMotion
from taichisoft.step.soft_motion import SoftMotion
from taichisoft.step.solution import StepProblem, StepSolution, moving_velocity

# The nonlinear equations of motion of the soft bodies in a step.


class EndOfStep:
    """The equations of velocities v after the step, with u = (1 - theta) v0 + theta v, forces at x = x0 + theta h u,
    which in implicit Euler is the end of the step, and efforts p of coordinates q,

        M (v - v0) = h (f(x) - d0 - b D0 (u - v0) - a M u + M g + anchors + p dq/dx(x)) + J^T l,

    in overdamped dynamics h M v = h (f(x) + M g + anchors + p dq/dx(x)) + J^T l, and in statics that without M v. The
    damping is that of the first linearisation: d0 where the bodies keep v0, and D0, which has no negative
    eigenvalues.
    `SoftMotion` solves them linearised at the start of the step, or ahead of it; this class evaluates and linearises
    them at other velocities. A linearisation omits the rotation of follower loads with the body.

    Residuals are impulses on the unknowns: of reduced bodies Phi^T T^T times those above, at the amplitudes' places.
    """

    def __init__(self, model: Model, elasticity: Elasticity, soft: SoftMotion, geometry: ActuatorGeometry):
        self._model, self._soft, self._geometry = model, soft, geometry
        self._mass = elasticity.node_mass[:, None]
        self._anchored = elasticity.diagonal - elasticity.inertia[:, None]
        self._time_step, self._stage, self._theta = (
            model.scene.time.step,
            model.scene.time.stage,
            model.scene.time.theta,
        )
        self._has_inertia = model.scene.time.dynamics == "inertial"
        self._has_drag = model.scene.time.dynamics == "overdamped"
        # The lag is s + b in inertial dynamics, and 0 in overdamped ones, where nothing is damped.
        springs = elasticity.reinforcements
        has_drag = springs is not None and springs.is_damped
        self._is_damped = has_drag or bool((elasticity.node_lag > self._stage).any())
        self._anchors = soft.anchors._replace(lag=np.maximum(elasticity.anchor_lag - self._stage, 0.0))
        pairs = elasticity.symbolic.block_pairs
        off = np.flatnonzero(pairs[:, 0] != pairs[:, 1])
        row, column = np.concatenate([pairs, pairs[off, ::-1]]).T
        order = np.lexsort((column, row))
        self._below = off
        self._order, self._column = order, column[order]
        self._row_start = np.searchsorted(row[order], np.arange(model.node_count + 1))
        self._velocity = np.empty((model.node_count, 3))  # u
        self._after = self._velocity  # v
        self._nodes = soft.nodes._replace(
            loaded=np.arange(model.node_count, dtype=np.int32),
            mass=elasticity.node_mass,
            drag=elasticity.node_mass * elasticity.node_rayleigh_mass,
            velocity=self._velocity,
            impulse=np.empty((model.node_count, 3)),
        )

    def begin(self, state: State) -> None:
        """Store the matrix that `SoftMotion` has assembled in the step from `state`."""
        self._start = state
        self._pull_point = self._model.placed_pull_points(state)
        system = self._soft.system
        first_blocks = system.solver.blocks.copy()
        self._first_matrix = self._matrix(first_blocks)
        system.leave_out_damping()
        if self._is_damped:
            lagged = self._elastic()
            system.assemble(damped=False)
            self._first_damping = self._time_step * (self._elastic() - lagged)
            self._first_rates = self._soft.rates(state.velocity)
            self._damping_blocks = first_blocks - system.solver.blocks
            self._damping_matrix = self._matrix(self._damping_blocks)

    def _elastic(self) -> np.ndarray:
        system = self._soft.system
        return system.force.copy() if system.reduced is None else system.force + system.reduced.elastic

    def _matrix(self, blocks: np.ndarray) -> sparse.bsr_array:
        both = np.concatenate([blocks, blocks[self._below].transpose(0, 2, 1)])[self._order]
        size = 3 * self._model.node_count
        return sparse.bsr_array((both, self._column, self._row_start), (size, size))

    def first_force(self, node_velocity: np.ndarray) -> np.ndarray:
        """Product of the first matrix and the rates of the unknowns [mN s], shape (node_count, 3)."""
        product: np.ndarray = (self._first_matrix @ self._soft.rates(node_velocity).ravel()).reshape(-1, 3)
        return product

    def move(
        self,
        node_velocity: np.ndarray,
        rigid_position: np.ndarray,
        rigid_rotation: np.ndarray,
        frames: State | None = None,
    ) -> None:
        """Move the bodies to the positions by node velocities [mm/s], (node_count, 3), and by poses of rigid bodies.

        Frames are where they are at the end of the step, and forces those of its start, or as another state has them.
        """
        if frames is not None:
            self._soft.follow(frames)
            self._pull_point = self._model.placed_pull_points(frames)
        system = self._soft.system
        moving = moving_velocity(self._theta, self._start.velocity, node_velocity)
        position = self._start.position + self._stage * moving
        system.position[:] = position
        system.velocity[:] = 0.0
        system.assemble(damped=False)
        self._velocity[:], self._after = moving, node_velocity
        self._geometry.update(PosesAhead(position, rigid_position, rigid_rotation), self._pull_point)

    def residual(self, effort: np.ndarray, with_anchors: bool = True) -> np.ndarray:
        """Residual impulses [mN s] of the equations where the bodies are, without contacts, shape (node_count, 3)."""
        anchors = self._anchors if with_anchors else self._soft.no_anchors
        soft, velocity = self._soft, self._after
        kernels.sum_impulses(
            self._time_step,
            self._nodes,
            soft.forces,
            anchors,
            soft.frames,
            self._model.actuators.coordinates,
            self._geometry.gradient,
            effort,
        )
        lacking: np.ndarray = self._nodes.impulse.copy()
        soft.add_external(lacking)
        if self._has_inertia:
            lacking -= self._mass * (velocity - self._start.velocity)
        if self._has_drag:
            lacking -= self._time_step * self._mass * velocity
        lacking = soft.on_unknowns(lacking)
        if soft.system.reduced is not None:
            lacking += self._time_step * soft.system.reduced.elastic
        if self._is_damped:
            lacking -= self._first_damping
            change = soft.rates(velocity) - self._first_rates
            lacking -= (self._damping_matrix @ change.ravel()).reshape(-1, 3)
        return lacking

    def linearise(self, load: np.ndarray) -> np.ndarray:
        """Linearise where the bodies are: `SoftMotion`'s matrix, now with s^2 K(x), and begin to solve.

        `load` has the known efforts, and 0 for coordinates with rows. Returns the residual impulses of the
        equations.
        """
        soft = self._soft
        if self._is_damped:
            soft.system.solver.blocks += self._damping_blocks
        lacking = self.residual(load)
        soft.factorise(self._start, lacking, self._after)
        return lacking

    def keep_matrix(self) -> None:
        """Store the matrix of the last linearisation for `matrix_product`, before the bodies are moved."""
        self._last_matrix = self._matrix(self._soft.system.solver.blocks)

    def matrix_product(self, change: np.ndarray) -> np.ndarray:
        """Product of the matrix kept, without the anchors' springs, and node velocities [mN s], (node_count, 3)."""
        product: np.ndarray = (self._last_matrix @ change.ravel()).reshape(-1, 3) - self.anchored_product(change)
        return product

    def anchored_product(self, change: np.ndarray) -> np.ndarray:
        """The anchors' part of the product of the matrix and node velocities [mN s], shape (node_count, 3)."""
        return np.asarray(self._anchored * change)


# Acceleration of linearisations that converge linearly, since they leave out a part of the slope.

DEPTH = 5
"""Most changes between linearisations that are remembered."""

FARTHEST = 8.0
"""Longest way to a first combination over the last change [-]: farther off, changes are not linear; each combination
that is better than the last one lets the next go twice as far, since near a critical load hardly anything resists."""


class AndersonMixing:
    """Anderson's mixing of the solutions of the last linearisations (Walker and Ni 2011, Anderson acceleration for
    fixed-point iterations): of their affine combinations the one whose own change is least, if changes are linear.

    Contacts and actuators obey their laws in a combination where they do so in the same way in all solutions.
    """

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Begin again: the solutions have led nowhere."""
        self._solutions: list[StepSolution] = []
        self._changes: list[np.ndarray] = []
        self._farthest = FARTHEST

    def next(self, before: StepSolution, after: StepSolution) -> StepSolution | None:
        """The combination to continue with, after the equations were linearised at one solution and led to another.

        None before there are two solutions.
        """
        if self._solutions and len(self._solutions[-1].contact_impulse) != len(after.contact_impulse):
            self.forget()
        self._solutions.append(after)
        self._changes.append((after.node_velocity - before.node_velocity).ravel())
        del self._solutions[: -DEPTH - 1], self._changes[: -DEPTH - 1]
        if len(self._solutions) < 2:
            return None
        differences = np.diff(np.array(self._changes), axis=0)
        shares = np.linalg.lstsq(differences.T, self._changes[-1], rcond=1e-12)[0]
        mixed = after
        for share, (first, second) in zip(shares, zip(self._solutions, self._solutions[1:], strict=False), strict=True):
            mixed = mixed.plus(second, -share).plus(first, share)
        distance = float(np.linalg.norm(mixed.node_velocity - before.node_velocity))
        share = min(1.0, self._farthest * float(np.linalg.norm(self._changes[-1])) / max(distance, 1e-300))
        self._farthest *= 2.0
        return before.towards(mixed, share)


# The line search accepts the whole step unless the slope at its end exceeds LARGE_SLOPE times the slope at its start
# (Matthies and Strang 1979, The solution of nonlinear finite element equations); else it ends at a slope of at most
# SMALL_SLOPE times the slope at the start.
LARGE_SLOPE, SMALL_SLOPE = 0.8, 0.5
MOST_TRIALS = 12
# Linearisations of a static step in which what is missing must be halved: where loads cannot be carried it never is.
PATIENCE = 150
# Least distance of the next trial from both brackets, over their distance: far out, forces are high powers of it.
LEAST_MOVE = 0.1


class NonlinearStep:
    """Solves the equations of `EndOfStep` together with contacts and actuators; holds the work space of one simulation.

    Every linearisation gives a quadratic problem with the inequalities of contacts and actuators, whose solution is the
    next motion (sequential quadratic programming). With the impulses of that solution as fixed forces the step is a
    descent direction, since the matrix is positive definite. A line search follows it until the product of residual and
    direction, the slope, is small. This needs no energy, which damping, friction and follower loads do not have.

    Attributes:
        geometry: geometry of the actuators where the bodies are.
        equations: the equations of the soft bodies.
        tolerance: largest move of a node by another linearisation at which a step ends [mm].
        unmixed: number of linearisations of a static step before Anderson's mixing, which goes to unstable equilibria
            as well, where they lead away from those.
    """

    def __init__(
        self,
        model: Model,
        elasticity: Elasticity,
        soft: SoftMotion,
        rigid: RigidMotion,
        constraint_solver: ConstraintSolver,
    ):
        """Allocate the work space; soft bodies are linearised at the start of the step before `solve` is called."""
        self.geometry = ActuatorGeometry(model.actuators, model.node_count)
        self.equations = EndOfStep(model, elasticity, soft, self.geometry)
        self._soft, self._rigid, self._constraint_solver = soft, rigid, constraint_solver
        self._time_step, self._most = model.scene.time.step, model.scene.time.most_linearisations
        self._time, self._stage, self._theta = model.scene.time, model.scene.time.stage, model.scene.time.theta
        self.tolerance = model.scene.time.newton_tolerance
        self.unmixed = 0
        self._is_static = model.scene.time.dynamics == "static"

    def solve(self, problem: StepProblem) -> StepSolution:
        """Solve the problem of a step, with the soft bodies linearised at its start."""
        equations, solver, first = self.equations, self._constraint_solver, problem.requests
        solution = solver.solve(problem)
        iterations, linearisations = solution.iterations, 1
        before = self._free_solution(problem, solution)
        equations.begin(problem.start)
        force = equations.first_force(solution.node_velocity)
        self._start = problem.start
        values, rates = problem.geometry.values(), first.lead_rate
        velocity = self._rates(solution, problem.geometry)
        mixing, residual = AndersonMixing() if self._is_static else None, np.inf
        least, most = np.inf, self._most
        while True:
            aim = values + self._stage * (velocity - rates)
            may_mix = mixing is not None and linearisations > self.unmixed
            mixed, last = mixing.next(before, solution) if mixing is not None and may_mix else None, residual
            if mixed is not None:
                self._move(mixed)
                residual = self._missing(mixed, first, aim)
            if mixed is not None and residual < last:
                solution = mixed
            else:
                if mixing is not None and mixed is not None:
                    mixing.forget()
                solution = self._line_search(before, solution, force)
                residual = self._missing(solution, first, aim)
            if residual < 0.5 * least and self._is_static and not self.unmixed:
                least, most = residual, min(self._most, linearisations + PATIENCE)
            if not residual > self.tolerance or linearisations == most:
                return replace(solution, iterations=iterations, linearisations=linearisations, newton_residual=residual)
            values, rates = self.geometry.values(), self._rates(solution)
            impulse = solution.effort[first.coordinates] * self._time_step
            growth = values - first.start_values
            requests = first.linearised(self.geometry, growth, rates, self._start, impulse, self._time)
            problem = replace(problem, geometry=self.geometry, requests=requests)
            force = equations.linearise(first.load)
            before, solution = solution, solver.solve(problem, solution)
            iterations, linearisations = iterations + solution.iterations, linearisations + 1
            force += self._soft.on_unknowns(solution.node_impulse)
            velocity = self._rates(solution)

    def linearise_at(self, solution: StepSolution, load: np.ndarray) -> None:
        """Factorise the matrix of the motion of a solution; see `EndOfStep.linearise`."""
        self._move(solution)
        self.equations.linearise(load)
        self.equations.keep_matrix()

    def _free_solution(self, problem: StepProblem, solution: StepSolution) -> StepSolution:
        """Unknowns at rest under known loads only, the start of the first line search."""
        zero = np.zeros_like(solution.node_velocity)
        return StepSolution(
            node_velocity=self._soft.resting_velocity(),
            node_impulse=zero,
            contact_node_impulse=zero,
            rigid_velocity=self._rigid.state.free.copy(),
            rigid_impulse=np.zeros_like(solution.rigid_impulse),
            contact_impulse=np.zeros_like(solution.contact_impulse),
            effort=problem.requests.load,
        )

    def _line_search(self, before: StepSolution, after: StepSolution, force: np.ndarray) -> StepSolution:
        """Search along the line between two solutions for a small slope; the bodies are moved there.

        `force` is the product of the matrix and the change of the unknowns' rates [mN s], shape (node_count, 3).
        """
        direction = self._soft.rates(after.node_velocity) - self._soft.rates(before.node_velocity)
        start = -float((force * direction).sum())
        solution, end = after, self._slope(after, after, direction)
        if not (start < 0.0 and end > -LARGE_SLOPE * start):
            return solution
        # Illinois variant of regula falsi: the value of a retained end is halved.
        low, high, low_slope, high_slope, last = 0.0, 1.0, start, end, 0.0
        for _ in range(MOST_TRIALS):
            share = low - low_slope * (high - low) / (high_slope - low_slope)
            margin = LEAST_MOVE * (high - low)
            share = min(max(share, low + margin), high - margin)
            solution = before.towards(after, share)
            slope = self._slope(solution, after, direction)
            if abs(slope) <= -SMALL_SLOPE * start:
                break
            if slope > 0.0:
                high, high_slope = share, slope
                low_slope *= 0.5 if last > 0.0 else 1.0
            else:
                low, low_slope = share, slope
                high_slope *= 0.5 if last < 0.0 else 1.0
            last = slope
        return solution

    def _slope(self, solution: StepSolution, forces: StepSolution, direction: np.ndarray) -> float:
        """Move the bodies to a solution, and return the slope: the product of the residual there and the direction."""
        self._move(solution)
        lacking = self.equations.residual(forces.effort) + self._soft.on_unknowns(forces.contact_node_impulse)
        return -float((lacking * direction).sum())

    def _move(self, solution: StepSolution) -> None:
        """Move the bodies to where a step with the velocities of a solution takes forces."""
        moving = self._theta * self._rigid.moving_velocity(solution.rigid_velocity)
        self.equations.move(solution.node_velocity, *self._rigid.end_poses(moving))

    def _rates(self, solution: StepSolution, geometry: ActuatorGeometry | None = None) -> np.ndarray:
        """Rates of the actuators' coordinates along a solution's motion, by a geometry, else that where bodies are."""
        moving = moving_velocity(self._theta, self._start.velocity, solution.node_velocity)
        return (geometry or self.geometry).rates(moving, self._rigid.moving_velocity(solution.rigid_velocity))

    def _missing(self, solution: StepSolution, requests: ActuatorRequests, aim: np.ndarray) -> float:
        """Largest move of a node by another linearisation, or to the aims of the actuators' rows [mm]."""
        lacking = self.equations.residual(solution.effort) + self._soft.on_unknowns(solution.contact_node_impulse)
        speed = float(np.abs(self._soft.response_of_unknowns(lacking)).max())
        return self._time_step * max(speed, self._missing_rate(requests, aim))

    def _missing_rate(self, requests: ActuatorRequests, aim: np.ndarray) -> float:
        """Largest over the rows of the least node velocity that brings the coordinate to its aim [mm/s]."""
        coordinates = requests.coordinates
        if not len(coordinates):
            return 0.0
        missed = np.abs(self.geometry.values() - aim)[coordinates] / self._time_step
        return float((missed / self.geometry.steepness()[coordinates]).max())
