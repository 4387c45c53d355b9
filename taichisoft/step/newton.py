"""Converged implicit Euler: the soft bodies linearised anew, with contacts and actuators, until nothing changes."""

import numpy as np

from taichisoft.bodies.actuators import ActuatorGeometry
from taichisoft.bodies.elasticity import Elasticity
from taichisoft.model import Model
from taichisoft.solver.actuator_rows import ActuatorRows
from taichisoft.state import State
from taichisoft.step.constraints import Constraints, Motion
from taichisoft.step.contact_prediction import Found
from taichisoft.step.end_of_step import EndOfStep
from taichisoft.step.rigid_motion import RigidMotion
from taichisoft.step.soft_motion import SoftMotion

# A way d is gone whole unless the slope at its end is larger than this share of that at its start (Matthies and Strang
# 1979, The solution of nonlinear finite element equations); else as far as where it is at most the second share.
LARGE_SLOPE, SMALL_SLOPE = 0.8, 0.5
MOST_TRIALS = 12
# Least share of the way between two trials that the next one is from either: far out, forces are high powers of it.
LEAST_MOVE = 0.1


class NewtonIteration:
    """Solves the equations of `EndOfStep` together with contacts and actuators; the work space of one simulation.

    Every linearisation gives a quadratic problem with the inequalities of contacts and actuators, whose solution is the
    next motion (sequential quadratic programming). With the impulses of that solution as fixed forces the way there
    goes downhill at first, since the matrix is positive definite. It is gone until the equations' product with the way,
    the slope, is small: that needs no energy, which damping, friction and loads that follow a body do not have.

    Attributes:
        residual: how far another linearisation would move a node at most [mm].
        linearisations: how many were made in the step.
    """

    def __init__(
        self,
        model: Model,
        elasticity: Elasticity,
        soft: SoftMotion,
        rigid: RigidMotion,
        geometry: ActuatorGeometry,
        actuators: ActuatorRows,
        constraints: Constraints,
    ):
        """Make the work space; the arguments are the parts of the step that have made the first linearisation."""
        self._equations = EndOfStep(model, elasticity, soft, geometry)
        self._soft, self._rigid, self._geometry = soft, rigid, geometry
        self._actuators, self._constraints = actuators, constraints
        self._time_step, self._most = model.scene.time.step, model.scene.time.newton
        self._tolerance = model.scene.time.newton_tolerance
        self.residual, self.linearisations = 0.0, 0

    def improve(self, start: State, found: Found) -> None:
        """Go on from the motion that `Constraints` has found with the first linearisation.

        Args:
            start: the state at the start of the step.
            found: the contacts of the step.

        Raises:
            SimulationDiverged: a matrix is not positive definite.
        """
        equations, constraints, load = self._equations, self._constraints, self._actuators.load
        equations.begin(start)
        motion, first_values = constraints.motion, self._actuators.start_values
        before = Motion(*(np.zeros_like(part) for part in motion))._replace(effort=load.copy())
        values, rates = self._geometry.values(), self._actuators.lead_rate
        pull = equations.first_pull(motion.node_velocity)
        self.linearisations = 1
        while True:
            aim = values + self._time_step * (self._rates(motion) - rates)
            motion = self._go(before, motion, pull)
            self.residual = self._time_step * max(self._missing_velocity(motion), self._missing_rate(aim))
            if not self.residual > self._tolerance or self.linearisations == self._most:
                return
            self.linearisations += 1
            values, rates = self._geometry.values(), self._rates(motion)
            self._actuators.linearise_again(values - first_values, rates, constraints.row_impulse)
            pull = equations.linearise(load)
            constraints.solve_again(found)
            before, motion = motion, constraints.motion
            pull += constraints.node_impulse

    def _go(self, before: Motion, after: Motion, pull: np.ndarray) -> Motion:
        """Go from one motion towards another, as far as is good.

        Args:
            before, after: the motions.
            pull: the matrix times the change of the nodes' velocities [mN s], shape (node_count, 3).
        """
        way = after.node_velocity - before.node_velocity
        start = -float((pull * way).sum())
        motion, end = after, self._slope(after, after, way)
        if not (start < 0.0 and end > -LARGE_SLOPE * start):
            return motion
        # The Illinois variant of regula falsi: an end that stays is given half its weight.
        low, high, low_slope, high_slope, last = 0.0, 1.0, start, end, 0.0
        for _ in range(MOST_TRIALS):
            share = low - low_slope * (high - low) / (high_slope - low_slope)
            room = LEAST_MOVE * (high - low)
            share = min(max(share, low + room), high - room)
            motion = before.towards(after, share)
            slope = self._slope(motion, after, way)
            if abs(slope) <= -SMALL_SLOPE * start:
                break
            if slope > 0.0:
                high, high_slope = share, slope
                low_slope *= 0.5 if last > 0.0 else 1.0
            else:
                low, low_slope = share, slope
                high_slope *= 0.5 if last < 0.0 else 1.0
            last = slope
        return motion

    def _slope(self, motion: Motion, forces: Motion, way: np.ndarray) -> float:
        """Move everything as in a motion; how fast the potential of the equations, with fixed forces, rises then."""
        self._constraints.take(motion)
        self._equations.move(motion.node_velocity, *self._rigid.end_poses())
        return -float(((self._equations.left(forces.effort) + forces.node_impulse) * way).sum())

    def _rates(self, motion: Motion) -> np.ndarray:
        """How fast the actuators' coordinates grow, by their present gradients, in the motion taken last."""
        rigid = self._rigid.state
        return self._geometry.rates(motion.node_velocity, np.hstack([rigid.linear, rigid.angular]))

    def _missing_velocity(self, motion: Motion) -> float:
        """Largest change of velocity that the forces left over make [mm/s]."""
        left = self._equations.left(motion.effort) + motion.node_impulse
        return float(np.abs(self._soft.response(left)).max())

    def _missing_rate(self, aim: np.ndarray) -> float:
        """Least velocities of the nodes that bring the coordinates with rows to where they were to be [mm/s]."""
        some = self._actuators.coordinates
        if not len(some):
            return 0.0
        missed = np.abs(self._geometry.values() - aim)[some] / self._time_step
        return float((missed / self._geometry.steepness()[some]).max())
