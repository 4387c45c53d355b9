"""The nonlinear equations of motion of the soft bodies in a step."""

import numpy as np
import scipy.sparse as sparse

from taichisoft.actuators.model_actuators import ActuatorGeometry
from taichisoft.bodies.body_geometry import PosesAhead
from taichisoft.bodies.elasticity import Elasticity
from taichisoft.model import Model
from taichisoft.state import State
from taichisoft.step.kernels import loads as kernels
from taichisoft.step.soft_motion import SoftMotion
from taichisoft.step.solution import moving_velocity


class EndOfStep:
    """The equations of velocities v after the step, with u = (1 - theta) v0 + theta v, forces at x = x0 + theta h u,
    which in implicit Euler is the end of the step, and efforts p of coordinates q,

        M (v - v0) = h (f(x) - d0 - b D0 (u - v0) - a M u + M g + anchors + p dq/dx(x)) + J^T l,

    in overdamped dynamics h M v = h (f(x) + M g + anchors + p dq/dx(x)) + J^T l, and in statics that without M v. The
    damping is that of the first linearisation: d0 where the bodies go on with v0, and D0, which has no negative
    eigenvalues.
    `SoftMotion` solves them linearised at the start of the step, or ahead of it; this class evaluates and linearises
    them at other velocities. A linearisation omits the rotation of follower loads with the body.

    Residuals are impulses on the unknowns: of reduced bodies Phi^T T^T times those above, at the amplitudes' places.
    """

    def __init__(self, model: Model, elasticity: Elasticity, soft: SoftMotion, geometry: ActuatorGeometry):
        """Allocate the work space.

        Args:
            model: the bodies.
            elasticity: elasticity of the model.
            soft: the soft bodies of a step, whose equations are linearised again.
            geometry: geometry of the model's actuators, which `move` measures.
        """
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
        self._is_damped = bool((elasticity.node_lag > self._stage).any())
        self._anchors = soft.anchors._replace(lag=np.maximum(elasticity.anchor_lag - self._stage, 0.0))
        no_nodes = {name: getattr(soft.anchors, name)[:0].copy() for name in ("node", "frame")}
        self._no_anchors = self._anchors._replace(**no_nodes)
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
        """Elastic forces on the unknowns [mN], shape (node_count, 3)."""
        system = self._soft.system
        return system.force.copy() if system.reduced is None else system.force + system.reduced.elastic

    def _matrix(self, blocks: np.ndarray) -> sparse.bsr_array:
        """The full symmetric matrix of the solver's blocks."""
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

        Frames are where they are at the end of the step, or where another state has them.
        """
        if frames is not None:
            self._soft.follow_frames(frames)
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
        """Residual impulses [mN s] of the equations at the current positions, without contacts, shape (node_count, 3).

        Args:
            effort: efforts of the actuators' coordinates [kPa] and [mN], shape (coordinate_count,).
            with_anchors: whether the anchors' springs count.
        """
        anchors = self._anchors if with_anchors else self._no_anchors
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
        """Linearise at the current positions: `SoftMotion`'s matrix, now with s^2 K(x), and begin to solve.

        Args:
            load: known efforts, 0 for coordinates with rows, shape (coordinate_count,).

        Returns:
            Residual impulses of the equations [mN s], shape (node_count, 3).

        Raises:
            SimulationDiverged: the matrix is not positive definite.
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
