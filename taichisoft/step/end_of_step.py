"""The soft bodies' equations of motion at the end of a step, which one linearisation does not solve."""

import numpy as np
import scipy.sparse as sparse

from taichisoft.bodies.actuators import ActuatorGeometry
from taichisoft.bodies.elasticity import Elasticity
from taichisoft.bodies.surfaces import PosesAhead
from taichisoft.model import Model
from taichisoft.state import State
from taichisoft.step.kernels import loads as kernels
from taichisoft.step.soft_motion import SoftMotion


class EndOfStep:
    """Implicit Euler's equations of velocities v after the step, with x = x0 + h v and efforts p of coordinates q,

        M (v - v0) = h (f(x) - d0 - b D0 (v - v0) - a M v + M g + anchors + p dq/dx(x)) + J^T l,

    and in first order dynamics h M v = h (f(x) + M g + anchors + p dq/dx(x)). The damping is that of the first
    linearisation: d0 where the bodies go on with v0, and D0, which has no negative eigenvalues.
    `SoftMotion` solves them linearised at the start of the step, or ahead of it; here they are evaluated, and
    linearised anew, at other velocities. A linearisation leaves out how loads that follow the body turn with it.
    """

    def __init__(self, model: Model, elasticity: Elasticity, soft: SoftMotion, geometry: ActuatorGeometry):
        """Make the work space.

        Args:
            model: the bodies.
            elasticity: the model's.
            soft: the soft bodies of a step, whose equations are linearised anew.
            geometry: of the model's actuators, which is moved along.
        """
        self._model, self._soft, self._geometry = model, soft, geometry
        self._mass = elasticity.node_mass[:, None]
        self._time_step = model.scene.time.step
        self._has_inertia = model.scene.time.dynamics == "second order"
        # The lag is h + b in second order dynamics, and 0 in first order ones, where nothing is damped.
        self._is_damped = bool((elasticity.node_lag > self._time_step).any())
        self._anchors = soft.anchors._replace(lag=np.maximum(elasticity.anchor_lag - self._time_step, 0.0))
        pairs = elasticity.symbolic.block_pairs
        off = np.flatnonzero(pairs[:, 0] != pairs[:, 1])
        row, column = np.concatenate([pairs, pairs[off, ::-1]]).T
        order = np.lexsort((column, row))
        self._below = off
        self._order, self._column = order, column[order]
        self._row_start = np.searchsorted(row[order], np.arange(model.node_count + 1))
        self._velocity = np.empty((model.node_count, 3))
        self._nodes = soft.nodes._replace(velocity=self._velocity, impulse=np.empty((model.node_count, 3)))

    def begin(self, state: State) -> None:
        """Take the matrix that `SoftMotion` has made in the step from `state`."""
        self._start = state
        self._pull_point = self._model.placed_pull_points(state)
        system = self._soft.system
        first_blocks = system.solver.blocks.copy()
        self._first_matrix = self._matrix(first_blocks)
        system.leave_out_damping()
        if self._is_damped:
            lagged = system.force.copy()
            system.assemble(damped=False)
            self._first_damping = self._time_step * (system.force - lagged)
            self._damping_blocks = first_blocks - system.solver.blocks
            self._damping_matrix = self._matrix(self._damping_blocks)

    def _matrix(self, blocks: np.ndarray) -> sparse.bsr_array:
        """The matrix of the solver's blocks, which has both its halves."""
        both = np.concatenate([blocks, blocks[self._below].transpose(0, 2, 1)])[self._order]
        size = 3 * self._model.node_count
        return sparse.bsr_array((both, self._column, self._row_start), (size, size))

    def first_pull(self, node_velocity: np.ndarray) -> np.ndarray:
        """The first matrix times velocities [mN s], shape (node_count, 3)."""
        product: np.ndarray = (self._first_matrix @ node_velocity.ravel()).reshape(-1, 3)
        return product

    def move(self, node_velocity: np.ndarray, rigid_position: np.ndarray, rigid_rotation: np.ndarray) -> None:
        """Let bodies be where these velocities [mm/s], (node_count, 3), and poses of the rigid bodies have them."""
        system = self._soft.system
        position = self._start.position + self._time_step * node_velocity
        system.position[:] = position
        system.velocity[:] = 0.0
        system.assemble(damped=False)
        self._velocity[:] = node_velocity
        self._geometry.update(PosesAhead(position, rigid_position, rigid_rotation), self._pull_point)

    def left(self, effort: np.ndarray) -> np.ndarray:
        """The impulses [mN s] by which the equations miss where the bodies are, without those of contacts.

        Args:
            effort: of the actuators' coordinates [kPa] and [mN], shape (coordinate_count,).
        """
        soft, velocity = self._soft, self._velocity
        kernels.sum_impulses(
            self._time_step,
            self._nodes,
            self._anchors,
            soft.base,
            self._model.actuators.coordinates,
            self._geometry.gradient,
            effort,
        )
        left: np.ndarray = self._nodes.impulse.copy()
        if self._is_damped:
            left -= self._first_damping
            left -= (self._damping_matrix @ (velocity - self._start.velocity).ravel()).reshape(-1, 3)
        if self._has_inertia:
            left -= self._mass * (velocity - self._start.velocity)
        else:
            left -= self._time_step * self._mass * velocity
        return left

    def linearise(self, load: np.ndarray) -> np.ndarray:
        """Linearise where the bodies are: `SoftMotion`'s matrix, now with h^2 K(x), and begin to solve.

        Args:
            load: efforts that are known, 0 of those with rows, shape (coordinate_count,).

        Returns:
            The impulses [mN s] that make up for what is left of the equations, shape (node_count, 3).

        Raises:
            SimulationDiverged: the matrix is not positive definite.
        """
        soft = self._soft
        if self._is_damped:
            soft.system.solver.blocks += self._damping_blocks
        left = self.left(load)
        soft.factorise(self._start, left, self._velocity)
        return left
