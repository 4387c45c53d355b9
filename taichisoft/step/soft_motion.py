"""Linearised motion of the soft bodies by forces and by the impulses of contacts and actuators."""

import numpy as np

from taichisoft.actuators.model_actuators import ActuatorGeometry
from taichisoft.bodies.elasticity import Elasticity, ElasticSystem
from taichisoft.bodies.rotations import rotation_from_vector
from taichisoft.errors import NotPositiveDefinite, SimulationDiverged
from taichisoft.model import Model
from taichisoft.state import State
from taichisoft.step.kernels import loads as kernels


class SoftMotion:
    """The soft bodies of a step; made only for models with soft bodies.

    Attributes:
        known_velocity: node velocities whose change the step's equations give [mm/s], shape (node_count, 3).
        system: elastic forces, matrix and direct solver of the step.
        nodes: loads on the nodes, at the start of the step.
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
        self._model = model
        self._geometry = geometry
        self.system = ElasticSystem(elasticity)
        self.nodes = kernels.Nodes(
            mass=elasticity.node_mass,
            drag=elasticity.node_mass * elasticity.node_rayleigh_mass,
            gravity=np.empty((1, 3)),
            position=self.system.position,
            velocity=self.system.velocity,
            elastic=self.system.force,
            impulse=np.empty((model.node_count, 3)),
        )
        self._young_modulus: np.ndarray | None = None  # of the system's elements
        self.anchors = kernels.Anchors(
            node=model.anchored_nodes,
            stiffness=elasticity.anchor_stiffness,
            lag=elasticity.anchor_lag,
            position=np.empty((len(model.anchored_nodes), 3)),
        )
        self.base = kernels.Base(place=np.vstack([model.base_pivot, np.zeros(3)]), turn=np.empty((1, 3, 3)))
        self._base_rotation: np.ndarray | None = None  # rotation vector of `base.turn`
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
        if state.young_modulus is not self._young_modulus:
            self._young_modulus = state.young_modulus
            stiffening = state.young_modulus / self._model.young_modulus
            self.system.scale_stiffness(stiffening[self._model.element_material])
        self.system.assemble()
        self._sum_impulses(state, load)
        has_inertia = self._model.scene.time.dynamics == "second order"
        self.factorise(state, self.nodes.impulse, state.velocity if has_inertia else np.zeros(3))

    def response(self, node_impulse: np.ndarray) -> np.ndarray:
        """Change of velocity [mm/s], shape (node_count, 3), by impulses on the nodes [mN s], shape (node_count, 3)."""
        return self.system.solver.solve(node_impulse)

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
        try:
            self.system.solver.factorise(node_impulse)
        except NotPositiveDefinite as error:
            body = self._model.body_of_node(error.node)
            raise SimulationDiverged(body, state.step, str(error), "a smaller time step") from error

    def leave_out_forces(self) -> None:
        """Restart from rest with the impulses of contacts only."""
        self.known_velocity[:] = 0.0
        self.system.solver.leave_out_right_hand_side()

    def _sum_impulses(self, state: State, load: np.ndarray) -> None:
        self.nodes.gravity[0] = state.gravity
        self.anchors.position[:] = state.anchor_position
        self.base.place[1] = state.base_translation
        if state.base_rotation is not self._base_rotation:
            self._base_rotation = state.base_rotation
            self.base.turn[0] = rotation_from_vector(state.base_rotation)
        kernels.sum_impulses(
            self._model.scene.time.step,
            self.nodes,
            self.anchors,
            self.base,
            self._model.actuators.coordinates,
            self._geometry.gradient,
            load,
        )
