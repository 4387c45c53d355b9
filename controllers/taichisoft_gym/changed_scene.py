"""The scene of an environment, with the changes by its arguments."""

from collections.abc import Mapping
from typing import Any

from taichisoft import Scene
from taichisoft.errors import SceneError
from taichisoft.scenes import RigidBodySettings, scene_from_dict


def changed_scene(
    scene: Scene,
    object: Mapping[str, Any] | None,
    friction: float | None,
    pressure: tuple[float, float],
    pressure_rate: float,
) -> Scene:
    """A scene with another object, friction or limits.

    Args:
        scene: the scene.
        object: keys of `[rigid_bodies.NAME]` that replace keys of the scene's object; a shape or surface replaces the
            present one.
        friction: Coulomb's coefficient [-]; None: the scene's.
        pressure: lowest and highest pressure [kPa].
        pressure_rate: fastest change of a pressure [kPa/s].

    Raises:
        SceneError: an argument is not valid.
    """
    tables = scene.model_dump(mode="json", exclude_none=True)
    tables["limits"] |= {
        "lowest_pressure": pressure[0],
        "highest_pressure": pressure[1],
        "pressure_rate": pressure_rate,
    }
    if friction is not None:
        tables["contact"]["friction"] = friction
    if object is not None:
        if not isinstance(object, Mapping):
            raise SceneError(f"object = {object!r}: must be a dictionary of keys of a rigid body")
        if scene.main_object is None:
            raise SceneError("object: the scene has no rigid body to change")
        bodies = tables["rigid_bodies"]
        bodies[scene.main_object] = _changed_body(bodies[scene.main_object], object)
    return scene_from_dict(tables, "scene of the environment")


def _changed_body(table: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Table of a body with changed keys; a key removes all keys that exclude it."""
    replaced = {key for keys in RigidBodySettings.alternatives if set(keys) & changes.keys() for key in keys}
    return {**{key: value for key, value in table.items() if key not in replaced}, **changes}
