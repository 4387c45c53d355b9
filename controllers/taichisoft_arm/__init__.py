"""A robot arm that carries the gripper: URDF, kinematics, paths, scripts, keys, links as bodies of the scene."""

from collections.abc import Callable, Mapping
from typing import Any

from taichisoft.running import Imported, hookimpl


@hookimpl
def taichisoft_controllers() -> Mapping[str, Callable[..., Any]]:
    """The controller of an arm."""
    return Imported(__name__, {"arm": "arm_controller:ArmController"})


@hookimpl
def taichisoft_scene_additions() -> Mapping[str, Callable[..., Mapping[str, Any]]]:
    """The arm's links as bodies of the scene, and the frames that move them."""
    return Imported(__name__, {"arm": "arm_links:arm_bodies"})
