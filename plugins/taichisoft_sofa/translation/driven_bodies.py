"""Rigid bodies that follow frames: joints turn these, the scene places them, or springs lead them without inertia."""

from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft_sofa.components.anchor_targets import PointsTarget
from taichisoft_sofa.components.draft import DraftBody, DraftFrame
from taichisoft_sofa.components.frames import FramePoses, base_frames, composed, start_values
from taichisoft_sofa.components.graph import node_of
from taichisoft_sofa.components.typed_values import flag
from taichisoft_sofa.components.visuals import visible_shapes
from taichisoft_sofa.translation.contact import collides
from taichisoft_sofa.translation.distinct_names import clean
from taichisoft_sofa.translation.rigid_bodies import degrees, groups_of, joined_surfaces, only_sphere
from taichisoft_sofa.translation.rigid_parts import is_driven, note_springs, parts_of_bodies

if TYPE_CHECKING:
    from taichisoft_sofa.components.draft import SceneDraft
    from taichisoft_sofa.translation.parts import Translation
    from taichisoft_sofa.tree.component import Component


def is_placed(body: DraftBody, solver: "Component | None") -> bool:
    """Whether the scene places a moving rigid body: it has no mass, or springs lead it in overdamped dynamics."""
    if not body.rigid or solver is None:
        return False
    held = any(anchor.follows_rest or anchor.target for anchor in body.anchors)
    return body.mass is None or (held and flag(solver, "firstOrder", False))


def driven_frames(draft: "SceneDraft") -> list[DraftFrame]:
    """Frames that become bodies of their own; surfaces on frames that a soft body moves are given to that body."""
    parts, found = parts_of_bodies(draft), []
    for key in parts.keys() & draft.bodies.keys():
        if (own := draft.bodies[key]).rigid and (own.surfaces or own.shapes):
            frame = DraftFrame(own.state, 0, own.surfaces, own.colours, own.shapes)
            draft.frames.setdefault((key, 0), frame)
    for frame in draft.frames.values():
        soft = [parts[id(base)] for base, _ in base_frames(frame.state, frame.index) if id(base) in parts]
        if is_driven(frame.state, frame.index, draft):
            note_springs(frame.state, frame.index, draft)
            found.append(frame)
        elif soft and frame.surfaces:
            _give_surfaces(frame, soft[0], draft)
        else:
            for surface in frame.surfaces.values():
                draft.refuse(surface.component, "is on a frame that neither joints, the scene nor a soft body move")
    return found


def _give_surfaces(frame: DraftFrame, body: DraftBody, draft: "SceneDraft") -> None:
    """Let a soft body carry the surfaces of a frame that moves with it."""
    pose = FramePoses(start_values).of(frame.state)[[frame.index]]
    for path, surface in frame.surfaces.items():
        surface.points = composed(np.repeat(pose, len(surface.points), axis=0), surface.points)
        surface.is_carried = True
        body.surfaces[path] = surface
        draft.depart(f"{path}: follows the elastic solid that stands for frame {frame.index} of its body")


def placed_frame(body: DraftBody, draft: "SceneDraft") -> DraftFrame:
    """The frame of a rigid body that the scene places; springs lead it to its rest pose."""
    state, index = body.state, 0
    for anchor in body.anchors:
        if isinstance(anchor.target, PointsTarget):
            state, index = anchor.target.frame_of(0)
        elif anchor.follows_rest:
            draft.sprung[body.state] = None
            draft.depart(f"{body.node.getPathName()}: is where its rest pose is; in SOFA its springs give way")
    return DraftFrame(state, index, body.surfaces, body.colours, body.shapes)


def add_driven_body(name: str, frame: DraftFrame, draft: "SceneDraft", translation: "Translation") -> None:
    """Add a rigid body that follows a frame: with its surfaces, or else with the shapes of its visual models."""
    points, triangles = joined_surfaces(frame)
    touches, ball = bool(len(triangles)) and collides(draft), only_sphere(frame)
    if not len(triangles):
        points, triangles = _joined(frame.shapes)
    shape: dict[str, Any] = {"box": [1.0, 1.0, 1.0]}
    if ball is not None and not ball[:3].any():
        shape = {"sphere": {"radius": float(ball[3])}}
    elif len(triangles):
        shape = {"surface": translation.files.surface(name, points, triangles)}
    pose = FramePoses(start_values).of(frame.state)[frame.index]
    translation.tables.setdefault("rigid_bodies", {})[name] = {
        **shape,
        "follows": name,
        "collides": touches,
        "groups": groups_of(frame),
        "position": pose[:3].tolist(),
        "rotation": degrees(pose[3:]),
        **({"colour": frame.colours[0]} if frame.colours else {}),
        **({"axes": True} if flag(frame.state, "showObject", False) else {}),
    }
    translation.add_frame(name, frame.state, frame.index)
    if touches:
        draft.depart(f"{node_of(frame.state).getPathName()}: pushes what it touches, and does not give way")


def add_picture(draft: "SceneDraft", translation: "Translation") -> None:
    """Let a scene in which nothing moves or touches show its visual models, as one body that does neither."""
    points, triangles = _joined(visible_shapes(draft.visuals))
    if translation.tables.keys() & {"soft_bodies", "rigid_bodies"} or not len(triangles) or draft.refused:
        return
    name = clean(node_of(draft.visuals[0]).getName())
    table = {"surface": translation.files.surface(name, points, triangles), "follows": "base", "collides": False}
    translation.tables["rigid_bodies"] = {name: table}
    draft.depart("nothing moves or touches anything; the run shows the visual models")


def _joined(shapes: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Points and triangles of all shapes together."""
    first = np.cumsum([0, *(len(points) for points, _ in shapes)])
    points = np.vstack([np.zeros((0, 3)), *(points for points, _ in shapes)])
    triangles = [triangles + start for (_, triangles), start in zip(shapes, first[:-1], strict=True)]
    return points, np.vstack([np.zeros((0, 3), dtype=np.int64), *triangles])
