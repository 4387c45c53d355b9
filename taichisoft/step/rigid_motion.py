"""Motion of the rigid bodies in a step: free motion, impulses, and integration."""

import math

import numpy as np

from taichisoft.base.rotations import matrices_from_quaternions, quaternion_from_matrix, vector_from_rotation
from taichisoft.contact.model import Model
from taichisoft.mechanics.kernels import rigid_integration as kernels
from taichisoft.mechanics.state import State
from taichisoft.scene.rigid_body import RigidSpringsSettings
from taichisoft.step.solution import moving_velocity

MOVE_TIME = 0.01
"""Longest time of a move to an equilibrium [s], in which inertia keeps free rigid bodies back."""
WEIGHTLESS = 1e-3
"""Share of the masses that is left where they have no say [-]."""
FALL = 0.45
"""Longest free fall in such a move, in parts of the alarm distance: contacts are searched within half of it."""


class RigidMotion:
    """The rigid bodies of a step; those that frames carry have the velocities that lead to where these are at its end.

    Attributes:
        state: poses, velocities and impulses in arrays of kernels.
        carried: the bodies that frames carry.
    """

    def __init__(self, model: Model):
        count = len(model.rigid_bodies)
        self._time_step, self._theta = model.scene.time.step, model.scene.time.theta
        self._longest_fall = FALL * model.scene.contact.alarm_distance
        self._is_static = model.scene.time.dynamics == "static"
        self.carried, self._external_forces = CarriedBodies(model), model.external_forces
        bodies = enumerate(model.rigid_bodies)
        self._springs = [BodySprings(model, i, one.springs) for i, one in bodies if one.springs is not None]
        self._bodies = kernels.RigidBodies(
            mass=np.empty(count),
            inertia=np.empty((count, 3, 3)),
            inverse_inertia=np.empty((count, 3, 3)),
            gravity=np.empty((1, 3)),
        )
        self.set_masses(model)
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
        self._end = self.state._replace(
            position=np.empty((count, 3)),
            quaternion=np.empty((count, 4)),
            linear=np.empty((count, 3)),
            angular=np.empty((count, 3)),
        )

    def set_masses(self, model: Model) -> None:
        """Set the masses of a model, this one or a variant of it."""
        self._mass, self._inertia = model.rigid_mass, model.rigid_inertia
        self._set_inertia(1.0)

    def _set_inertia(self, factor: float) -> None:
        self._bodies.mass[:], self._bodies.inertia[:] = factor * self._mass, factor * self._inertia
        self._bodies.inverse_inertia[:] = np.linalg.inv(self._bodies.inertia)

    def _inertia_factor(self, state: State) -> float:
        """What masses count in a static step, whose own length means nothing: there are no motions in a move.

        A move of time t from rest with the inertia M is one of a step h with (h / t)^2 M, under the same forces.
        """
        if not self._is_static:
            return 1.0
        gravity = float(np.linalg.norm(state.gravity))
        move_time = MOVE_TIME if gravity == 0.0 else min(MOVE_TIME, math.sqrt(self._longest_fall / gravity))
        return (self._time_step / move_time) ** 2

    def begin(self, state: State) -> None:
        """Begin a step with the poses and velocities of `state`; compute the velocities after it without impulses."""
        rigid = self.state
        self._before = np.concatenate([state.rigid_velocity, state.rigid_angular_velocity], axis=1)
        if not len(rigid.position):
            return
        rigid.position[:], rigid.quaternion[:] = state.rigid_position, state.rigid_rotation
        rigid.linear[:], rigid.angular[:] = state.rigid_velocity, state.rigid_angular_velocity
        rigid.impulse[:] = 0.0
        factor = self._inertia_factor(state)
        if self._is_static:
            self._set_inertia(factor)
        self._bodies.gravity[0] = state.gravity / factor
        kernels.solve_free_motion(self._time_step, self._bodies, rigid)
        if self._theta < 1.0:
            kernels.solve_free_turning(self._time_step, self._theta, self._bodies, rigid)
        self.carried.begin(state, self._time_step, self._theta, rigid)
        for body, force, torque in self._external_forces.on_rigid(state):
            rigid.free[body, :3] += self._time_step / factor * (force / self._mass[body])
            rigid.free[body, 3:] += self._time_step * (rigid.inverse_mass[body, 3:, 3:] @ torque)
        for springs in self._springs:
            springs.pull(state, self._time_step, self._theta, rigid)

    def weightless(self) -> tuple[np.ndarray, np.ndarray]:
        """A thousandth of the masses, and inverse masses with springs of bodies of so little mass, 0 of carried ones.

        Masses slow the approach to an equilibrium, and have no say in it. Both have the shape (rigid_count, 6, 6).
        """
        turn, inverse = self.state.rotation, self.state.inverse_mass.copy()
        mass = np.zeros_like(inverse)
        mass[:, :3, :3] = self._bodies.mass[:, None, None] * np.eye(3)
        mass[:, 3:, 3:] = turn @ self._bodies.inertia @ turn.transpose(0, 2, 1)
        moves = inverse.any(axis=(1, 2))
        inverse[moves] = np.linalg.inv(np.linalg.inv(inverse[moves]) - (1.0 - WEIGHTLESS) * mass[moves])
        return WEIGHTLESS * mass, inverse

    def apply_impulses(self) -> None:
        """Apply the impulses to the velocities of the bodies."""
        if len(self.state.position):
            kernels.apply_impulses(self.state)

    @property
    def velocity(self) -> np.ndarray:
        """Linear [mm/s] and angular [rad/s] velocities, shape (rigid_count, 6)."""
        return np.concatenate([self.state.linear, self.state.angular], axis=1)

    def moving_velocity(self, velocity: np.ndarray) -> np.ndarray:
        """The velocities along which the step moves the bodies that have others after it, shape (rigid_count, 6)."""
        return self.end_velocity(moving_velocity(self._theta, self._before, velocity))

    def end_velocity(self, velocity: np.ndarray) -> np.ndarray:
        """Velocities with which the bodies continue: those that frames carry as they moved, shape (rigid_count, 6)."""
        if self._theta == 1.0 or not len(self.carried.index):
            return velocity
        end = velocity.copy()
        end[self.carried.index] = self.carried.velocity
        return end

    def end_poses(self, *velocities: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions and quaternions after moving with each of the velocities in turn, over the whole time step.

        Velocities are linear [mm/s] and angular [rad/s], each of shape (rigid_count, 6).
        """
        end = self._end
        end.position[:], end.quaternion[:] = self.state.position, self.state.quaternion
        for velocity in velocities if len(end.position) else ():
            end.linear[:], end.angular[:] = velocity[:, :3], velocity[:, 3:]
            kernels.integrate(self._time_step, end)
        if len(self.carried.index):
            self.carried.place(end)
        return end.position.copy(), end.quaternion.copy()


class CarriedBodies:
    """Rigid bodies that frames carry.

    Attributes:
        index: their numbers among the rigid bodies, shape (carried_count,).
        frame: number of the frame that carries each, shape (carried_count,).
        position: centres of mass where the frames are at the end of the step [mm], shape (carried_count, 3).
        velocity: with which the step leads there [mm/s] and [rad/s], shape (carried_count, 6).
    """

    def __init__(self, model: Model):
        self.index = np.flatnonzero(model.rigid_frame >= 0)
        self.frame = model.rigid_frame[self.index]
        bodies = [model.rigid_bodies[index] for index in self.index]
        self._frames = model.frames
        self._start = np.array([body.start_position for body in bodies]).reshape(-1, 3)
        self._start_turn = matrices_from_quaternions(np.array([b.start_rotation for b in bodies]).reshape(-1, 4))
        self.position, self._quaternion = self._start, np.zeros((len(bodies), 4))
        self.velocity = np.zeros((len(bodies), 6))

    def begin(self, state: State, time_step: float, theta: float, rigid: kernels.RigidState) -> None:
        """Give them the velocities of the step, which no impulse changes.

        What sticks to them moves along (1 - theta) v0 + theta v. It keeps its place on them where v, after the step, is
        u + (1 - theta) (u - u0) with their own velocities u of the step and u0 of the last.
        """
        some = self.index
        if not len(some):
            return
        places = self._frames.places(state.frame_pose)
        turn = places.turn[self.frame]
        self.position = np.einsum("bij,bj->bi", turn, self._start) + places.shift[self.frame]
        turned = turn @ self._start_turn
        self._quaternion = np.array([quaternion_from_matrix(one) for one in turned])
        now = matrices_from_quaternions(state.rigid_rotation[some])
        rigid.linear[some] = (self.position - state.rigid_position[some]) / time_step
        rigid.angular[some] = [
            vector_from_rotation(after @ before.T) / time_step for after, before in zip(turned, now, strict=True)
        ]
        self.velocity = np.hstack([rigid.linear[some], rigid.angular[some]])
        rigid.free[some] = self.velocity
        if theta < 1.0:
            before = np.hstack([state.rigid_velocity[some], state.rigid_angular_velocity[some]])
            rigid.free[some] += (1.0 - theta) * (self.velocity - before)
        rigid.inverse_mass[some] = 0.0

    def place(self, end: kernels.RigidState) -> None:
        """Put them where they are at the end of the step, to the last bit."""
        end.position[self.index], end.quaternion[self.index] = self.position, self._quaternion


class BodySprings:
    """Springs between a rigid body and a frame, or a place in space."""

    def __init__(self, model: Model, body: int, springs: RigidSpringsSettings):
        self._body, self._frames = body, model.frames
        (self._frame,) = model.frames.numbers([springs.follows])
        self._springs, self._start = springs, model.rigid_bodies[body].start_position
        self._start_turn = matrices_from_quaternions(model.rigid_bodies[body].start_rotation[None])[0]

    def pull(self, state: State, time_step: float, theta: float, rigid: kernels.RigidState) -> None:
        """Let them act implicitly, with the displacement d, the lag b and s = theta h:

        (M + s (s + b) K) v = M v_free - h K (d + (1 - theta) (s + b) v0).
        """
        body, springs, place, turn = self._body, self._springs, self._start, self._start_turn
        if self._frame >= 0:
            places = self._frames.places(state.frame_pose)
            place, turn = places.moved(place[None], self._frame)[0], places.turn[self._frame] @ turn
        off = vector_from_rotation(matrices_from_quaternions(state.rigid_rotation[[body]])[0] @ turn.T)
        stiffness = np.repeat([springs.stiffness, springs.angular_stiffness], 3)
        mass = np.linalg.inv(rigid.inverse_mass[body])
        load = mass @ rigid.free[body] - time_step * stiffness * np.append(rigid.position[body] - place, off)
        stage = theta * time_step
        lag = stage + springs.rayleigh_stiffness
        if theta < 1.0:
            before = np.append(state.rigid_velocity[body], state.rigid_angular_velocity[body])
            load -= time_step * (1.0 - theta) * lag * stiffness * before
        mass += np.diag(stage * lag * stiffness)
        rigid.inverse_mass[body] = np.linalg.inv(mass)
        rigid.free[body] = rigid.inverse_mass[body] @ load
