"""What the tests of the arm share: arms, and scenes that one carries."""

from pathlib import Path
from typing import Any

import numpy as np

from taichisoft.scene import data_folder
from taichisoft_arm.arm_controller import CarriedBase
from taichisoft_arm.mounted_arm import ArmPlacement, MountedArm

SIX_AXIS = data_folder() / "arms" / "six-axis.urdf"
STANDING: dict[str, Any] = {
    "urdf": str(SIX_AXIS),
    "position": [0.0, 330.0, 0.0],
    "rotation": [0.0, 0.0, -90.0],
    "mount": {"position": [0.0, 0.0, 120.0], "rotation": [180.0, 0.0, 0.0]},
    "tool": [0.0, 0.0, 10.0],
}
"""The shipped arm, which looks along -y; its flange looks down at the origin."""


def standing_arm(**changes: Any) -> MountedArm:
    """The shipped arm in a scene."""
    return MountedArm(ArmPlacement.model_validate({**STANDING, **changes}))


def tool_of(base: CarriedBase, joints: np.ndarray) -> np.ndarray:
    """Where the tool is [mm], shape (3,)."""
    motion = base.arm.motions(joints)[-1]
    place: np.ndarray = motion[:3, :3] @ base.tool + motion[:3, 3]
    return place


URDF = """<robot name="own">
  <link name="foot">{foot}</link>
  <link name="lower">{lower}</link>
  <link name="upper">{upper}</link>
  <link name="mount"/>
  <joint name="turn" type="continuous">
    <parent link="foot"/><child link="lower"/><origin xyz="0 0 0.05"/><axis xyz="0 0 2"/>
    <limit velocity="1.0" effort="1"/>
  </joint>
  <joint name="slide" type="prismatic">
    <parent link="lower"/><child link="upper"/><origin xyz="0.1 0 0"/><axis xyz="0 0 1"/>
    <limit lower="-0.05" upper="0.2" velocity="0.3" effort="1"/>
  </joint>
  <joint name="screwed" type="fixed">
    <parent link="upper"/><child link="mount"/><origin xyz="0.02 0 -0.01" rpy="3.141592653589793 0 0"/>
  </joint>
  {more}
</robot>"""
"""An arm that turns and slides, with a mount for a gripper, which looks down."""


def own_arm(folder: Path, **parts: str) -> Path:
    """An arm of a user's own; `parts` are the contents of its links, and more joints and links."""
    path = folder / "own.urdf"
    path.write_text(URDF.format(**{"foot": "", "lower": "", "upper": "", "more": "", **parts}))
    return path
