"""The bodies of a scene that move or collide by themselves."""

from typing import TYPE_CHECKING

from taichisoft_sofa.components.draft import DraftBody, SceneDraft
from taichisoft_sofa.components.frames import bases_of
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
    for key in parts.keys() & draft.bodies.keys():
        for surface in draft.bodies[key].surfaces.values() if draft.bodies[key].rigid else ():
            draft.refuse(surface.component, "is a surface of a rigid part of a soft body; give the surface to the body")
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
    moving = {id(body.state): body for body in kept if moved_by(body, draft) is not None}
    for state, springs in draft.guides:
        for base in bases_of(state):
            if id(base) in moving or id(base) in parts:
                draft.refuse(
                    springs, f"leads to {state.getPathName()}, which moves; springs between bodies are not there"
                )
    return kept


def _is_mere_points(body: DraftBody) -> bool:
    """Whether nothing joins the points of a body and they touch nothing, but for spheres of a goal without mass."""
    touches = body.mass is not None or any(not len(surface.spheres) for surface in body.surfaces.values())
    if body.materials or body.cavities or body.cables or (body.surfaces and touches):
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
