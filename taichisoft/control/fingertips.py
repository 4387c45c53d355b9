"""The tips of the fingers: where they are, how fast they move, and by how much the fingers bend."""

import numpy as np

from taichisoft.bodies.moving_frames import MovingFrames
from taichisoft.bodies.soft_body_arrays import SoftBody
from taichisoft.control.kernels.tip_motion import observe_tips
from taichisoft.errors import SceneError
from taichisoft.state import State

# Of a finger without a `tip` in the scene: free nodes this far from the farthest one, as a share of its distance
# from the anchors, but at least so many that they can show a rotation.
TIP_SHARE = 0.05
FEWEST_NODES = 8


class Fingertips:
    """The tips of all soft bodies that have anchors or a `tip` of their own.

    Attributes:
        names: of the fingers.
        nodes: numbers of the nodes of each tip, a tuple of arrays.
    """

    def __init__(self, soft_bodies: tuple[SoftBody, ...], frames: MovingFrames):
        """Choose the nodes of each tip.

        Raises:
            SceneError: the nodes of a tip lie on a line, or are fewer than three.
        """
        fingers = [body for body in soft_bodies if body.tip_nodes is not None or body.anchored.any()]
        self.names = tuple(body.name for body in fingers)
        chosen = [body.tip_nodes if body.tip_nodes is not None else _farthest_nodes(body) for body in fingers]
        self._start = np.cumsum([0, *(len(nodes) for nodes in chosen)]).astype(np.int32)
        self.nodes = tuple(nodes + body.nodes.start for nodes, body in zip(chosen, fingers, strict=True))
        self._nodes = np.concatenate([*self.nodes, np.zeros(0)]).astype(np.intp)
        self._rest = np.vstack(
            [_centred(body.rest_position[nodes], body.name) for nodes, body in zip(chosen, fingers, strict=True)]
            or [np.zeros((0, 3))]
        )
        self._position, self._velocity = np.empty_like(self._rest), np.empty_like(self._rest)
        self._frames, self._frame = frames, frames.numbers(body.settings.follows for body in fingers)
        self._frame_turn = np.empty((len(fingers), 3, 3))
        self._mean_position, self._mean_velocity = np.empty((len(fingers), 3)), np.empty((len(fingers), 3))
        self._bending_angle = np.empty(len(fingers))

    def observe(self, state: State) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Positions [mm] and velocities [mm/s] of the tips, each (finger_count, 3), and bending angles [rad].

        A position or velocity is the mean of the tip's nodes. The bending angle, from 0 to pi, is by how much the tip
        has turned against the frame that the finger follows since the start; the tip's rotation is the best fit to its
        nodes in the sense of least squares (Kabsch 1976, A solution for the best rotation to relate two sets of
        vectors).
        """
        if self.names:
            np.take(state.position, self._nodes, axis=0, out=self._position, mode="clip")
            np.take(state.velocity, self._nodes, axis=0, out=self._velocity, mode="clip")
            self._frame_turn[:] = self._frames.places(state.frame_pose).turn[self._frame]
            observe_tips(
                self._start,
                self._rest,
                self._position,
                self._velocity,
                self._frame_turn,
                self._mean_position,
                self._mean_velocity,
                self._bending_angle,
            )
        return self._mean_position.copy(), self._mean_velocity.copy(), self._bending_angle.copy()


def _farthest_nodes(body: SoftBody) -> np.ndarray:
    held = body.anchored
    distance = np.linalg.norm(body.rest_position - body.rest_position[held].mean(axis=0), axis=1)
    distance[held] = 0.0
    farthest_first = np.argsort(-distance, kind="stable")
    count = np.count_nonzero(distance >= (1.0 - TIP_SHARE) * distance.max())
    return np.sort(farthest_first[: max(count, FEWEST_NODES)])


def _centred(position: np.ndarray, name: str) -> np.ndarray:
    """The positions less their mean; what lies on a line cannot show a rotation."""
    centred = position - position.mean(axis=0)
    extents = np.linalg.svd(centred, compute_uv=False)
    if len(position) < 3 or extents[1] <= 1e-6 * extents[0]:
        raise SceneError(
            f"soft_bodies.{name}.tip: selects {len(position)} nodes on a line; three or more that span a plane are "
            "needed to see it turn"
        )
    return centred
