"""Colours of what is shown."""

from typing import TYPE_CHECKING

from taichisoft_sofa.components.graph import independent_state, node_of
from taichisoft_sofa.components.reading import numbers

if TYPE_CHECKING:
    from taichisoft_sofa.components.draft import SceneDraft
    from taichisoft_sofa.tree.component import Component


def visual_model(component: "Component", draft: "SceneDraft") -> None:
    """The colour of a body."""
    colour = numbers(component, "color").tolist()
    if len(colour) not in (3, 4) or independent_state(node_of(component)) is None:
        return
    body = draft.body_of(component)
    if body is not None:
        body.colours.append([*colour, 1.0][:4])


def background(component: "Component", draft: "SceneDraft") -> None:
    """The colour behind the scene."""
    colour = numbers(component, "color").tolist()
    if len(colour) in (3, 4):
        draft.background = [*colour, 1.0][:4]
