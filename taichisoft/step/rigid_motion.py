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
        impulse: by the contacts, linear [mN s] and angular [mN mm s], shape (rigid_count, 6).
        linear, angular: velocities before the step, then after it [mm/s] and [rad/s], shape (rigid_count, 3).
        position, quaternion: poses before the step, then after it [mm] and (w, x, y, z), shapes (rigid_count, 3) and
            (rigid_count, 4).
    """

    def __init__(self, model: Model):
        """Make the buffers."""
        count = len(model.rigid_bodies)
        self._model = model
        self._gravity = model.gravity.reshape(1, 3)
        self._inverse_inertia = np.linalg.inv(model.rigid_inertia)
        self.position, self.quaternion = np.empty((count, 3)), np.empty((count, 4))
        self.linear, self.angular = np.empty((count, 3)), np.empty((count, 3))
        self.rotation = np.empty((count, 3, 3))
        self.velocity = np.empty((count, 6))
        self.inverse_mass = np.zeros((count, 6, 6))
        self.impulse = np.zeros((count, 6))
        self._pushes = _pushes(model)

    def update(self, state: State) -> None:
        """Begin a step: poses and velocities from `state`, no impulses yet."""
        self.position[:], self.quaternion[:] = state.rigid_position, state.rigid_rotation
        self.linear[:], self.angular[:] = state.rigid_velocity, state.rigid_angular_velocity
        self.impulse[:] = 0.0
        kernels.rigid_motion(
            self._model.scene.time.step,
            self._gravity,
            self._model.rigid_mass,
            self._model.rigid_inertia,
            self._inverse_inertia,
            self.quaternion,
            self.linear,
            self.angular,
            self.rotation,
            self.velocity,
            self.inverse_mass,
        )
        time_step = self._model.scene.time.step
        for first_step, step_count, body, acceleration in self._pushes:
            if first_step <= state.step < first_step + step_count:
                self.velocity[body, :3] += time_step * acceleration

    def push(self) -> None:
        """Velocities by the impulses."""
        kernels.push_rigid(self.inverse_mass, self.impulse, self.velocity, self.linear, self.angular)

    def move(self) -> None:
        """End the step: poses by the velocities."""
        time_step = self._model.scene.time.step
        kernels.move_rigid(time_step, self.linear, self.angular, self.position, self.quaternion)


def _pushes(model: Model) -> list[tuple[int, int, int, np.ndarray]]:
    """First step, number of steps, rigid body and acceleration [mm/s^2] of every push of the scene."""
    time_step = model.scene.time.step
    names = [body.name for body in model.rigid_bodies]
    pushes = []
    for push in model.scene.pushes:
        body = names.index(push.body)
        step_count = max(1, round(push.duration / time_step))
        pushes.append((round(push.start / time_step), step_count, body, np.array(push.force) / model.rigid_mass[body]))
    return pushes
