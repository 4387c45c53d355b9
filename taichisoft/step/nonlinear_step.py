"""Converged steps: repeated linearisation of the soft bodies, with contacts and actuators."""

from dataclasses import replace

import numpy as np

from taichisoft.actuators.model_actuators import ActuatorGeometry
from taichisoft.bodies.elasticity import Elasticity
from taichisoft.model import Model
from taichisoft.solver.actuator_requests import ActuatorRequests
from taichisoft.step.anderson_mixing import AndersonMixing
from taichisoft.step.constraint_solver import ConstraintSolver
from taichisoft.step.end_of_step import EndOfStep
from taichisoft.step.rigid_motion import RigidMotion
from taichisoft.step.soft_motion import SoftMotion
from taichisoft.step.solution import StepProblem, StepSolution, moving_velocity

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
        """Allocate the work space.

        Args:
            model: the bodies.
            elasticity: elasticity of the model.
            soft: the soft bodies, linearised at the start of the step before `solve` is called.
            rigid: the rigid bodies of the step.
            constraint_solver: solves the linearised problems.
        """
        self.geometry = ActuatorGeometry(model.actuators, model.node_count)
        self.equations = EndOfStep(model, elasticity, soft, self.geometry)
        self._soft, self._rigid, self._constraint_solver = soft, rigid, constraint_solver
        self._time_step, self._most = model.scene.time.step, model.scene.time.most_linearisations
        self._time, self._stage, self._theta = model.scene.time, model.scene.time.stage, model.scene.time.theta
        self.tolerance = model.scene.time.newton_tolerance
        self.unmixed = 0
        self._is_static = model.scene.time.dynamics == "static"

    def solve(self, problem: StepProblem) -> StepSolution:
        """Solve the problem of a step, with the soft bodies linearised at its start.

        Raises:
            SimulationDiverged: a matrix is not positive definite.
        """
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

        Args:
            before, after: start and end of the line.
            force: product of the matrix and the change of the unknowns' rates [mN s], shape (node_count, 3).
        """
        way = self._soft.rates(after.node_velocity) - self._soft.rates(before.node_velocity)
        start = -float((force * way).sum())
        solution, end = after, self._slope(after, after, way)
        if not (start < 0.0 and end > -LARGE_SLOPE * start):
            return solution
        # Illinois variant of regula falsi: the value of a retained end is halved.
        low, high, low_slope, high_slope, last = 0.0, 1.0, start, end, 0.0
        for _ in range(MOST_TRIALS):
            share = low - low_slope * (high - low) / (high_slope - low_slope)
            room = LEAST_MOVE * (high - low)
            share = min(max(share, low + room), high - room)
            solution = before.towards(after, share)
            slope = self._slope(solution, after, way)
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

    def _slope(self, solution: StepSolution, forces: StepSolution, way: np.ndarray) -> float:
        """Move the bodies to a solution, and return the slope: the product of the residual there and the direction."""
        self._move(solution)
        lacking = self.equations.residual(forces.effort) + self._soft.on_unknowns(forces.contact_node_impulse)
        return -float((lacking * way).sum())

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
        return self._time_step * max(self._missing_velocity(solution), self._missing_rate(requests, aim))

    def _missing_velocity(self, solution: StepSolution) -> float:
        """Largest change of velocity by the residual impulses of the equations [mm/s]."""
        lacking = self.equations.residual(solution.effort) + self._soft.on_unknowns(solution.contact_node_impulse)
        return float(np.abs(self._soft.response_of_unknowns(lacking)).max())

    def _missing_rate(self, requests: ActuatorRequests, aim: np.ndarray) -> float:
        """Largest over the rows of the least node velocity that brings the coordinate to its aim [mm/s]."""
        coordinates = requests.coordinates
        if not len(coordinates):
            return 0.0
        missed = np.abs(self.geometry.values() - aim)[coordinates] / self._time_step
        return float((missed / self.geometry.steepness()[coordinates]).max())
