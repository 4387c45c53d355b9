"""The bodies of a scene that move or collide by themselves."""

from typing import TYPE_CHECKING

from taichisoft_sofa.components.draft import DraftBody, SceneDraft
from taichisoft_sofa.translation.rigid_parts import parts_of_bodies
from taichisoft_sofa.translation.soft_bodies import body_tetrahedra

if TYPE_CHECKING:
    from taichisoft_sofa.tree.component import Component


def own_bodies(draft: SceneDraft) -> list[DraftBody]:
    """Bodies that are not parts of others, and not mere points: these touch nothing and nothing joins them.

    Raises:
        SceneError: the parts of a body cannot be found.
    """
    parts = parts_of_bodies(draft)
    bodies = [body for key, body in draft.bodies.items() if key not in parts]
    left_out: set[int] = set()
    for body in filter(_is_mere_points, bodies):
        moves, path = moved_by(body, draft) is not None, body.node.getPathName()
        if body.surfaces and not moves:
            continue  # an obstacle
        left_out.add(id(body))
        if body.surfaces:
            draft.depart(f"{path}: has no mass, so that the scene alone moves it; its spheres touch nothing")
        elif body.mass is not None and moves:
            draft.depart(f"{path}: its points are not joined and touch nothing; they are left out")
    kept = [body for body in bodies if id(body) not in left_out]
    return kept


def _is_mere_points(body: DraftBody) -> bool:
    """Whether nothing joins the points of a body and they touch nothing, but for spheres of a goal without mass."""
    touches = body.mass is not None or any(not len(surface.spheres) for surface in body.surfaces.values())
    if body.materials or body.cavities or body.cables or body.shapes or (body.surfaces and touches):
        return False
    return body.mass is None if body.rigid else not len(body_tetrahedra(body))


def moved_by(body: DraftBody, draft: SceneDraft) -> "Component | None":
    """The solver that moves a body; None if it stands still."""
    solver = draft.above(body.node, draft.solvers)
    if solver is None or not draft.free_motion or draft.above(body.node, draft.corrections) is not None:
        return solver
    path = body.node.getPathName()
    if draft.exact:
        draft.depart(f"{path}: stands still, since it has no constraint correction")
        return None
    draft.depart(
        f"{path}: moves and collides, though it has no constraint correction, without which SOFA moves nothing"
    )
    return solver
