"""Rigid bodies and obstacles: poses, masses, inertias, surfaces."""

import warnings
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from taichisoft_sofa.components.draft import (
    DraftAnchor,
    DraftBody,
    DraftFrame,
    DraftMaterial,
    DraftSurface,
    SceneDraft,
)
from taichisoft_sofa.components.dynamics import HELD
from taichisoft_sofa.components.reading import STATE, inputs_of, is_assembled, mapping_of, nearest, node_of
from taichisoft_sofa.components.states import (
    DrivenFrameTarget,
    FramePoses,
    PointsTarget,
    base_frames,
    bases_of,
    index_pairs,
    rigid_indices,
    start_position,
    start_values,
    start_velocity,
    width_of,
)
from taichisoft_sofa.components.topologies import filled
from taichisoft_sofa.translation.parts import NO_TRIANGLES, Translation, collides
from taichisoft_sofa.tree.component import Component
from taichisoft_sofa.tree.value_kinds import canonical

# Rigid parts of soft bodies: points that follow a frame, which joints drive, or which moves with the body.

STIFFENING = 1e4
"""Young's modulus of a rigid part over that of the body [-]."""
SAME = 1e-6
"""Difference of poses that is round-off [mm] and [-]."""
STIFF = 1e6
"""Stiffness of springs that hold a frame of a soft body as if it were fixed [mN/mm]."""


@dataclass(frozen=True)
class RigidPart:
    """Points of a body that follow one frame.

    Attributes:
        state: mechanical object of the frame.
        index: index of the frame.
        points: indices of the points, shape (count,).
    """

    state: "Component"
    index: int
    points: np.ndarray


def rigid_parts(state: "Component") -> list[RigidPart]:
    """The rigid parts of a mechanical object that a SubsetMultiMapping puts together; none for another one."""
    mapping = mapping_of(state)
    if mapping is None or canonical(mapping.type_name) != "SubsetMultiMapping":
        return []
    inputs = inputs_of(mapping)
    pairs = index_pairs(mapping, len(inputs))
    parts = []
    for which, source in enumerate(inputs):
        carrier = mapping_of(source)
        if carrier is None or canonical(carrier.type_name) != "RigidMapping":
            continue
        frames = rigid_indices(carrier, len(start_position(source)))
        points = np.flatnonzero(pairs[:, 0] == which)
        frame_of_point = frames[pairs[points, 1]]
        for frame in np.unique(frame_of_point).tolist():
            parts.append(RigidPart(inputs_of(carrier)[0], frame, points[frame_of_point == frame]))
    return parts


def parts_of_bodies(draft: "SceneDraft") -> "dict[int, DraftBody]":
    """Bodies of which other mechanical objects are parts, by the identity of these."""
    found: dict[int, DraftBody] = {}
    for body in draft.bodies.values():
        if is_assembled(body.state) and not body.rigid:
            for base in bases_of(body.state):
                found[id(base)] = body
    return found


def is_driven(state: "Component", index: int, draft: "SceneDraft") -> bool:
    """Whether the scene says where a frame is: joints turn it, it is held, or nothing moves it."""
    return all(
        width_of(base) == 1
        or draft.solver_above(node_of(base)) is None
        or any(anchor.directions == "xyz" and own in (None, *anchor.points) for anchor in _anchors(base, draft))
        for base, own in base_frames(state, index)
    )


def note_springs(state: "Component", index: int, draft: "SceneDraft") -> None:
    """Record frames that springs hold to their rest pose, which stiff ones alone do here."""
    for base, own in base_frames(state, index):
        for anchor in _anchors(base, draft):
            if not anchor.follows_rest or own not in (None, *anchor.points):
                continue
            if anchor.stiffness < STIFF:
                draft.refuse(
                    anchor.component,
                    f"stiffness = {anchor.stiffness:g} on a frame that others follow; {STIFF:g} or more holds it here",
                )
            draft.sprung[base] = None
            draft.depart(
                f"{base.getPathName()}: springs hold its frames where their rest poses are; in SOFA they give way"
            )


def _anchors(state: "Component", draft: "SceneDraft") -> list[DraftAnchor]:
    body = draft.bodies.get(id(state))
    return [] if body is None else body.anchors


