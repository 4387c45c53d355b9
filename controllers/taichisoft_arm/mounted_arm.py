"""An arm in a scene: its joints move the base of the gripper, and the frames of its links."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field, model_validator
from scipy.spatial.transform import Rotation

from taichisoft.errors import SceneError
from taichisoft.scene import Number, Positive, Table, Vector
from taichisoft_arm.kinematics import KinematicChain, inverse_pose, pose_of, solve
from taichisoft_arm.urdf_file import ArmDescription, LinkPart, Look, read_arm


class Placement(Table):
    """A place and a turn."""

    position: Vector = (0.0, 0.0, 0.0)
    """Place of the origin [mm]."""
    rotation: Vector = (0.0, 0.0, 0.0)
    """Turns about the x, y and z axes, in this order [degrees]."""

    @property
    def pose(self) -> np.ndarray:
        """The pose, shape (4, 4)."""
        return pose_of(np.array(self.position), Rotation.from_euler("xyz", self.rotation, degrees=True).as_matrix())


class ArmPlacement(Placement):
    """Where an arm's root stands, and how the gripper is mounted."""

    urdf: str
    """The URDF, by path or by the name of a shipped arm (`six-axis`)."""
    link: str | None = None
    """The link that carries the gripper; the only one to which nothing else is attached when it is not given."""
    mount: Placement | None = None
    """Where that link is at the start of a run; the joints follow from it."""
    joints: list[Number] | None = Field(None, min_length=1)
    """The joints at the start, from the root on [degrees], sliding ones in mm; either these or mount."""
    tool: Vector | None = None
    """The point of the gripper that `move` brings to places, where it is at the start [mm]; the base's pivot when it is
    not given."""
    ramp: Positive = 0.2
    """Time from rest to the highest speed of a motion, and back to rest [s]."""

    @model_validator(mode="after")
    def _check_start(self) -> "ArmPlacement":
        if (self.mount is None) == (self.joints is None):
            raise ValueError("exactly one of mount, joints is needed: it says how the gripper hangs on the arm")
        return self


