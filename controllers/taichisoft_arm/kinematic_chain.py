"""A chain of joints from an arm's root to the link that carries the gripper: poses of its links, and their Jacobian.

Poses are homogeneous matrices [mm]; angles are in radians, ways of sliding joints in mm.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation


@dataclass(frozen=True)
class ChainJoint:
    """A joint that moves: one that turns, or one that slides.

    Attributes:
        name: name of the joint.
        slides: whether it slides along its axis, instead of turning about it.
        origin: pose of the joint in the frame of the joint before it, or of the root, at 0, shape (4, 4).
        axis: unit vector in the frame of the joint, shape (3,).
        lowest, highest: limits [rad] or [mm]; infinite for a joint that turns without end.
        speed: largest speed [rad/s] or [mm/s].
    """

    name: str
    slides: bool
    origin: np.ndarray
    axis: np.ndarray
    lowest: float
    highest: float
    speed: float

    @property
    def unit(self) -> str:
        """The unit that users write."""
        return "mm" if self.slides else "degrees"

    @property
    def to_user(self) -> float:
        """The factor from the unit of the arithmetic to that of users."""
        return 1.0 if self.slides else float(np.degrees(1.0))


class KinematicChain:
    """Joints one after the other, and a link behind the last one.

    Attributes:
        joints: the joints from the root to the link.
        tip: pose of the link in the frame of the last joint, shape (4, 4).
        lowest, highest: limits of the joints [rad] or [mm], shape (joint_count,).
        speed: largest speeds [rad/s] or [mm/s], shape (joint_count,).
        slides: whether each joint slides, shape (joint_count,).
        reach: length that the chain cannot exceed [mm], but for joints that slide: the sum of its parts.
    """

    def __init__(self, joints: tuple[ChainJoint, ...], tip: np.ndarray):
        self.joints, self.tip = joints, tip
        self.lowest = np.array([joint.lowest for joint in joints])
        self.highest = np.array([joint.highest for joint in joints])
        self.speed = np.array([joint.speed for joint in joints])
        self.slides = np.array([joint.slides for joint in joints], dtype=bool)
        self.reach = float(sum(np.linalg.norm(pose[:3, 3]) for pose in (*(one.origin for one in joints), tip)))
        # Of a turn by q: 1 + sin q K + (1 - cos q) K^2, with K v = axis x v (Rodrigues).
        axes = np.array([joint.axis for joint in joints])
        self._axes = axes
        self._crosses = np.cross(np.eye(3)[None], axes[:, None]).transpose(0, 1, 2)
        self._squares = self._crosses @ self._crosses

    def frames(self, values: np.ndarray) -> np.ndarray:
        """Poses of the root, of the frame behind each joint, and of the link at the end, in the root's frame.

        Args:
            values: values of the joints, shape (..., joint_count).

        Returns:
            Poses, shape (..., joint_count + 2, 4, 4).
        """
        values = np.asarray(values, dtype=np.float64)
        found = np.empty((*values.shape[:-1], len(self.joints) + 2, 4, 4))
        pose = np.broadcast_to(np.eye(4), (*values.shape[:-1], 4, 4))
        found[..., 0, :, :] = pose
        for number, joint in enumerate(self.joints):
            pose = pose @ joint.origin @ self._motion(number, values[..., number])
            found[..., number + 1, :, :] = pose
        found[..., -1, :, :] = pose @ self.tip
        return found

    def link(self, values: np.ndarray) -> np.ndarray:
        """The pose of the link at the end, shape (..., 4, 4), at values of the joints, shape (..., joint_count)."""
        return self.frames(values)[..., -1, :, :]

    def jacobian(self, frames: np.ndarray) -> np.ndarray:
        """Velocity [mm/s] and angular velocity [rad/s] of the link, in the root's axes, for a speed of 1 of each joint.

        Args:
            frames: what `frames` gave, shape (..., joint_count + 2, 4, 4).

        Returns:
            Shape (..., 6, joint_count); the velocity is that of the link's origin.
        """
        behind = frames[..., 1:-1, :, :]
        axes = np.einsum("...nij,nj->...ni", behind[..., :3, :3], self._axes)
        arms = frames[..., -1:, :3, 3] - behind[..., :3, 3]
        slides = self.slides[:, None]
        velocity = np.where(slides, axes, np.cross(axes, arms))
        return np.concatenate([velocity, np.where(slides, 0.0, axes)], axis=-1).swapaxes(-1, -2)

    def _motion(self, number: int, value: np.ndarray) -> np.ndarray:
        """The motion of a joint from 0 to a value, shape (..., 4, 4)."""
        motion = np.zeros((*value.shape, 4, 4))
        motion[..., range(4), range(4)] = 1.0
        if self.slides[number]:
            motion[..., :3, 3] = value[..., None] * self._axes[number]
            return motion
        sine, versine = np.sin(value)[..., None, None], 2.0 * np.sin(0.5 * value)[..., None, None] ** 2
        motion[..., :3, :3] += sine * self._crosses[number] + versine * self._squares[number]
        return motion


def pose_of(position: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """The pose with an origin [mm], shape (3,), turned by a matrix, shape (3, 3)."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, position
    return pose


def inverse_pose(pose: np.ndarray) -> np.ndarray:
    """The pose that undoes another, shape (4, 4)."""
    return pose_of(-pose[:3, :3].T @ pose[:3, 3], pose[:3, :3].T)


def turn_between(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """The rotation vector [rad], in the root's axes, that leads from one turn to another; shapes (..., 3, 3)."""
    matrix = end @ np.swapaxes(start, -1, -2)
    return Rotation.from_matrix(matrix.reshape(-1, 3, 3)).as_rotvec().reshape(*matrix.shape[:-2], 3)