def add_rigid_parts(body: "DraftBody", draft: "SceneDraft") -> None:
    """Give a body anchors that follow driven frames, and stiff tetrahedra in place of frames that are free.

    A free frame has no inertia but that of its points, so points that keep their distances move as SOFA's do.
    """
    mapping = mapping_of(body.state)
    if mapping is None or canonical(mapping.type_name) != "SubsetMultiMapping" or not body.materials:
        return
    first, stiffness = body.materials[0], STIFFENING * max(one.young_modulus.max() for one in body.materials)
    _take_anchors(body, mapping, draft)
    for part in rigid_parts(body.state):
        where = f"{part.state.getPathName()}, frame {part.index}"
        if is_driven(part.state, part.index, draft):
            note_springs(part.state, part.index, draft)
            target = DrivenFrameTarget.carrying(part.state, part.index, body.position[part.points])
            body.anchors.append(DraftAnchor(mapping, part.points, HELD, follows_rest=False, target=target))
            continue
        for base, _ in base_frames(part.state, part.index):
            if (own := draft.bodies.get(id(base))) is not None and own.mass is not None:
                draft.refuse(own.mass.component, "gives mass to a frame of a soft body; give it to the body's points")
        tetrahedra = filled(body.position, part.points)
        if len(np.unique(tetrahedra)) < len(part.points):
            draft.refuse(
                part.state, f"frame {part.index} moves freely, and its {len(part.points)} points fill no volume"
            )
            continue
        young, poisson = np.full(len(tetrahedra), stiffness), np.full(len(tetrahedra), first.poisson_ratio[0])
        body.materials.append(DraftMaterial(mapping, tetrahedra, young, poisson, first.corotation, first.law))
        draft.depart(f"{where}: its points are joined by an elastic solid, {STIFFENING:g} times stiffer than the body")


def _take_anchors(body: "DraftBody", mapping: "Component", draft: "SceneDraft") -> None:
    """Take over the anchors of the mechanical objects with the points that move freely."""
    inputs = inputs_of(mapping)
    pairs = index_pairs(mapping, len(inputs))
    for which, source in enumerate(inputs):
        other = draft.bodies.get(id(source))
        if other is None or other.rigid:
            continue
        acting: list[Any] = [*other.materials, *other.cavities, *other.cables, *other.surfaces.values()]
        for component in (one.component for one in acting):
            draft.refuse(component, f"acts on a part of {body.node.getPathName()}; let it act on the whole")
        for anchor in other.anchors:
            whole = np.full(len(other.position), -1)
            whole[pairs[pairs[:, 0] == which, 1]] = np.flatnonzero(pairs[:, 0] == which)
            points = whole[anchor.points]
            if (points < 0).any():
                draft.refuse(anchor.component, f"holds points that are not in {body.node.getPathName()}")
                continue
            body.anchors.append(replace(anchor, points=points, follows_rest=False))


# The frames of one mechanical object, each a rigid body.


def frames_apart(body: DraftBody) -> list[DraftBody]:
    """The frames of a body as bodies; the body itself if it has one or is not rigid."""
    count = len(body.position)
    if not body.rigid or count == 1:
        return [body]
    mass = body.mass
    if mass is not None and mass.total is not None:
        mass = replace(mass, total=mass.total / count)
    carriers = {path: _carriers(surface, body) for path, surface in body.surfaces.items()}
    return [
        replace(
            body,
            position=body.position[[index]],
            index=index,
            mass=mass,
            anchors=[_at(anchor, index) for anchor in body.anchors if index in anchor.points],
            forces=[replace(push, forces=push.forces[push.points == index]) for push in body.forces],
            surfaces={
                path: surface.on(carriers[path] == index)
                for path, surface in body.surfaces.items()
                if index in carriers[path]
            },
            shapes=[] if index else body.shapes,
        )
        for index in range(count)
    ]


def _at(anchor: DraftAnchor, index: int) -> DraftAnchor:
    """What holds one frame of those that an anchor holds."""
    target, rows = anchor.target, np.flatnonzero(anchor.points == index)
    if isinstance(target, PointsTarget):
        target = replace(target, indices=target.indices[rows])
    return replace(anchor, points=np.zeros(1, dtype=np.int64), target=target)


