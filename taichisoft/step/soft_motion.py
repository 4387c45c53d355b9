"""Linearised motion of the soft bodies by forces and by the impulses of contacts and actuators."""

import numpy as np

from taichisoft.actuators.model_actuators import ActuatorGeometry
from taichisoft.bodies.elasticity import Elasticity, ElasticSystem
from taichisoft.bodies.rotations import rotation_from_vector
from taichisoft.cholesky.kernels.sparse_columns import SparseColumns
from taichisoft.errors import ControlError, NotPositiveDefinite, SimulationDiverged
from taichisoft.model import Model
from taichisoft.state import State
from taichisoft.step.kernels import loads as kernels
from taichisoft.step.solution import ForcesOnBase


class SoftMotion:
    """The soft bodies of a step; made only for models with soft bodies.

    Attributes:
        known_velocity: node velocities whose change the step's equations give [mm/s], shape (node_count, 3).
        system: elastic forces, matrix and direct solver of the step.
        nodes: loads on the nodes, at the start of the step.
        forces: constant forces on nodes.
        anchors: springs that hold nodes, with the lag at the start of a step.
        base: pose of the base.
    """

    def __init__(self, model: Model, elasticity: Elasticity, geometry: ActuatorGeometry):
        """Allocate the work space.

        Args:
            model: the bodies.
            elasticity: elasticity of the model.
            geometry: geometry of the model's actuators at the start of a step.
        """
        self._model, self._time_step = model, model.scene.time.step
        self._geometry = geometry
        self.system = ElasticSystem(elasticity)
        is_full = self.system.modes.start < 0
        loaded = is_full.copy()
        constant = np.vstack([body.node_force for body in model.soft_bodies])
        is_pushed = constant.any(axis=1)
        loaded[model.anchored_nodes] = loaded[model.actuators.coordinates.entry_node] = loaded[is_pushed] = True
        mass = np.where(is_full, elasticity.node_mass, 0.0)
        self.nodes = kernels.Nodes(
            loaded=np.flatnonzero(loaded).astype(np.int32),
            mass=mass,
            drag=mass * elasticity.node_rayleigh_mass,
            gravity=np.empty((1, 3)),
            position=self.system.position,
            velocity=self.system.velocity,
            elastic=self.system.force,
            impulse=np.zeros((model.node_count, 3)),
        )
        self._young_modulus: np.ndarray | None = None  # of the system's elements
        self.anchors = kernels.Anchors(
            node=model.anchored_nodes,
            stiffness=elasticity.anchor_stiffness,
            lag=elasticity.anchor_lag,
            position=np.empty((len(model.anchored_nodes), 3)),
        )
        pushed = np.flatnonzero(is_pushed)
        self.forces = kernels.ConstantForces(node=pushed.astype(np.int32), force=constant[pushed])
        self.no_anchors = self.anchors._replace(node=self.anchors.node[:0].copy())
        self._full_anchors = np.flatnonzero(is_full[model.anchored_nodes])
        held = model.anchored_nodes[self._full_anchors]
        self._rows_of_anchors = RowsOfNodes(elasticity.symbolic.block_pairs, held)
        self._anchored_mass = elasticity.inertia[held][:, None]
        self._reduced_nodes = np.flatnonzero(~is_full)
        self._reduced_mass = elasticity.node_mass[self._reduced_nodes, None]
        self._reduced_drag = elasticity.node_rayleigh_mass[self._reduced_nodes, None]
        self._other_impulse = np.zeros((model.node_count, 3))
        self.base = kernels.Base(place=np.vstack([model.base_pivot, np.zeros(3)]), turn=np.empty((1, 3, 3)))
        self._base_rotation: np.ndarray | None = None  # rotation vector of `base.turn`
        self._anchor_position: np.ndarray | None = None  # the last that was checked
        self.known_velocity = np.zeros((model.node_count, 3))

    def begin(self, state: State, load: np.ndarray) -> None:
        """Linearise implicit Euler with the rotations of the start of the step, and begin to solve it.

        Without contact and with known efforts p of coordinates q the velocities after the step are
        v + A^-1 h (f + M g + p dq/dx - a M v - (h + b) K v), without inertia A^-1 h (f + M g + p dq/dx).

        Args:
            state: at the start of the step.
            load: known pressures [kPa] and tensions [mN], shape (coordinate_count,).

        Raises:
            SimulationDiverged: the system matrix is not positive definite.
        """
        self.system.position[:], self.system.velocity[:] = state.position, state.velocity
        has_inertia = self._model.scene.time.dynamics == "second order"
        self._follow_base(state)
        if self.system.reduced is not None:
            self._refuse_moved_anchors(state)
            place, turn = self.base.place, self.base.turn[0]
            self.system.reduced.begin(place, turn, state.gravity, self._model.scene.time.step, has_inertia)
        if state.young_modulus is not self._young_modulus:
            self._young_modulus = state.young_modulus
            stiffening = state.young_modulus / self._model.young_modulus
            self.system.scale_stiffness(stiffening[self._model.element_material])
        self.system.assemble()
        self._sum_impulses(state, load)
        known_velocity = self.system.velocity
        if not has_inertia:
            known_velocity = np.where(self.system.modes.start[:, None] >= 0, known_velocity, 0.0)
        self.factorise(state, self.nodes.impulse, known_velocity)

    def response(self, node_impulse: np.ndarray) -> np.ndarray:
        """Change of velocity [mm/s], shape (node_count, 3), by impulses on the nodes [mN s], shape (node_count, 3)."""
        return self.system.solver.solve(node_impulse)

    def complete(self, columns: SparseColumns, multipliers: np.ndarray, count: int) -> np.ndarray:
        """Velocities of the nodes after the step [mm/s], shape (node_count, 3), with impulses in the rows of `columns`.

        Arguments are those of `Cholesky.complete`.
        """
        return self._moved(self.system.solver.complete(columns, multipliers, count))

    def complete_with(self, node_impulse: np.ndarray) -> np.ndarray:
        """The same with impulses on the nodes [mN s], shape (node_count, 3)."""
        reduced = self.system.reduced
        more = node_impulse if reduced is None else reduced.response_to(node_impulse)
        return self._moved(self.system.solver.complete_with(more))

    def _moved(self, change: np.ndarray) -> np.ndarray:
        reduced = self.system.reduced
        if reduced is not None:
            change = reduced.node_velocity(change)
        return change + self.known_velocity

    def factorise(self, state: State, node_impulse: np.ndarray, known_velocity: np.ndarray) -> None:
        """Factorise the matrix of the system, and begin to solve for the change of velocities by impulses.

        Args:
            state: at the start of the step.
            node_impulse: impulses on the nodes [mN s], shape (node_count, 3).
            known_velocity: velocities to which the change is added [mm/s], shape (node_count, 3) or (3,).

        Raises:
            SimulationDiverged: the matrix is not positive definite.
        """
        self.known_velocity[:] = known_velocity
        reduced = self.system.reduced
        if reduced is not None:
            node_impulse = reduced.right_hand_side(node_impulse, self.nodes.loaded, self._model.scene.time.step)
        try:
            self.system.solver.factorise(node_impulse)
        except NotPositiveDefinite as error:
            body = self._model.body_of_node(error.node)
            raise SimulationDiverged(body, state.step, str(error), "a smaller time step") from error

    def forces_on_base(
        self, start: State, load: np.ndarray, node_velocity: np.ndarray, node_impulse: np.ndarray
    ) -> ForcesOnBase:
        """Forces of the bodies on the base in the step.

        On anchors they are what the equations of the anchored nodes leave without their springs: the springs' stretch
        times their stiffness, 1e12 mN/mm, would show the round-off of velocities.

        Args:
            start: state at the start of the step.
            load: known pressures [kPa] and tensions [mN], shape (coordinate_count,).
            node_velocity: velocities after the step [mm/s], shape (node_count, 3).
            node_impulse: impulses of contacts and of actuator rows [mN s], shape (node_count, 3).
        """
        self._sum(self.nodes._replace(impulse=self._other_impulse), self.no_anchors, load)
        impulse, some = self._other_impulse + node_impulse, self._full_anchors
        at_anchors = np.zeros((len(self.anchors.node), 3))
        if len(some):
            held, change = self.anchors.node[some], node_velocity - self.known_velocity
            taken = self._anchored_mass * change[held] + self._rows_of_anchors.times(self.system.solver.blocks, change)
            at_anchors[some] = (impulse[held] - taken) / self._time_step
        nodes = self._reduced_nodes
        velocity = rate = node_velocity[nodes]
        if self._model.scene.time.dynamics == "second order":
            rate = (velocity - start.velocity[nodes]) / self._time_step + self._reduced_drag * velocity
        of_reduced = impulse[nodes] / self._time_step + self._reduced_mass * (start.gravity - rate)
        return ForcesOnBase(at_anchors, of_reduced)

    def leave_out_forces(self) -> None:
        """Restart from rest with the impulses of contacts only."""
        self.known_velocity[:] = 0.0
        self.system.solver.leave_out_right_hand_side()

    def _follow_base(self, state: State) -> None:
        self.base.place[1] = state.base_translation
        if state.base_rotation is not self._base_rotation:
            self._base_rotation = state.base_rotation
            self.base.turn[0] = rotation_from_vector(state.base_rotation)

    def _refuse_moved_anchors(self, state: State) -> None:
        """Modes follow the base; they cannot follow anchors that move by themselves."""
        if state.anchor_position is self._anchor_position:
            return
        nodes = self._model.anchored_nodes
        moved = (state.anchor_position != self._model.rest_position[nodes]).any(axis=1)
        moved &= self.system.modes.start[nodes] >= 0
        if moved.any():
            body = self._model.body_of_node(int(nodes[moved.argmax()]))
            raise ControlError(
                f"anchor_positions: '{body}' is reduced, and its modes follow the base alone; move the base, or remove "
                f"soft_bodies.{body}.reduced"
            )
        self._anchor_position = state.anchor_position

    def _sum_impulses(self, state: State, load: np.ndarray) -> None:
        self.nodes.gravity[0] = state.gravity
        self.anchors.position[:] = state.anchor_position
        self._sum(self.nodes, self.anchors, load)

    def _sum(self, nodes: kernels.Nodes, anchors: kernels.Anchors, load: np.ndarray) -> None:
        kernels.sum_impulses(
            self._time_step,
            nodes,
            self.forces,
            anchors,
            self.base,
            self._model.actuators.coordinates,
            self._geometry.gradient,
            load,
        )


