"""Forces from outside on bodies and frames: those that a state asks for, and those that a scene has planned."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from taichisoft.base.rotations import matrices_from_quaternions, quaternion_from_matrix, rotation_from_vector
from taichisoft.mechanics.rigid_body_arrays import MovingFrames, RigidBody
from taichisoft.mechanics.selection import SMALLEST_WEIGHT, embed
from taichisoft.mechanics.soft_body_arrays import SoftBody
from taichisoft.mechanics.state import State
from taichisoft.mesh.volume_mesh import linear_parts
from taichisoft.scene.scene import Scene

UNTIL_ANOTHER = -1
"""Number of time steps of a force that acts until another is asked for."""
MOST_KEPT = 64
"""Places in soft bodies that are kept: finding one compares a point with all elements."""


@dataclass(frozen=True)
class NodeForce:
    """A force on a point of a soft body, spread over the corners of its tetrahedron.

    Attributes:
        node: the corners, shape (4,).
        weight: barycentric weights of the point, shape (4,).
        force: [mN], shape (3,).
        to_rest: inverse of the edges from the first corner at rest [1/mm], shape (3, 3), of a force in axes that turn
            with the tetrahedron; None in those of the world.
    """

    node: np.ndarray
    weight: np.ndarray
    force: np.ndarray
    to_rest: np.ndarray | None

    def at(self, position: np.ndarray) -> np.ndarray:
        """Forces on the corners [mN], shape (4, 3), where the nodes are at `position`."""
        force = self.force
        if self.to_rest is not None:
            left, _, right = np.linalg.svd((position[self.node[1:]] - position[self.node[0]]).T @ self.to_rest)
            left[:, 2] *= np.linalg.det(left @ right)  # a turn, also of an inverted tetrahedron
            force = left @ right @ force
        return np.outer(self.weight, force)


class ExternalForces:
    """Where forces can act, and where those of a state do.

    Attributes:
        names: soft bodies, rigid bodies and frames, which a state has forces on in this order.
        movable: soft bodies, and rigid bodies that no frame carries.
        middle: centres of mass of rigid bodies and pivots of frames at rest [mm], and a place in each soft body, shape
            (len(names), 3).
    """

    def __init__(
        self, scene: Scene, soft: Sequence[SoftBody], rigid: Sequence[RigidBody], frames: MovingFrames
    ) -> None:
        self._soft, self._rigid, self._frames = tuple(soft), tuple(rigid), frames
        self._time = scene.time
        self.names = (*(body.name for body in soft), *(body.name for body in rigid), *frames.names)
        # What carries the force on each: a frame, or -1 for the body itself.
        carriers = [*frames.numbers([None] * len(soft)), *frames.numbers(body.follows for body in rigid)]
        self._carrier = np.array([*carriers, *range(len(frames.names))], dtype=np.int32)
        free = [name for name, carrier in zip(self.names, self._carrier.tolist(), strict=True) if carrier < 0]
        self.movable = tuple(free)
        middles = [*(body.rest_position[0] for body in soft), *(body.start_position for body in rigid)]
        self.middle = np.vstack([*middles, frames.pivot])
        self._places: dict[tuple[int, bytes], tuple[np.ndarray, np.ndarray]] = {}
        step, numbers = scene.time.step, {body.name: len(soft) + number for number, body in enumerate(rigid)}
        self._planned = [
            (round(one.start / step), max(1, round(one.duration / step)), numbers[one.body], np.array(one.force))
            for one in scene.external_forces
        ]

    def is_soft(self, number: int) -> bool:
        """Whether a name is that of a soft body, where a force needs a point."""
        return number < len(self._soft)

    def place(self, number: int, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Corners of the tetrahedron of a soft body around a point at rest [mm], and weights, shape (4,) each."""
        key, body = (number, point.tobytes()), self._soft[number]
        place = self._places.get(key)  # threads share a model
        if place is None:
            node, weight = embed(point[None], body.rest_position, linear_parts(body.elements))
            place = node[0] + body.nodes.start, weight[0]
            if len(self._places) >= MOST_KEPT:
                self._places.clear()
            self._places[key] = place
        return place

    def outside(self, number: int, point: np.ndarray) -> str:
        """How far a point at rest [mm] lies outside a soft body, and what does not; nothing of one in it."""
        if self.place(number, point)[1].min() >= SMALLEST_WEIGHT:
            return ""
        nodes = self._soft[number].rest_position
        away = np.linalg.norm(nodes - point, axis=1)
        low, high, near = (np.round(one, 2).tolist() for one in (nodes.min(0), nodes.max(0), nodes[away.argmin()]))
        return f"lies {away.min():.3g} mm outside; the nearest point is {near}, and the body spans {low} to {high} mm"

    def on_nodes(self, state: State) -> list[NodeForce]:
        """The forces on soft bodies in the step that begins with a state."""
        return [self._node_force(state, number) for number in self._acting(state) if self.is_soft(number)]

    def on_rigid(self, state: State) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
        """Rigid bodies that no frame carries, with forces [mN] and torques about their centres of mass [mN mm]."""
        for number, force, torque, point in self._wrenches(state, state.step):
            if self._carrier[number] < 0:
                lever = self._turn(state, number) @ (point - self.middle[number])
                yield number - len(self._soft), force, torque + np.cross(lever, force)

    def on_frames(self, state: State) -> Iterator[tuple[int, np.ndarray, np.ndarray, np.ndarray]]:
        """Frames, forces [mN] and torques [mN mm] on them and on the bodies they carry, and points at rest [mm]."""
        for number, force, torque, point in self._wrenches(state, state.step):
            if (frame := int(self._carrier[number])) >= 0:
                yield frame, force, torque, point

    def seen(self, state: State) -> np.ndarray:
        """Forces in the step that led to a state, in axes of the world [mN], shape (len(names), 3)."""
        seen, then = np.zeros((len(self.names), 3)), self._when_acting(state)
        for number in self._acting(state):
            if self.is_soft(number):
                seen[number] = self._node_force(state, number).at(then.position).sum(axis=0)
        for number, force, *_ in self._wrenches(then, state.step - 1):
            seen[number] += force
        return seen

    def rest_of(self, state: State, number: int, place: np.ndarray) -> np.ndarray:
        """Where at rest is what is now at a place on a movable body [mm]; of a soft body its nearest node."""
        if not self.is_soft(number):
            centre = state.rigid_position[number - len(self._soft)]
            rest: np.ndarray = self.middle[number] + self._turn(state, number).T @ (place - centre)
            return rest
        body = self._soft[number]
        away = np.linalg.norm(state.position[body.nodes] - place, axis=1)
        return body.rest_position[away.argmin()].copy()

    def motion(self, state: State, number: int, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where a point at rest is now [mm], and its velocity [mm/s], 0 of frames and what they carry."""
        if self.is_soft(number):
            node, weight = self.place(number, point)
            return weight @ state.position[node], weight @ state.velocity[node]
        if (frame := int(self._carrier[number])) >= 0:
            return self._frames.places(state.frame_pose).moved(point[None], frame)[0], np.zeros(3)
        body, arm = number - len(self._soft), self._turn(state, number) @ (point - self.middle[number])
        velocity = state.rigid_velocity[body] + np.cross(state.rigid_angular_velocity[body], arm)
        return state.rigid_position[body] + arm, velocity

    def arrows(self, state: State) -> tuple[np.ndarray, np.ndarray]:
        """Points [mm] and forces [mN] of what acted in the step that led to a state, shape (acting_count, 3) each."""
        seen = self.seen(state)
        pushed, acting = np.flatnonzero(seen.any(axis=1)).tolist(), self._acting(state)
        at = [state.external_force[number, 2] if number in acting else self.middle[number] for number in pushed]
        points = [self.motion(state, number, point)[0] for number, point in zip(pushed, at, strict=True)]
        return np.array(points).reshape(-1, 3), seen[pushed]

    def _acting(self, state: State) -> list[int]:
        numbers: list[int] = state.external_force_steps.nonzero()[0].tolist()
        return numbers

    def _when_acting(self, state: State) -> State:
        """A state with its bodies where the step that led to it had forces in own axes turn with them.

        Velocities lead back there, but for shifts that remove overlap; with theta below 1 to second order.
        """
        turned = state.external_force_own_axes & (self._carrier < 0)
        own = [number for number in self._acting(state) if turned[number]]
        if not own:
            return state
        time, rotation = self._time, state.rigid_rotation.copy()
        for body in (number - len(self._soft) for number in own if not self.is_soft(number)):
            back = rotation_from_vector(-time.step * state.rigid_angular_velocity[body])
            rotation[body] = quaternion_from_matrix(back @ matrices_from_quaternions(rotation[[body]])[0])
        ago = time.step - (time.stage if time.most_linearisations > 1 else 0.0)
        return state.changed(position=state.position - ago * state.velocity, rigid_rotation=rotation)

    def _node_force(self, state: State, number: int) -> NodeForce:
        force, _, point = state.external_force[number]
        (node, weight), to_rest = self.place(number, point), None
        if state.external_force_own_axes[number]:
            rest = self._soft[number].rest_position[node - self._soft[number].nodes.start]
            to_rest = np.linalg.inv((rest[1:] - rest[0]).T)
        return NodeForce(node, weight, force, to_rest)

    def _wrenches(self, state: State, step: int) -> Iterator[tuple[int, np.ndarray, np.ndarray, np.ndarray]]:
        """Numbers of rigid bodies and frames, with forces [mN], torques [mN mm] and points at rest [mm] in a step."""
        for first, count, number, force in self._planned:
            if first <= step < first + count:
                yield number, force, np.zeros(3), self.middle[number]
        for number in self._acting(state):
            if self.is_soft(number):
                continue
            force, torque, point = state.external_force[number]
            if state.external_force_own_axes[number]:
                turn = self._turn(state, number)
                force, torque = turn @ force, turn @ torque
            yield number, force, torque, point

    def _turn(self, state: State, number: int) -> np.ndarray:
        """Rotation of a rigid body or a frame from its rest, shape (3, 3)."""
        if (frame := self._carrier[number]) >= 0:
            turn: np.ndarray = self._frames.places(state.frame_pose).turn[frame]
            return turn
        body = number - len(self._soft)
        turns = np.array([state.rigid_rotation[body], self._rigid[body].start_rotation])
        now, rest = matrices_from_quaternions(turns)
        return now @ rest.T
