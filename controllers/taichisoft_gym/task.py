"""What tasks share: how well it goes, and the scene with what an environment's arguments change."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from taichisoft.errors import SceneError
from taichisoft.scenes.file import scene_from_dict
from taichisoft.scenes.rigid_body import RigidBody
from taichisoft.scenes.scene import Scene


@dataclass(frozen=True)
class Judgement:
    """How well a task goes.

    Attributes:
        reward: reward of a control period.
        failed: whether nothing can mend it.
        told: what `info` says, "is_success" among it.
    """

    reward: float
    failed: bool
    told: Mapping[str, Any] = field(default_factory=dict)


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
        object: keys of `[rigid_bodies.NAME]`, which take the place of those of the scene's object; a shape or surface
            replaces the one that it has.
        friction: Coulomb's coefficient [-]; the scene's where it is None.
        pressure: lowest and highest pressure [kPa].
        pressure_rate: fastest change of a pressure [kPa/s].

    Raises:
        SceneError: one of these is not valid.
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
        if scene.main_object is None:
            raise SceneError("object: the scene has no rigid body whose place it could take")
        bodies = tables["rigid_bodies"]
        bodies[scene.main_object] = _changed_body(bodies[scene.main_object], object)
    return scene_from_dict(tables, "scene of the environment")


def _changed_body(table: Mapping[str, Any], told: Mapping[str, Any]) -> dict[str, Any]:
    """The table of a body with other keys; one of several that exclude each other takes the place of the others."""
    replaced = {key for keys in RigidBody.alternatives if set(keys) & told.keys() for key in keys}
    return {**{key: value for key, value in table.items() if key not in replaced}, **told}
