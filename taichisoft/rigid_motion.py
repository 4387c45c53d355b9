"""Motion of the rigid bodies between contacts."""

import numpy as np

from taichisoft.kernels import free_motion as kernels
from taichisoft.model import Model
from taichisoft.state import State


class RigidMotion:
    """The rigid bodies of a step.

    Attributes:
        rotation: body axes in the world, shape (rigid_count, 3, 3).
        velocity: linear [mm/s] and angular [rad/s] after the step, without contacts, shape (rigid_count, 6).
        inverse_mass: inverse mass [1/kg] and inertia [1/(kg mm^2)] in world axes, shape (rigid_count, 6, 6).
    """

    def __init__(self, model: Model):
        """Make the buffers."""
        count = len(model.rigid_bodies)
        self._model = model
        self._gravity = model.gravity.reshape(1, 3)
        self._inverse_inertia = np.linalg.inv(model.rigid_inertia)
        self._quaternion, self._linear, self._angular = np.empty((count, 4)), np.empty((count, 3)), np.empty((count, 3))
        self.rotation = np.empty((count, 3, 3))
        self.velocity = np.empty((count, 6))
        self.inverse_mass = np.zeros((count, 6, 6))

    def update(self, state: State) -> None:
        """Fill the attributes for the step that begins with `state`."""
        self._quaternion[:] = state.rigid_rotation
        self._linear[:] = state.rigid_velocity
        self._angular[:] = state.rigid_angular_velocity
        kernels.rigid_motion(
            self._model.scene.time.step,
            self._gravity,
            self._model.rigid_mass,
            self._model.rigid_inertia,
            self._inverse_inertia,
            self._quaternion,
            self._linear,
            self._angular,
            self.rotation,
            self.velocity,
            self.inverse_mass,
        )