def _carriers(surface: DraftSurface, body: DraftBody) -> np.ndarray:
    """The frame of each point of a surface, shape (point_count,)."""
    state = nearest(node_of(surface.component), {STATE})
    assert state is not None
    count, mapping = len(start_position(state)), mapping_of(state)
    if mapping is not None and (
        canonical(mapping.type_name) != "RigidMapping" or inputs_of(mapping)[0] is not body.state
    ):
        raise surface.component.refused(
            f"follows {len(body.position)} frames by {mapping.type_name}; use a RigidMapping"
        )
    carriers = np.arange(count) if mapping is None else rigid_indices(mapping, count)
    return np.repeat(carriers, len(surface.points) // max(count, 1))


LONGEST = 1e9
"""Duration of a force that never ends [s]."""
UNIT_INERTIA = np.eye(3)
"""Default inertia over mass of SOFA and STLIB [mm^2]."""


def add_rigid_body(name: str, body: DraftBody, draft: SceneDraft, translation: Translation) -> None:
    """Add a rigid body to a translation."""
    if body.mass is None:
        raise body.state.refused("moves, but has no mass; add a UniformMass")
    for surface in body.surfaces.values():
        if not len(surface.triangles):
            draft.refuse(surface.component, NO_TRIANGLES)
    points, triangles = joined_surfaces(body)
    mass = body.mass.total if body.mass.total is not None else body.mass.each or 0.0
    pose = body.position[0] if body.rigid else np.array([*body.position[0], 0.0, 0.0, 0.0, 1.0])
    ball = only_sphere(body)
    if not body.rigid and ball is not None:
        ball = np.array([0.0, 0.0, 0.0, ball[3]])  # its centre is the point itself
    shape = shape_of(name, points, triangles, ball, translation)
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
    solver = draft.solver_above(body.node)
    if solver is not None and solver.read_number("rayleighMass", default=0.0) > 0.0:
        draft.depart(f"{body.node.getPathName()}: rayleighMass does not slow a rigid body down here; in SOFA it does")
    _add_springs(name, body, table, draft, translation)
    for push in (push for push in body.forces if len(push.forces)):
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
            raise anchor.component.refused(
                "holds a rigid body in part, or twice; one spring field holds all of it here"
            )
        solver = draft.solver_above(body.node)
        table["springs"] = {
            "stiffness": float(anchor.stiffness),
            "angular_stiffness": anchor.angular,
            "rayleigh_stiffness": 0.0 if solver is None else solver.read_number("rayleighStiffness", default=0.0),
            "follows": name,
        }
        if isinstance(anchor.target, PointsTarget):
            state, index = anchor.target.frame_of(0)
            if not np.allclose(FramePoses(start_values).of(state)[index], body.position[0], rtol=0.0, atol=SAME):
                raise anchor.component.refused(
                    f"external_rest_shape: {state.getPathName()} begins elsewhere; a rigid body begins at rest"
                )
            translation.add_frame(name, state, index)
        else:
            translation.add_frame(name, body.state, body.index)
            draft.sprung[body.state] = None


def add_obstacle(name: str, body: DraftBody, draft: SceneDraft, translation: Translation) -> None:
    """Add an obstacle to a translation; without surfaces or collisions it is omitted."""
    points, triangles = joined_surfaces(body)
    if not collides(draft):
        return
    for surface in body.surfaces.values():
        if not len(surface.triangles):
            draft.refuse(surface.component, NO_TRIANGLES)
    if not len(triangles):
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


def shape_of(
    name: str, points: np.ndarray, triangles: np.ndarray, ball: np.ndarray | None, translation: Translation
) -> dict[str, Any]:
    """The shape of a native rigid body: a ball about its origin, a surface, or a box for a body without any."""
    if ball is not None and not ball[:3].any():
        return {"sphere": {"radius": float(ball[3])}}
    return (
        {"surface": translation.files.surface(name, points, triangles)} if len(triangles) else {"box": [1.0, 1.0, 1.0]}
    )


def joined_surfaces(body: DraftBody | DraftFrame) -> tuple[np.ndarray, np.ndarray]:
    """Points and triangles of all collision surfaces of a body."""
    return joined([(surface.points, surface.triangles) for surface in body.surfaces.values()])


def joined(shapes: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Points and triangles of all shapes together."""
    first = np.cumsum([0, *(len(points) for points, _ in shapes)])
    points = np.vstack([np.zeros((0, 3)), *(points for points, _ in shapes)])
    triangles = [triangles + start for (_, triangles), start in zip(shapes, first[:-1], strict=True)]
    return points, np.vstack([np.zeros((0, 3), dtype=np.int64), *triangles])


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
    if 0.0 < mass * load**2 < solver.read_number("threshold"):
        draft.depart(
            f"{body.node.getPathName()}: has its weight, which SOFA loses below the threshold of CGLinearSolver"
        )
