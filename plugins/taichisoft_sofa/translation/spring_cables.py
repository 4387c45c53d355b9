"""Springs between points as native cables that stretch, push as well as pull, and are held at their rest length."""

from typing import TYPE_CHECKING, Any

from taichisoft_sofa.components.frames import local_position
from taichisoft_sofa.components.graph import independent_state, node_of
from taichisoft_sofa.components.states import start_position

if TYPE_CHECKING:
    from taichisoft_sofa.components.draft import SceneDraft
    from taichisoft_sofa.translation.parts import Translation
    from taichisoft_sofa.tree.component import Component


def add_springs(draft: "SceneDraft", translation: "Translation") -> None:
    """Add all springs of a scene to its soft bodies; a spring needs a soft body at one end at least."""
    for number, spring in enumerate(draft.springs):
        ends = [_end(state, point, translation) for state, point in zip(spring.ends, spring.points, strict=True)]
        if ends[0][0] not in translation.soft:
            ends.reverse()
        (owner, first), (other, second) = ends
        if owner not in translation.soft:
            draft.refuse(spring.component, "joins no soft body; springs between rigid bodies are not there")
            continue
        cable: dict[str, Any] = {"axial_stiffness": spring.modulus, "rod": spring.pushes}
        if other is None:  # a place that nothing moves
            cable |= {"points": [first], "pull_point": second, "pull_point_moves": False}
        else:
            cable["points"] = [first, second if other == owner else {"body": other, "point": second}]
        name = f"spring{number}"
        translation.tables["soft_bodies"][owner].setdefault("cables", {})[name] = cable
        translation.springs[f"{owner}.{name}"] = spring.pull


def _end(state: "Component", point: int, translation: "Translation") -> "tuple[str | None, list[float]]":
    """Name of the body that has a point, or None, and the point in the coordinates of the body [mm]."""
    base = independent_state(node_of(state))
    name = translation.names.get(base) if base is not None else None
    if name in translation.soft:
        return name, start_position(state)[point, :3].tolist()
    if name in translation.rigid:
        return name, ([0.0, 0.0, 0.0] if state is base else local_position(state)[point, :3].tolist())
    return None, start_position(state)[point, :3].tolist()