class RowsOfNodes:
    """The rows of some nodes in a matrix of 3x3 blocks whose rows sum to zero but for the diagonal of masses."""

    def __init__(self, block_pairs: np.ndarray, nodes: np.ndarray):
        """Find the blocks beside the diagonal.

        Args:
            block_pairs: row and column of the stored blocks of the symmetric matrix, shape (block_count, 2).
            nodes: the nodes in rising order, shape (n,).
        """
        first, second = block_pairs.T
        beside, self._count = first != second, len(nodes)
        here, there = (beside & np.isin(one, nodes) for one in (first, second))
        self._block = np.concatenate([np.flatnonzero(here), np.flatnonzero(there)])
        self._here_count = int(here.sum())
        self._node = np.concatenate([first[here], second[there]])
        self._other = np.concatenate([second[here], first[there]])
        self._row = np.searchsorted(nodes, self._node)

    def times(self, blocks: np.ndarray, vectors: np.ndarray) -> np.ndarray:
        """Product without what is on the diagonal beside the negative sums of the rows, shape (n, 3).

        Args:
            blocks: the stored blocks, shape (block_count, 3, 3).
            vectors: shape (node_count, 3).
        """
        some, difference = blocks[self._block], vectors[self._other] - vectors[self._node]
        some[self._here_count :] = some[self._here_count :].transpose(0, 2, 1)
        products = np.einsum("bij,bj->bi", some, difference)
        sums = [np.bincount(self._row, products[:, axis], self._count) for axis in range(3)]
        return np.column_stack(sums)
