"""Collision spheres about the points of mechanical objects."""

from typing import TYPE_CHECKING

import numpy as np
import trimesh

from taichisoft_sofa.components.draft import DraftBody, DraftSurface
from taichisoft_sofa.components.graph import node_of
from taichisoft_sofa.components.typed_values import flag, number, numbers

if TYPE_CHECKING:
    from taichisoft_sofa.components.draft import SceneDraft
    from taichisoft_sofa.tree.component import Component

FINEST, COARSEST = 2, 1
"""Subdivisions of an icosahedron for a few spheres, and for many."""
FEW = 20


def sphere_model(component: "Component", draft: "SceneDraft") -> None:
    """Translate spheres about points: a single one of a rigid body or point stays round, others become polyhedra."""
    body = draft.carrier_of(component)
    if body is None:
        return
    centres = draft.points_of(component)
    each = numbers(component, "listRadius")
    radii = each if len(each) else np.full(len(centres), number(component, "radius", default=1.0))
    if len(radii) != len(centres):
        draft.refuse(component, f"listRadius has {len(radii)} numbers for {len(centres)} points")
        return
    if not len(centres):
        draft.refuse(component, "has no points to be the centres of its spheres")
        return
    ball = trimesh.creation.icosphere(subdivisions=FINEST if len(centres) <= FEW else COARSEST)
    points = (centres[:, None] + radii[:, None, None] * np.array(ball.vertices)).reshape(-1, 3)
    triangles = (np.arange(len(centres))[:, None, None] * len(ball.vertices) + np.array(ball.faces)).reshape(-1, 3)
    groups = frozenset(numbers(component, "group").astype(int).tolist())
    own = flag(component, "selfCollision", False)
    spheres = np.column_stack([centres, radii])
    surface = DraftSurface(component, points, triangles, groups, own, spheres=spheres)
    body.surfaces[f"{node_of(component).getPathName()} {component.getName()}"] = surface
    moves_as_one = not isinstance(body, DraftBody) or body.rigid or len(body.position) == 1
    if len(centres) > 1 or not moves_as_one:
        draft.depart(
            f"{component.getPathName()}: each sphere is a polyhedron of {len(ball.faces)} triangles, which deforms "
            "with a soft body"
        )