class MountedArm:
    """An arm whose last link carries the gripper, as both are at the start.

    Attributes:
        chain: its joints.
        start: their values at the start [rad] or [mm], shape (joint_count,).
    """

    def __init__(self, settings: ArmPlacement):
        """Read the arm, and find its joints at the start."""
        path = Path(settings.urdf)
        self._description: ArmDescription = read_arm(path, settings.link)
        self.chain: KinematicChain = self._description.chain
        self._root = settings.pose
        if settings.joints is not None:
            self.start = self.values_of(settings.joints, "controller.settings.joints")
        elif settings.mount is not None:
            middle = np.clip(np.zeros(len(self.chain.joints)), self.chain.lowest, self.chain.highest)
            values = solve(self.chain, inverse_pose(self._root) @ settings.mount.pose, middle)
            if values is None:
                raise SceneError(
                    f"controller.settings.mount.position = {list(settings.mount.position)}: the arm's link cannot be "
                    "there, turned like this; move the mount, or the arm"
                )
            self.start = values
        frames = self.chain.frames(self.start)
        self._frames_at_start = self._root @ frames
        self._undo_frames = np.array([inverse_pose(frame) for frame in self._frames_at_start])

    def values_of(self, given: Sequence[float], key: str) -> np.ndarray:
        """Values of the joints [rad] or [mm] from those that a user wrote [degrees] or [mm]."""
        joints = self.chain.joints
        if len(given) != len(joints):
            names = ", ".join(joint.name for joint in joints)
            raise SceneError(f"{key} has {len(given)} values; the arm has {len(joints)} joints: {names}")
        values = np.array([value / joint.to_user for value, joint in zip(given, joints, strict=True)])
        for joint, value, wrote in zip(joints, values, given, strict=True):
            if not joint.lowest - 1e-9 <= value <= joint.highest + 1e-9:
                low, high = joint.lowest * joint.to_user, joint.highest * joint.to_user
                raise SceneError(f"{key}: {joint.name} = {wrote:g}: must be from {low:g} to {high:g} {joint.unit}")
        return np.clip(values, self.chain.lowest, self.chain.highest)

    def motions(self, values: np.ndarray) -> np.ndarray:
        """Motions since the start of the root, the frames behind the joints, and the gripper.

        Args:
            values: values of the joints, shape (..., joint_count).

        Returns:
            Poses that what stood at x is moved by, shape (..., joint_count + 2, 4, 4).
        """
        return self._root @ self.chain.frames(values) @ self._undo_frames

    def speeds(self, values: np.ndarray, rates: np.ndarray, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Speed of a point of the gripper [mm/s], and its turning speed [rad/s], for rates of the joints.

        Args:
            values, rates: of the joints, shape (..., joint_count).
            point: where it is at the start [mm], shape (3,).

        Returns:
            Two arrays of shape (...,).
        """
        both = np.einsum("...ij,...j->...i", self._jacobian(values, point), rates)
        return np.linalg.norm(both[..., :3], axis=-1), np.linalg.norm(both[..., 3:], axis=-1)

    def rates(self, values: np.ndarray, point: np.ndarray, velocity: np.ndarray, turning: np.ndarray) -> np.ndarray:
        """The smallest rates of the joints that give a point of the gripper a velocity, and the gripper a turn.

        Args:
            values: of the joints, shape (..., joint_count).
            point: where it is at the start [mm], shape (3,).
            velocity, turning: of the point and of the gripper in the scene's axes [mm/s], [rad/s], shape (3,) each.

        Returns:
            Shape (..., joint_count).
        """
        undo = self._root[:3, :3].T
        wanted = np.concatenate([undo @ velocity, undo @ turning])
        return np.linalg.pinv(self._jacobian(values, point)) @ wanted

    def _jacobian(self, values: np.ndarray, point: np.ndarray) -> np.ndarray:
        """The Jacobian of a point of the gripper, which is at `point` at the start, shape (..., 6, joint_count)."""
        frames = self.chain.frames(values)
        jacobian = self.chain.jacobian(frames)
        arm = frames[..., -1, :3, :3] @ (self._undo_frames[-1] @ np.append(point, 1.0))[:3]
        jacobian[..., :3, :] -= np.cross(arm[..., None, :], jacobian[..., 3:, :].swapaxes(-1, -2)).swapaxes(-1, -2)
        return jacobian

    def link_pose(self, motion: np.ndarray) -> np.ndarray:
        """Where the link is in the root's frame after a motion of the gripper since the start, shape (4, 4)."""
        return inverse_pose(self._root) @ motion @ self._frames_at_start[-1]

    def frame_names(self) -> list[str]:
        """Names of the frames that move the links in a scene: of the root's, then of each joint's but the last.

        What moves with the last joint moves with the gripper's base.
        """
        return ["arm_root", *(f"arm_{joint.name}" for joint in self.chain.joints[:-1])]

    def control(self, values: np.ndarray, pivot: np.ndarray, frames: Sequence[str]) -> dict[str, Any]:
        """Arguments of the `Control` that moves the base, and the frames of a scene, to where the joints bring them.

        Args:
            values: values of the joints, shape (joint_count,).
            pivot: the base's pivot [mm], shape (3,).
            frames: names of the frames that the scene has, each of `frame_names`.
        """
        motions = self.motions(values)
        vectors = Rotation.from_matrix(motions[:, :3, :3]).as_rotvec()
        arguments: dict[str, Any] = {
            "base_translation": motions[-1, :3, :3] @ pivot + motions[-1, :3, 3] - pivot,
            "base_rotation": vectors[-1],
        }
        if frames:
            numbers = {name: number for number, name in enumerate(self.frame_names())}
            arguments["frame_translation"] = {name: motions[numbers[name], :3, 3] for name in frames}
            arguments["frame_rotation"] = {name: vectors[numbers[name]] for name in frames}
        return arguments

    def parts(self, look: Look) -> list[tuple[LinkPart, np.ndarray]]:
        """Shapes of the links, each with its pose in the scene at the start, shape (4, 4) [mm]."""
        return [(part, self._frames_at_start[part.frame] @ part.pose) for part in self._description.parts[look]]


def motion_of_base(translation: np.ndarray, rotation: np.ndarray, pivot: np.ndarray) -> np.ndarray:
    """The motion since the start of a base with a translation [mm] and rotation vector [rad], shape (4, 4)."""
    turn = Rotation.from_rotvec(np.array(rotation)).as_matrix()
    return pose_of(pivot + translation - turn @ pivot, turn)
