"""Air chambers and cables."""

from typing import TYPE_CHECKING

import numpy as np

from taichisoft_sofa.components.cable_areas import METHODS, list_areas
from taichisoft_sofa.components.contacts import surface_triangles
from taichisoft_sofa.components.draft import DraftCable, DraftCavity
from taichisoft_sofa.components.graph import TOPOLOGIES, nearest, node_of
from taichisoft_sofa.components.reading import flag, numbers, text
from taichisoft_sofa.meshes.loaded_mesh import split_quads

if TYPE_CHECKING:
    from taichisoft_sofa.components.draft import SceneDraft
    from taichisoft_sofa.tree.component import Component

PRESSURE, VOLUME = "pressure", "volumeGrowth"


def value_type(component: "Component") -> str:
    """Type of a cavity's value, PRESSURE or VOLUME; scenes may also write their numbers."""
    given = text(component, "valueType", default=PRESSURE)
    return {"0": PRESSURE, "1": VOLUME}.get(given, given)


def is_driven_by_force(cable: "Component") -> bool:
    """Whether a cable's value is a force, else a displacement."""
    return text(cable, "valueType", default="displacement") in ("force", "1")


def cavity(component: "Component", draft: "SceneDraft") -> None:
    """Translate a closed surface with a pressure on its walls."""
    body = draft.body_of(component)
    if body is None:
        return
    if value_type(component) not in (PRESSURE, VOLUME):
        draft.refuse(component, f"valueType '{value_type(component)}'; valid: {PRESSURE}, {VOLUME}")
        return
    triangles = numbers(component, "triangles").astype(np.int64).reshape(-1, 3)
    quads = numbers(component, "quads").astype(np.int64).reshape(-1, 4)
    if not len(triangles) and not len(quads):
        topology = nearest(node_of(component), TOPOLOGIES)
        triangles = np.zeros((0, 3), dtype=np.int64) if topology is None else surface_triangles(topology)
    walls = np.vstack([triangles, split_quads(quads)])
    if not len(walls):
        draft.refuse(component, "has no triangles, of its own or in a topology container of its node")
        return
    points = draft.points_of(component)
    if not draft.has_points(component, walls, len(points)):
        return
    if flag(component, "flipNormal", False):
        walls = walls[:, ::-1]
    body.cavities.append(DraftCavity(component, points, walls))


def cable(component: "Component", draft: "SceneDraft") -> None:
    """Translate a cable through points of a body, or to areas of its surface."""
    body = draft.body_of(component)
    if body is None:
        return
    method = text(component, "method", default="point")
    if method not in METHODS:
        draft.refuse(component, f"method '{method}'; valid: {', '.join(METHODS)}")
        return
    points = draft.points_of(component)
    indices = numbers(component, "indices", default=[0.0]).astype(np.int64)
    if not len(indices) or indices.min() < 0 or indices.max() >= len(points):
        draft.refuse(component, f"indices must be among the {len(points)} points of its MechanicalObject")
        return
    places = points[indices].tolist() if method == "point" else list_areas(component, points, draft)
    if places:
        body.cables.append(DraftCable(component, places))
