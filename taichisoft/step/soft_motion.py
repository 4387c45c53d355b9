"""Motion of the soft bodies: without contact, and by the impulses of contacts and cavities."""

import numpy as np

from taichisoft.bodies.rotations import rotation_from_vector
from taichisoft.errors import NotPositiveDefinite, SimulationDiverged
from taichisoft.kernels import free_motion as kernels
from taichisoft.model import Model
from taichisoft.state import State


class SoftMotion:
    """The soft bodies of a step.

    Attributes:
        velocity: of the nodes after the step, without the impulses of contacts and of imposed volumes [mm/s], shape
            (node_count, 3).
    """

    def __init__(self, model: Model):
        """Make the buffers."""
        self._model = model
        self._base = np.vstack([model.base_pivot, np.zeros(3)])
        self._base_turn = np.empty((1, 3, 3))
        self._position, self._node_velocity, self._force = (np.empty((model.node_count, 3)) for _ in range(3))
        self._pressure = np.empty(len(model.cavities.names))
        if model.elasticity is not None:
            mass = model.elasticity.node_mass[:, None]
            self._weight = mass * model.gravity
            self._drag = mass * model.elasticity.node_rayleigh_mass[:, None]
            self._anchored = np.flatnonzero(model.elasticity.anchor_stiffness).astype(np.int32)
        self.velocity = np.zeros((model.node_count, 3))

    def update(self, state: State) -> None:
        """Implicit Euler with the rotations of the start of the step and imposed pressures p.

        v + A^-1 h (f + M g + p dV/dx - a M v - (h + b) K v)

        Raises:
            SimulationDiverged: the system matrix is not positive definite.
        """
        if self._model.elasticity is None:
            return
        self._model.cavities.update(state.position)
        elastic_force = self._model.elasticity.assemble(state.position, state.velocity)
        self._factorise(state)
        # In place: the memory of large results that are thrown away costs more than the sums.
        np.multiply(self._drag, state.velocity, out=self._force)
        np.subtract(self._weight, self._force, out=self._force)
        self._force += elastic_force
        self._add_anchors_and_pressures(state)
        self._force *= self._model.scene.time.step
        self.velocity = self.response(self._force)
        self.velocity += state.velocity

    def response(self, node_impulse: np.ndarray) -> np.ndarray:
        """Change of velocity [mm/s], (node_count, 3), by impulses on the nodes [mN s], (node_count, 3)."""
        assert self._model.elasticity is not None
        return self._model.elasticity.solver.solve(node_impulse)

    def _factorise(self, state: State) -> None:
        assert self._model.elasticity is not None
        try:
            self._model.elasticity.solver.factorise()
        except NotPositiveDefinite as error:
            body = self._model.body_of_node(error.node)
            raise SimulationDiverged(body, state.step, str(error), "a smaller time step") from error

    def _add_anchors_and_pressures(self, state: State) -> None:
        elasticity, cavities = self._model.elasticity, self._model.cavities
        assert elasticity is not None
        self._base[1] = state.base_translation
        self._base_turn[0] = rotation_from_vector(state.base_rotation)
        self._position[:] = state.position
        self._node_velocity[:] = state.velocity
        self._pressure[:] = np.where(state.cavity_volume_imposed, 0.0, state.cavity_target)
        kernels.add_anchors_and_pressures(
            self._base,
            self._base_turn,
            self._anchored,
            elasticity.anchor_stiffness,
            elasticity.node_lag,
            elasticity.rest_position,
            self._position,
            self._node_velocity,
            self._pressure,
            cavities.entry_start,
            cavities.entry_node,
            cavities.gradient,
            self._force,
        )
