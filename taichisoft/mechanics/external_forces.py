"""Forces from outside on bodies and frames: those that a state asks for, and those that a scene has planned."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from taichisoft.base.rotations import matrices_from_quaternions
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
    """

    def __init__(
        self, scene: Scene, soft: Sequence[SoftBody], rigid: Sequence[RigidBody], frames: MovingFrames
    ) -> None:
        self._soft, self._rigid, self._frames = tuple(soft), tuple(rigid), frames
        self.names = (*(body.name for body in (*soft, *rigid)), *frames.names)
        # What carries the force on each: a frame, or -1 for the body itself.
        carriers = [*frames.numbers([None] * len(soft)), *frames.numbers(body.follows for body in rigid)]
        self._carrier = np.array([*carriers, *range(len(frames.names))], dtype=np.int32)
        middles = [*(body.rest_position.mean(axis=0) for body in soft), *(body.start_position for body in rigid)]
        self.middle = np.vstack([*middles, frames.pivot])
        self._places: dict[tuple[int, bytes], tuple[np.ndarray, np.ndarray]] = {}
        names, step = [body.name for body in rigid], scene.time.step
        self._planned = [
            (round(one.start / step), max(1, round(one.duration / step)), names.index(one.body), np.array(one.force))
            for one in scene.external_forces
        ]

    def is_soft(self, number: int) -> bool:
        """Whether a name is that of a soft body, where a force needs a point."""
        return number < len(self._soft)

    def place(self, number: int, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Corners of the tetrahedron of a soft body around a point at rest [mm], and weights, shape (4,) each."""
        key = number, point.tobytes()
        if key not in self._places:
            if len(self._places) == MOST_KEPT:
                self._places.clear()
            body = self._soft[number]
            node, weight = embed(point[None], body.rest_position, linear_parts(body.elements))
            self._places[key] = node[0], weight[0]
        node, weight = self._places[key]
        return node + self._soft[number].nodes.start, weight

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
        for body, force in self._planned_at(state.step):
            yield body, force, np.zeros(3)
        for number in self._acting(state):
            if not self.is_soft(number) and self._carrier[number] < 0:
                yield number - len(self._soft), *self._wrench(state, number, self.middle[number])

    def on_frames(self, state: State) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
        """Frames, and forces [mN] and torques about their pivots [mN mm] on them and on the bodies they carry."""
        for number in self._acting(state):
            if (frame := int(self._carrier[number])) >= 0:
                yield frame, *self._wrench(state, number, self._frames.pivot[frame])

    def seen(self, state: State) -> np.ndarray:
        """Forces in the step that led to a state, in axes of the world [mN], shape (len(names), 3)."""
        seen = np.zeros((len(self.names), 3))
        for number in self._acting(state):
            if self.is_soft(number):
                seen[number] = self._node_force(state, number).at(state.position).sum(axis=0)
            else:
                seen[number] = self._wrench(state, number, self.middle[number])[0]
        for body, force in self._planned_at(state.step - 1):
            seen[len(self._soft) + body] += force
        return seen

    def _acting(self, state: State) -> list[int]:
        numbers: list[int] = np.flatnonzero(state.external_force_steps).tolist()
        return numbers

    def _planned_at(self, step: int) -> list[tuple[int, np.ndarray]]:
        return [(body, force) for first, count, body, force in self._planned if first <= step < first + count]

    def _node_force(self, state: State, number: int) -> NodeForce:
        force, _, point = state.external_force[number]
        (node, weight), to_rest = self.place(number, point), None
        if state.external_force_own_axes[number]:
            rest = self._soft[number].rest_position[node - self._soft[number].nodes.start]
            to_rest = np.linalg.inv((rest[1:] - rest[0]).T)
        return NodeForce(node, weight, force, to_rest)

    def _wrench(self, state: State, number: int, about: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Force [mN] and torque [mN mm] on a rigid body or frame about what is at `about` [mm] at rest."""
        force, torque, point = state.external_force[number]
        if (frame := self._carrier[number]) >= 0:
            turn = self._frames.places(state.frame_pose).turn[frame]
        else:
            body = number - len(self._soft)
            now, rest = matrices_from_quaternions(
                np.array([state.rigid_rotation[body], self._rigid[body].start_rotation])
            )
            turn = now @ rest.T
        if state.external_force_own_axes[number]:
            force, torque = turn @ force, turn @ torque
        return force, torque + np.cross(turn @ (point - about), force)
