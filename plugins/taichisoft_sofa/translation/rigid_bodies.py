"""Rigid bodies and obstacles: poses, masses, inertias, surfaces."""

import warnings
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from taichisoft_sofa.components.anchor_targets import PointsTarget
from taichisoft_sofa.components.draft import DraftBody, DraftFrame, SceneDraft
from taichisoft_sofa.components.dynamics import SPRING
from taichisoft_sofa.components.graph import node_of
from taichisoft_sofa.components.states import start_velocity
from taichisoft_sofa.components.typed_values import number
from taichisoft_sofa.translation.contact import collides
from taichisoft_sofa.translation.parts import Translation
from taichisoft_sofa.tree.value_kinds import canonical

LONGEST = 1e9
"""Duration of a force that never ends [s]."""
UNIT_INERTIA = np.eye(3)
"""Default inertia over mass of SOFA and STLIB [mm^2]."""


def add_rigid_body(name: str, body: DraftBody, draft: SceneDraft, translation: Translation) -> None:
    """Add a rigid body to a translation."""
    if len(body.position) != 1:
        draft.refuse(body.state, f"has {len(body.position)} rigid frames; one is known")
        return
    if body.mass is None:
        draft.refuse(body.state, "moves, but has no mass; add a UniformMass")
        return
    points, triangles = joined_surfaces(body)
    mass = body.mass.total if body.mass.total is not None else body.mass.each or 0.0
    pose = body.position[0] if body.rigid else np.array([*body.position[0], 0.0, 0.0, 0.0, 1.0])
    ball = only_sphere(body)
    if not body.rigid and ball is not None:
        ball = np.array([0.0, 0.0, 0.0, ball[3]])  # its centre is the point itself
    shape: dict[str, Any]
    if ball is not None and not ball[:3].any():
        shape = {"sphere": {"radius": float(ball[3])}}
    else:
        shape = {"surface": translation.files.surface(name, points, triangles)}
    if not len(triangles):  # an invisible body has no shape in SOFA, but a native body needs one
        shape = {"box": [1.0, 1.0, 1.0]}
    table: dict[str, Any] = {
        **shape,
        "collides": bool(len(triangles)) and collides(draft),
        "groups": groups_of(body),
        "mass": float(mass),
        **({"centre_of_mass": [0.0, 0.0, 0.0]} if "surface" in shape or "box" in shape else {}),
        "position": pose[:3].tolist(),
        "rotation": degrees(pose[3:]),
    }
    velocity = start_velocity(body.state)
    if velocity.any() and not translation.is_static:
        turning = velocity[3:] if body.rigid else np.zeros(3)
        table |= {"velocity": velocity[:3].tolist(), "angular_velocity": turning.tolist()}
    given = body.mass.inertia
    if given is not None and not (given == UNIT_INERTIA).all():
        table["inertia"] = (mass * given).tolist()
    elif not body.rigid:
        draft.depart(f"{body.node.getPathName()}: is a ball that rolls; in SOFA it is a point that does not turn")
    elif draft.exact or not len(triangles):
        table["inertia"] = (mass * UNIT_INERTIA).tolist()
    else:
        draft.depart(f"{body.node.getPathName()}: has the inertia of its shape; SOFA assumes 1 mm^2 per mass")
    _note_lost_weight(body, float(mass), draft)
    _add_springs(name, body, table, draft, translation)
    for push in body.forces:
        one = {"body": name, "force": push.forces.sum(axis=0).tolist(), "start": 0.0, "duration": LONGEST}
        translation.tables.setdefault("external_forces", []).append(one)
    translation.tables.setdefault("rigid_bodies", {})[name] = table
    translation.names[body.state] = name
    translation.rigid[name] = body


def _add_springs(
    name: str, body: DraftBody, table: dict[str, Any], draft: SceneDraft, translation: Translation
) -> None:
    """Springs of a rigid body, to its rest pose or to a frame of another mechanical object."""
    for anchor in body.anchors:
        if anchor.directions != "xyz" or "springs" in table:
            draft.refuse(
                anchor.component, "holds a rigid body in part, or twice; one spring field holds all of it here"
            )
            return
        solver = draft.above(body.node, draft.solvers)
        table["springs"] = {
            "stiffness": anchor.stiffness,
            "angular_stiffness": number(anchor.component, "angularStiffness", default=SPRING),
            "rayleigh_stiffness": 0.0 if solver is None else number(solver, "rayleighStiffness", default=0.0),
            "follows": name,
        }
        if isinstance(anchor.target, PointsTarget):
            translation.add_frame(name, *anchor.target.frame_of(0))
        else:
            translation.add_frame(name, body.state, 0)
            draft.sprung[body.state] = None


def add_obstacle(name: str, body: DraftBody, draft: SceneDraft, translation: Translation) -> None:
    """Add an obstacle to a translation; without surfaces or collisions it is omitted."""
    points, triangles = joined_surfaces(body)
    if not len(triangles) or not collides(draft):
        return
    ball = only_sphere(body)
    if body.rigid:
        points = points @ Rotation.from_quat(body.position[0, 3:]).as_matrix().T + body.position[0, :3]
    if ball is not None:
        centre = ball[:3]
        if body.rigid:
            centre = Rotation.from_quat(body.position[0, 3:]).apply(centre) + body.position[0, :3]
        table = {"sphere": {"radius": float(ball[3])}, "translation": centre.tolist()}
    else:
        table = {"surface": translation.files.surface(name, points, triangles)}
    translation.tables.setdefault("obstacles", {})[name] = table
    translation.names[body.state] = name


def only_sphere(body: DraftBody | DraftFrame) -> np.ndarray | None:
    """Centre and radius of the single sphere that is the whole surface of a body [mm], shape (4,), or None."""
    surfaces = list(body.surfaces.values())
    return surfaces[0].spheres[0] if len(surfaces) == 1 and len(surfaces[0].spheres) == 1 else None


def joined_surfaces(body: DraftBody | DraftFrame) -> tuple[np.ndarray, np.ndarray]:
    """Points and triangles of all collision surfaces of a body."""
    points, triangles, count = [np.zeros((0, 3))], [np.zeros((0, 3), dtype=np.int64)], 0
    for surface in body.surfaces.values():
        points.append(surface.points)
        triangles.append(surface.triangles + count)
        count += len(surface.points)
    return np.vstack(points), np.vstack(triangles)


def groups_of(body: DraftBody | DraftFrame) -> list[int]:
    """Collision groups of all surfaces of a body."""
    return sorted({group for surface in body.surfaces.values() for group in surface.groups})


def degrees(quaternion: np.ndarray) -> list[float]:
    """Rotations about the x, y and z axes, in this order [degrees], of a quaternion (x, y, z, w)."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # if the middle rotation is a right angle, any solution will do
        turns: list[float] = Rotation.from_quat(quaternion).as_euler("xyz", degrees=True).tolist()
    return turns


def _note_lost_weight(body: DraftBody, mass: float, draft: SceneDraft) -> None:
    """Record the lost weight: SOFA's conjugate gradient stops before its first iteration if the load is small."""
    solver = draft.above(body.node, draft.linear_solvers)
    if solver is None or canonical(solver.type_name) != "CGLinearSolver":
        return
    root = node_of(body.state).getRoot()
    load = mass * float(root.dt.read_value()) * float(np.linalg.norm(root.gravity.read_value()))
    if 0.0 < mass * load**2 < number(solver, "threshold", default=1e-5):
        draft.depart(
            f"{body.node.getPathName()}: has its weight, which SOFA loses below the threshold of CGLinearSolver"
        )
