"""Linearised motion of the soft bodies by forces and by the impulses of contacts and actuators."""

import numpy as np

from taichisoft.contact.model import Model
from taichisoft.errors import ControlError, NotPositiveDefinite, SimulationDiverged
from taichisoft.mechanics.elasticity import Elasticity, ElasticSystem
from taichisoft.mechanics.external_forces import NodeForce
from taichisoft.mechanics.kernels.sparse_columns import SparseColumns
from taichisoft.mechanics.model_actuators import ActuatorGeometry
from taichisoft.mechanics.state import State
from taichisoft.step.kernels import loads as kernels


class SoftMotion:
    """The soft bodies of a step; made only for models with soft bodies.

    Attributes:
        known_velocity: node velocities whose change the step's equations give [mm/s], shape (node_count, 3).
        system: elastic forces, matrix and direct solver of the step.
        nodes: loads on the nodes, at the start of the step.
        forces: constant forces on nodes.
        external: the forces from outside that act in the step.
        anchors: springs that hold nodes, with the lag at the start of a step; `no_anchors` are none.
        frames: where the frames are at the end of the step.
    """

    def __init__(self, model: Model, elasticity: Elasticity, geometry: ActuatorGeometry):
        self._model, self._time_step = model, model.scene.time.step
        self._inertia = float(model.scene.time.dynamics == "inertial")
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
            frame=model.anchor_frame,
            stiffness=elasticity.anchor_stiffness,
            lag=elasticity.anchor_lag,
            position=np.empty((len(model.anchored_nodes), 3)),
        )
        no_nodes = {name: getattr(self.anchors, name)[:0].copy() for name in ("node", "frame")}
        self.no_anchors = self.anchors._replace(**no_nodes)
        pushed = np.flatnonzero(is_pushed)
        self._rigidity = elasticity.rigidity
        self.forces = kernels.ConstantForces(node=pushed.astype(np.int32), force=constant[pushed])
        frame_count = len(model.frames.names)
        self.frames = kernels.Frames(turn=np.empty((frame_count, 3, 3)), shift=np.empty((frame_count, 3)))
        self._frame_pose: np.ndarray | None = None  # of `frames`
        self._frame_of_modes = model.soft_frame[[body.modes is not None for body in model.soft_bodies]]
        self._anchor_position: np.ndarray | None = None  # the last that was checked
        self.known_velocity = np.zeros((model.node_count, 3))
        self.external: list[NodeForce] = []
        self._pushed = np.zeros((0, 4), dtype=np.int32)
        self._load = np.empty(model.actuators.count)  # reused: a launch with a new array takes longer than its loops

    def begin(self, state: State, load: np.ndarray) -> None:
        """Linearise the step with the rotations of its start, and begin to solve it.

        Without contact and with known efforts p of coordinates q the velocities after the step are v + A^-1 h (f + M g
        + p dq/dx - a M v - (s + b) K v), without inertia A^-1 h (f + M g + p dq/dx).
        """
        self.system.position[:], self.system.velocity[:] = state.position, state.velocity
        self.follow(state)
        if self.system.reduced is not None:
            self._refuse_moved_anchors(state)
            self.system.reduced.begin(*self._frames_of_modes, state.gravity, self._time_step, self._inertia)
        if state.young_modulus is not self._young_modulus:
            self._young_modulus = state.young_modulus
            stiffening = state.young_modulus / self._model.young_modulus
            self.system.scale_stiffness(stiffening[self._model.element_material])
        self.system.assemble()
        self._sum_impulses(state, load, self.anchors)
        known_velocity = self.system.velocity
        if not self._inertia:
            known_velocity = np.where(self.system.modes.start[:, None] >= 0, known_velocity, 0.0)
        impulse, reduced = self.nodes.impulse, self.system.reduced
        if reduced is not None:
            impulse = reduced.right_hand_side(impulse, self._time_step)
        self.factorise(state, impulse, known_velocity)

    def end_velocity(self, moving: np.ndarray, after: np.ndarray) -> np.ndarray:
        """The velocities with which the nodes continue [mm/s], shape (node_count, 3), of those of the step and after
        it.

        What a rigid spring holds continues as it moved in the step. It has no inertia of its own to speak of, and to
        be at its place at the end of every step a velocity after the step would swing about that of the place for
        ever.
        """
        return after if moving is after else after + self._rigidity * (moving - after)

    def response(self, node_impulse: np.ndarray) -> np.ndarray:
        """Change of velocity [mm/s], shape (node_count, 3), by impulses on the nodes [mN s], shape (node_count, 3)."""
        return self.response_of_unknowns(self.on_unknowns(node_impulse))

    def response_of_unknowns(self, impulse: np.ndarray) -> np.ndarray:
        """Change of velocity of the nodes [mm/s] by impulses on the unknowns [mN s], shape (node_count, 3) each."""
        return self.expanded(self.system.solver.solve(impulse))

    def expanded(self, rates: np.ndarray) -> np.ndarray:
        """Velocities of the nodes [mm/s] by rates of the unknowns, shape (node_count, 3) each."""
        return rates if self.system.reduced is None else self.system.reduced.node_velocity(rates)

    def on_unknowns(self, node_impulse: np.ndarray) -> np.ndarray:
        """Impulses on the unknowns, which are nodes and amplitudes, by those on the nodes [mN s], (node_count, 3)."""
        return node_impulse if self.system.reduced is None else self.system.reduced.on_unknowns(node_impulse)

    def rates(self, node_velocity: np.ndarray) -> np.ndarray:
        """Rates of the unknowns at velocities of the nodes [mm/s], shape (node_count, 3) each."""
        return node_velocity if self.system.reduced is None else self.system.reduced.rates(node_velocity)

    def resting_velocity(self) -> np.ndarray:
        """Velocities of the nodes where no unknown changes [mm/s], shape (node_count, 3): those of the frames, or 0."""
        reduced = self.system.reduced
        if reduced is None:
            return np.zeros_like(self.known_velocity)
        moved = self.known_velocity - reduced.node_velocity(self.rates(self.known_velocity))
        return np.where(reduced.is_reduced, moved, 0.0)

    def impulses(self, state: State, load: np.ndarray, with_anchors: bool = True) -> np.ndarray:
        """Impulses on the nodes at the place of the linearisation [mN s], with gravity and frames of a state."""
        self.follow(state)
        self._sum_impulses(state, load, self.anchors if with_anchors else self.no_anchors)
        return self.nodes.impulse.copy()

    def complete(self, columns: SparseColumns, multipliers: np.ndarray, count: int) -> np.ndarray:
        """Velocities of the nodes after the step [mm/s], shape (node_count, 3), with impulses in the rows of `columns`.

        Arguments are those of `Cholesky.complete`.
        """
        return self._moved(self.system.solver.complete(columns, multipliers, count))

    def complete_with(self, node_impulse: np.ndarray) -> np.ndarray:
        """The same with impulses on the nodes [mN s], shape (node_count, 3)."""
        return self._moved(self.system.solver.complete_with(self.on_unknowns(node_impulse)))

    def _moved(self, change: np.ndarray) -> np.ndarray:
        velocity = self.expanded(change)
        velocity += self.known_velocity
        return velocity

    def factorise(self, state: State, impulse: np.ndarray, known_velocity: np.ndarray) -> None:
        """Factorise the matrix of the system, and begin to solve for the change of velocities by impulses on the
        unknowns.

        It is added to `known_velocity`, shape (node_count, 3) or (3,).
        """
        self.known_velocity[:] = known_velocity
        try:
            self.system.solver.factorise(impulse)
        except NotPositiveDefinite as error:
            body = self._model.body_of_node(error.node)
            raise SimulationDiverged(body, state.step, str(error), "a smaller time step") from error

    def leave_out_forces(self) -> None:
        """Restart from rest with the impulses of contacts only."""
        self.known_velocity[:] = 0.0
        self.system.solver.leave_out_right_hand_side()

    def follow(self, state: State) -> None:
        """Have the frames where a state has them, and its forces from outside act."""
        self.external = self._model.external_forces.on_nodes(state)
        if state.frame_pose is not self._frame_pose:
            places, self._frame_pose = self._model.places(state), state.frame_pose
            self.frames.turn[:], self.frames.shift[:] = places.turn, places.shift
            self._frames_of_modes = places.turn[self._frame_of_modes], places.shift[self._frame_of_modes]

    def _refuse_moved_anchors(self, state: State) -> None:
        """Modes follow a frame; they cannot follow anchors that move by themselves."""
        if state.anchor_position is self._anchor_position:
            return
        nodes = self._model.anchored_nodes
        moved = (state.anchor_position != self._model.rest_position[nodes]).any(axis=1)
        moved &= self.system.modes.start[nodes] >= 0
        if moved.any():
            body = self._model.body_of_node(int(nodes[moved.argmax()]))
            raise ControlError(
                f"anchor_positions: '{body}' is reduced, and its modes follow a frame alone; move that, or remove "
                f"soft_bodies.{body}.reduced"
            )
        self._anchor_position = state.anchor_position

    def _sum_impulses(self, state: State, load: np.ndarray, anchors: kernels.Anchors) -> None:
        self.nodes.gravity[0] = state.gravity
        self.anchors.position[:] = state.anchor_position
        if self.external or self._pushed.size:
            self.nodes.impulse[self._pushed] = 0.0  # of reduced bodies, where nothing else acts
            self._pushed = np.array([one.node for one in self.external], dtype=np.int32)
        self._load[:] = load
        kernels.sum_impulses(
            self._time_step,
            self.nodes,
            self.forces,
            anchors,
            self.frames,
            self._model.actuators.coordinates,
            self._geometry.gradient,
            self._load,
        )
        self.add_external(self.nodes.impulse)

    def add_external(self, impulse: np.ndarray) -> None:
        """Add the impulses of the forces from outside [mN s], where the bodies are, to those of a step."""
        for one in self.external:
            impulse[one.node] += self._time_step * one.at(self.system.position)
