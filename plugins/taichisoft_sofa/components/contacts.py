"""How contacts are found and solved, and the surfaces that touch."""

import re
from typing import TYPE_CHECKING

import numpy as np

from taichisoft.errors import SceneError
from taichisoft_sofa.components.draft import Surface
from taichisoft_sofa.components.graph import TOPOLOGIES, nearest, node_of
from taichisoft_sofa.components.reading import computed, described, flag, number, numbers, text
from taichisoft_sofa.meshes.loaded_mesh import split_quads

if TYPE_CHECKING:
    from collections.abc import Callable

    from taichisoft_sofa.components.draft import SceneDraft
    from taichisoft_sofa.tree.component import Component

DEFAULT_FRICTION = 0.8
"""Friction coefficient of SOFA's frictional contacts where the scene gives none."""
WITHOUT_FRICTION = "PenalityContactForceField"
"""The response that SOFA takes where the scene names none."""


def role(name: str) -> "Callable[[Component, SceneDraft], None]":
    """An entry that takes part in contact under a name: "pipeline", "broad phase", "response", "distance"."""

    def take_part(component: "Component", draft: "SceneDraft") -> None:
        draft.pipeline[name] = component

    take_part.__doc__ = f"The {name} of contacts."

    return take_part


def friction_of(response: "Component", draft: "SceneDraft") -> float:
    """Friction coefficient that a contact manager gives to all pairs of bodies; 0 where its contacts have none in SOFA.

    Raises:
        SceneError: it is no number from 0 on.
    """
    sources = {name: text(response, name) for name in ("responseParams", "response", "default")}
    kind = (sources["response"] or sources["default"] or WITHOUT_FRICTION).partition("?")[0]
    if "Friction" not in kind or kind.startswith("Frictionless"):
        draft.depart(f"{described(response)}: response '{kind}': surfaces touch without friction, and do not give way")
        return 0.0
    for name, source in sources.items():
        if found := re.search(r"(?:^|[?&\s])mu\s*=\s*([^&\s]*)", source):
            try:
                friction = float(found[1])
            except ValueError:
                friction = -1.0
            if not 0.0 <= friction < np.inf:
                raise SceneError(f"{described(response)}: {name} = '{source}': mu must be 0 or more")
            return friction
    return DEFAULT_FRICTION


def distances_of(distance: "Component") -> tuple[float, float]:
    """Alarm distance and contact distance [mm]."""
    return number(distance, "alarmDistance", default=1.0), number(distance, "contactDistance", default=0.5)


def collision_model(component: "Component", draft: "SceneDraft") -> None:
    """Points, edges and triangles of one surface; the models of a node are one here."""
    body = draft.body_of(component)
    if body is None:
        return
    path = node_of(component).getPathName()
    if path not in body.surfaces:
        topology = nearest(node_of(component), TOPOLOGIES)
        none = np.zeros((0, 3), dtype=np.int64)
        triangles = none if topology is None else surface_triangles(topology)
        groups = frozenset(numbers(component, "group").astype(int).tolist())
        points = draft.points_of(component)
        if not draft.has_points(component, triangles, len(points)):
            return
        body.surfaces[path] = Surface(component, points, triangles, groups, False)
    body.surfaces[path].self_collision |= flag(component, "selfCollision", False)


def surface_triangles(topology: "Component") -> np.ndarray:
    """Triangles of a container, its quads cut in two, shape (count, 3)."""
    return np.vstack([computed(topology, "triangles", 3), split_quads(computed(topology, "quads", 4))])
