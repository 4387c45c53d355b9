"""The tips of the fingers: where they are, how fast they move, and by how much the fingers bend."""

import numpy as np

from taichisoft.errors import SceneError
from taichisoft.placement import rotation_from_vector
from taichisoft.soft_body import SoftBody

# Of a finger without a `tip` in the scene: free nodes this far from the farthest one, as a share of its distance
# from the anchors, but at least so many that they can show a rotation.
TIP_SHARE = 0.05
FEWEST_NODES = 8


class Fingertips:
    """The tips of all soft bodies that have anchors or a `tip` of their own.

    Attributes:
        names: of the fingers.
    """

    def __init__(self, soft_bodies: tuple[SoftBody, ...]):
        """Choose the nodes of each tip.

        Raises:
            SceneError: the nodes of a tip lie on a line, or are fewer than three.
        """
        fingers = [body for body in soft_bodies if body.tip_nodes is not None or body.anchor_stiffness.any()]
        self.names = tuple(body.name for body in fingers)
        chosen = [body.tip_nodes if body.tip_nodes is not None else _farthest_nodes(body) for body in fingers]
        self._count = np.array([len(nodes) for nodes in chosen])
        self._start = np.cumsum(self._count) - self._count
        self._nodes = np.concatenate(
            [nodes + body.nodes.start for nodes, body in zip(chosen, fingers, strict=True)] or [np.zeros(0)]
        ).astype(np.intp)
        self._rest = np.vstack(
            [_centred(body.rest_position[nodes], body.name) for nodes, body in zip(chosen, fingers, strict=True)]
            or [np.zeros((0, 3))]
        )

    def means(self, node_values: np.ndarray) -> np.ndarray:
        """Mean of each tip's nodes, shape (finger_count, 3), of values (node_count, 3)."""
        if not self.names:
            return np.zeros((0, 3))
        return np.add.reduceat(node_values[self._nodes], self._start) / self._count[:, None]

    def bending_angles(self, node_position: np.ndarray, base_rotation: np.ndarray) -> np.ndarray:
        """By how much each tip has turned against the base since the start [rad], from 0 to pi, (finger_count,).

        The tip's rotation is the best fit to its nodes in the sense of least squares (Kabsch 1976, A solution for the
        best rotation to relate two sets of vectors).

        Args:
            node_position: of all soft nodes [mm], shape (node_count, 3).
            base_rotation: rotation vector of the base [rad], shape (3,).
        """
        if not self.names:
            return np.zeros(0)
        position = node_position[self._nodes]
        position -= np.repeat(np.add.reduceat(position, self._start) / self._count[:, None], self._count, axis=0)
        products = position[:, :, None] * self._rest[:, None, :]
        left, _, right = np.linalg.svd(np.add.reduceat(products, self._start))
        left[:, :, 2] *= np.linalg.det(left @ right)[:, None]  # a rotation, not a reflection
        turn = rotation_from_vector(base_rotation).T @ left @ right
        sine = np.stack([turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1]])
        return np.arctan2(np.linalg.norm(sine, axis=0), np.trace(turn, axis1=1, axis2=2) - 1.0)


def _farthest_nodes(body: SoftBody) -> np.ndarray:
    held = body.anchor_stiffness > 0.0
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
