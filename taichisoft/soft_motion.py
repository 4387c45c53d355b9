"""Motion of the soft bodies: without contact, and by the impulses of contacts and cavities."""

import numpy as np

from taichisoft.errors import NotPositiveDefinite, SimulationDiverged
from taichisoft.kernels import free_motion as kernels
from taichisoft.model import Model
from taichisoft.placement import rotation_from_vector
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
        self._gravity = model.gravity.reshape(1, 3)
        self._base = np.vstack([model.base_pivot, np.zeros(3)])
        self._base_turn = np.empty((1, 3, 3))
        self._position, self._node_velocity, self._impulse = (np.empty((model.node_count, 3)) for _ in range(3))
        self._cavity_impulse = np.empty(len(model.cavities.names))
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
        force = self._model.elasticity.assemble(state.position, state.velocity)
        self._factorise(state)
        self._balance_momentum(state, force)
        self.velocity = state.velocity + self._model.elasticity.solver.solve(self._impulse)

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

    def _balance_momentum(self, state: State, force: np.ndarray) -> None:
        elasticity, cavities = self._model.elasticity, self._model.cavities
        assert elasticity is not None
        time_step = self._model.scene.time.step
        self._base[1] = state.base_translation
        self._base_turn[0] = rotation_from_vector(state.base_rotation)
        self._position[:] = state.position
        self._node_velocity[:] = state.velocity
        self._cavity_impulse[:] = np.where(state.cavity_volume_imposed, 0.0, time_step * state.cavity_target)
        kernels.soft_impulse(
            time_step,
            self._gravity,
            self._base,
            self._base_turn,
            elasticity.rest_position,
            self._position,
            self._node_velocity,
            elasticity.node_mass,
            elasticity.node_rayleigh_mass,
            elasticity.node_lag,
            elasticity.anchor_stiffness,
            force,
            self._cavity_impulse,
            cavities.entry_start,
            cavities.entry_node,
            cavities.gradient,
            self._impulse,
        )
