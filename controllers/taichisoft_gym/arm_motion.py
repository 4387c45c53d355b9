"""Joints of an arm as actions: the base of the gripper goes where they bring it."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from taichisoft import Scene
from taichisoft.errors import SceneError
from taichisoft.state import State
from taichisoft_gym.channels import Channel


@dataclass(frozen=True)
class ArmTravel:
    """Motion of the base by the arm of the scene's controller "arm"; each joint is an action.

    Attributes:
        share: of a joint's highest speed, which the actions -1 and 1 stand for, above 0 and up to 1.
    """

    share: float = 1.0


class ArmMotion:
    """The joints of a scene's arm, and the velocities of the base that they make.

    Attributes:
        channels: of the joints' speeds at the actions -1 and 1.
        positions: of the joints themselves.
    """

    def __init__(self, scene: Scene, travel: ArmTravel):
        """Read the arm.

        Raises:
            SceneError: the scene has no arm, or the share is none.
            PackageMissing: yourdfpy is not installed.
        """
        from taichisoft_arm.mounted_arm import ArmPlacement, MountedArm

        if scene.controller is None or scene.controller.name != "arm":
            raise SceneError('travel = ArmTravel(): needs a scene whose controller is "arm", with the settings of one')
        if not 0.0 < travel.share <= 1.0:
            raise SceneError(f"ArmTravel(share={travel.share:g}): must be above 0 and at most 1")
        settings = {key: value for key, value in scene.controller.settings.items() if key in ArmPlacement.model_fields}
        self._arm = MountedArm(ArmPlacement.model_validate(settings))
        self._values, self._links = self._arm.start, [name for name in self._arm.frame_names() if name in scene.frames]
        joints, self._fastest = self._arm.chain.joints, travel.share * self._arm.chain.speed
        units = ["mm" if joint.slides else "rad" for joint in joints]
        self.channels = tuple(
            Channel(f"speed of {joint.name}", f"{unit}/s", -speed, speed)
            for joint, unit, speed in zip(joints, units, self._fastest.tolist(), strict=True)
        )
        ends = np.clip([self._arm.chain.lowest, self._arm.chain.highest], -1e3, 1e3).T
        self.positions = tuple(
            Channel(f"joint {joint.name}", unit, *end)
            for joint, unit, end in zip(joints, units, ends.tolist(), strict=True)
        )

    def values(self, translation: np.ndarray, rotation: np.ndarray, pivot: np.ndarray) -> np.ndarray:
        """The joints that have brought the base to a pose: those of the last call if they have, else the nearest.

        Args:
            translation: of the base [mm], shape (3,).
            rotation: its rotation vector [rad], shape (3,).
            pivot: the base's pivot [mm], shape (3,).

        Raises:
            SceneError: the arm cannot bring the base there.
        """
        from taichisoft_arm.inverse_kinematics import solve
        from taichisoft_arm.mounted_arm import motion_of_base

        motion = motion_of_base(translation, rotation, pivot)
        if not np.allclose(self._arm.motions(self._values)[-1], motion, rtol=0.0, atol=1e-7):
            found = solve(self._arm.chain, self._arm.link_pose(motion), self._values)
            if found is None:
                raise SceneError("the base is where the arm cannot bring it; begin at a state that it can reach")
            self._values = found
        return self._values

    def control(self, speeds: np.ndarray, state: State, pivot: np.ndarray, period: float) -> dict[str, Any]:
        """Arguments of the `Control` that moves base and links for a period [s]; joints end at their limits.

        Args:
            speeds: of the joints [rad/s], [mm/s], shape (joint_count,).
            state: at the start of the period.
            pivot: the base's pivot [mm], shape (3,).
            period: control period [s].
        """
        chain = self._arm.chain
        before = self.values(state.base_translation, state.base_rotation, pivot)
        after = np.clip(before + period * speeds, chain.lowest, chain.highest)
        self._values = after
        now, then = (self._arm.control(values, pivot, self._links) for values in (before, after))
        asked: dict[str, Any] = {
            "base_velocity": (then["base_translation"] - state.base_translation) / period,
            "base_angular_velocity": _turning(state.base_rotation, then["base_rotation"]) / period,
        }
        if self._links:
            names = self._links
            way = {name: then["frame_translation"][name] - now["frame_translation"][name] for name in names}
            turn = {name: _turning(now["frame_rotation"][name], then["frame_rotation"][name]) for name in names}
            asked["frame_velocity"] = {name: way[name] / period for name in names}
            asked["frame_angular_velocity"] = {name: turn[name] / period for name in names}
        return asked


def _turning(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """The rotation vector that turns one rotation vector into another [rad]."""
    first, last = (Rotation.from_rotvec(np.array(one)) for one in (before, after))  # SciPy takes no read-only arrays
    vector: np.ndarray = (last * first.inv()).as_rotvec()
    return vector
