"""How contacts are found and solved, and the surfaces that touch."""

import re
from typing import TYPE_CHECKING

import numpy as np

from taichisoft_sofa.components.draft import Surface
from taichisoft_sofa.components.graph import TOPOLOGIES, nearest, node_of
from taichisoft_sofa.components.reading import computed, flag, number, numbers, text
from taichisoft_sofa.meshes.loaded_mesh import split_quads

if TYPE_CHECKING:
    from collections.abc import Callable

    from taichisoft_sofa.components.draft import SceneDraft
    from taichisoft_sofa.tree.component import Component

DEFAULT_FRICTION = 0.8
"""Friction coefficient of SOFA's frictional contacts where the scene gives none."""


def role(name: str) -> "Callable[[Component, SceneDraft], None]":
    """An entry that takes part in contact under a name: "pipeline", "broad phase", "response", "distance"."""

    def take_part(component: "Component", draft: "SceneDraft") -> None:
        draft.pipeline[name] = component

    take_part.__doc__ = f"The {name} of contacts."

    return take_part


def friction_of(response: "Component") -> float:
    """Friction coefficient that a contact manager gives to all pairs of bodies."""
    for source in (text(response, "responseParams"), text(response, "response"), text(response, "default")):
        found = re.search(r"mu\s*=\s*([-+.\deE]+)", source)
        if found:
            return float(found[1])
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
        body.surfaces[path] = Surface(component, points, triangles, groups, False)
    body.surfaces[path].self_collision |= flag(component, "selfCollision", False)


def surface_triangles(topology: "Component") -> np.ndarray:
    """Triangles of a container, its quads cut in two, shape (count, 3)."""
    return np.vstack([computed(topology, "triangles", 3), split_quads(computed(topology, "quads", 4))])
