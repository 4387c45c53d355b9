"""Contact pipeline, response and collision surfaces."""

import re
from typing import TYPE_CHECKING

import numpy as np

from taichisoft.errors import SceneError
from taichisoft_sofa.components.draft import DraftPlane, DraftSurface
from taichisoft_sofa.components.graph import TOPOLOGIES, nearest, node_of
from taichisoft_sofa.components.loaded_mesh import split_quads
from taichisoft_sofa.components.typed_values import computed, described, flag, number, numbers, text, vector

if TYPE_CHECKING:
    from collections.abc import Callable

    from taichisoft_sofa.components.draft import SceneDraft
    from taichisoft_sofa.tree.component import Component

DEFAULT_FRICTION = 0.8
"""Default friction coefficient of SOFA's frictional contacts [-]."""
WITHOUT_FRICTION = "PenalityContactForceField"
"""SOFA's default response."""


def role(name: str) -> "Callable[[Component, SceneDraft], None]":
    """Make the entry of a component with a role in contact: "pipeline", "broad phase", "response", "distance"."""

    def set_role(component: "Component", draft: "SceneDraft") -> None:
        draft.pipeline[name] = component

    set_role.__doc__ = f"The {name} of contacts."

    return set_role


def friction_of(response: "Component", draft: "SceneDraft") -> float:
    """Friction coefficient of a contact manager for all pairs of bodies [-]; 0 if its contacts have none in SOFA.

    Raises:
        SceneError: the coefficient is not a number of 0 or more.
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


def penalty_plane(component: "Component", draft: "SceneDraft") -> None:
    """Translate a plane that pushes the points of a body out of what is behind it."""
    body = draft.body_of(component)
    if body is None:
        return
    normal = vector(component, "normal", "planeNormal", default=(0.0, 1.0, 0.0))
    length = float(np.linalg.norm(normal))
    if length == 0.0:
        draft.refuse(component, "normal = 0 0 0 has no direction")
        return
    if flag(component, "bilateral", False):
        draft.refuse(component, "bilateral = true; planes push from one side here")
        return
    draft.planes.append(
        DraftPlane(component, body, normal / length, number(component, "d", "planeD", default=0.0) / length)
    )


def collision_model(component: "Component", draft: "SceneDraft") -> None:
    """Translate a collision model; all models of a node are one surface."""
    body = draft.carrier_of(component)
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
        body.surfaces[path] = DraftSurface(component, points, triangles, groups, False)
    body.surfaces[path].self_collision |= flag(component, "selfCollision", False)


def surface_triangles(topology: "Component") -> np.ndarray:
    """Triangles of a container, with quads split in two, shape (count, 3)."""
    return np.vstack([computed(topology, "triangles", 3), split_quads(computed(topology, "quads", 4))])
