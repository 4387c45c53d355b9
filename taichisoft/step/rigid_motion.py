"""Motion of the rigid bodies: without contact, by impulses, and along a step."""

import numpy as np

from taichisoft.bodies.kernels import rigid_integration as kernels
from taichisoft.model import Model
from taichisoft.state import State


class RigidMotion:
    """The rigid bodies of a step.

    Attributes:
        state: poses, velocities and impulses as the kernels see them.
    """

    def __init__(self, model: Model):
        """Make the work space."""
        count = len(model.rigid_bodies)
        self._time_step = model.scene.time.step
        self._bodies = kernels.RigidBodies(
            mass=np.empty(count),
            inertia=np.empty((count, 3, 3)),
            inverse_inertia=np.empty((count, 3, 3)),
            gravity=np.empty((1, 3)),
        )
        self.take_masses(model)
        self.state = kernels.RigidState(
            position=np.empty((count, 3)),
            quaternion=np.empty((count, 4)),
            linear=np.empty((count, 3)),
            angular=np.empty((count, 3)),
            rotation=np.empty((count, 3, 3)),
            free=np.empty((count, 6)),
            inverse_mass=np.zeros((count, 6, 6)),
            impulse=np.zeros((count, 6)),
        )
        self._ahead = self.state._replace(position=np.empty((count, 3)), quaternion=np.empty((count, 4)))

    def take_masses(self, model: Model) -> None:
        """Let the bodies have the masses of a model, this one or a variant of it."""
        self._bodies.mass[:], self._bodies.inertia[:] = model.rigid_mass, model.rigid_inertia
        self._bodies.inverse_inertia[:] = np.linalg.inv(model.rigid_inertia)
        self._external_forces = _external_forces(model)

    def solve_free_motion(self, state: State) -> None:
        """Begin a step: poses and velocities from `state`, no impulses yet."""
        rigid = self.state
        if not len(rigid.position):
            return
        rigid.position[:], rigid.quaternion[:] = state.rigid_position, state.rigid_rotation
        rigid.linear[:], rigid.angular[:] = state.rigid_velocity, state.rigid_angular_velocity
        rigid.impulse[:] = 0.0
        self._shift: tuple[np.ndarray, np.ndarray] | None = None
        self._bodies.gravity[0] = state.gravity
        kernels.solve_free_motion(self._time_step, self._bodies, rigid)
        for first_step, step_count, body, acceleration in self._external_forces:
            if first_step <= state.step < first_step + step_count:
                rigid.free[body, :3] += self._time_step * acceleration

    def apply_impulses(self) -> None:
        """Velocities by the impulses."""
        if len(self.state.position):
            kernels.apply_impulses(self.state)

    def end_poses(self) -> tuple[np.ndarray, np.ndarray]:
        """Where the present velocities lead to: positions [mm] (rigid_count, 3) and quaternions (rigid_count, 4)."""
        ahead = self._ahead
        ahead.position[:], ahead.quaternion[:] = self.state.position, self.state.quaternion
        if len(ahead.position):
            kernels.integrate(self._time_step, ahead)
        return ahead.position.copy(), ahead.quaternion.copy()

    def begin_shift(self, linear: np.ndarray, angular: np.ndarray) -> None:
        """Take the present velocities for those of a shift, and these for the bodies' own, each (rigid_count, 3)."""
        self._shift = self.state.linear.copy(), self.state.angular.copy()
        self.state.linear[:], self.state.angular[:] = linear, angular

    def integrate(self) -> None:
        """End the step: poses by the velocities, and by those of a shift, which do not stay."""
        rigid = self.state
        if not len(rigid.position):
            return
        kernels.integrate(self._time_step, rigid)
        if self._shift is not None:
            own = rigid.linear.copy(), rigid.angular.copy()
            rigid.linear[:], rigid.angular[:] = self._shift
            kernels.integrate(self._time_step, rigid)
            rigid.linear[:], rigid.angular[:] = own


def _external_forces(model: Model) -> list[tuple[int, int, int, np.ndarray]]:
    """First step, number of steps, rigid body and acceleration [mm/s^2] of every external force of the scene."""
    time_step = model.scene.time.step
    names = [body.name for body in model.rigid_bodies]
    found = []
    for one in model.scene.external_forces:
        body = names.index(one.body)
        step_count = max(1, round(one.duration / time_step))
        found.append((round(one.start / time_step), step_count, body, np.array(one.force) / model.rigid_mass[body]))
    return found
