"""The actuators, fingers, objects and pairs of a model that a user's name stands for; None stands for all."""

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import TYPE_CHECKING

from taichisoft.errors import SceneError, nearest

if TYPE_CHECKING:
    from taichisoft.contact import Model
    from taichisoft.control import Pair


def actuators_called(name: str | None, names: Sequence[str], kind: str) -> list[str]:
    """The actuators of "finger1", or "finger1.cavity" alone, out of the names of all of a kind, "cavity" or "cable"."""
    chosen = [actuator for actuator in names if name is None or name in (actuator, finger_of(actuator))]
    return chosen or called(name, [*dict.fromkeys([*map(finger_of, names), *names])], f"finger or {kind}")


def finger_of(actuator: str) -> str:
    """The name of the soft body of an actuator "finger1.cavity"."""
    return actuator.partition(".")[0]


def values_by_actuator(given: float | Mapping[str, float], names: Sequence[str], kind: str) -> dict[str, float]:
    """Values by the names of actuators of a kind, from one for all or from some by finger or actuator."""
    if not isinstance(given, Mapping):
        # 0 fits every scene, also without actuators: a script may keep them at rest.
        return dict.fromkeys(actuators_called(None, names, kind) if given else names, given)
    by_actuator: dict[str, float] = {}
    for name, value in given.items():
        for actuator in actuators_called(name, names, kind):
            if actuator in by_actuator:
                raise SceneError(f"'{actuator}' is given twice, the second time as '{name}'")
            by_actuator[actuator] = value
    return by_actuator


def fingers_called(name: str | None, model: "Model") -> list[str]:
    """The soft body of that name, if its bending is observed."""
    bodies = model.scene.soft_bodies.items()
    return called(name, [finger for finger, body in bodies if body.anchors or body.tip is not None], "finger")


def object_called(name: str | None, model: "Model") -> str:
    """The rigid body of that name; without a name the goal's object, or the only rigid body."""
    names = [body.name for body in model.rigid_bodies] if name is not None else grasped_objects(model)
    chosen = called(name, names, "rigid body")
    if len(chosen) > 1:
        raise SceneError(f'which one? put its name in brackets: ["{chosen[0]}"]; there are: {", ".join(chosen)}')
    return chosen[0]


def pairs_called(name: str | None, model: "Model") -> list["Pair"]:
    """The pair of bodies called "finger1|cube", in either order; None: soft bodies with grasped objects."""
    if name is None:
        objects = grasped_objects(model)
        return [(soft, other) for soft in called(None, list(model.scene.soft_bodies), "soft body") for other in objects]
    fixed = {obstacle.name for obstacle in model.obstacles}
    folded = [(body, body) for body, table in model.scene.soft_bodies.items() if len(table.collision_surface) > 1]
    touching = [*combinations(model.body_names, 2), *folded]
    pairs = {"|".join(pair): pair for pair in touching if not fixed.issuperset(pair)}
    turned = "|".join(reversed(name.split("|")))
    return [pairs[turned if turned in pairs else called(name, list(pairs), "pair of bodies")[0]]]


def grasped_objects(model: "Model") -> list[str]:
    """The goal's object, or all rigid bodies that no frame carries when the scene has no goal."""
    goal = model.scene.goal
    names = [goal.object] if goal is not None else model.scene.objects
    return called(None, names, "rigid body")


def called(name: str | None, names: Sequence[str], what: str) -> list[str]:
    """The `names` that are equal to `name`, or all for None; `what` says in errors what they name."""
    chosen = [known for known in names if name is None or known == name]
    if chosen:
        return chosen
    if name is None:
        raise SceneError(f"the scene has no {what}")
    raise SceneError(f"no {what} is called '{name}'; {nearest(name, names, 'there are')}")
