"""Translation of a scene graph to a scene, part by part, with remarks and refusals."""

import difflib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from taichisoft.mesh import boundary_triangles
from taichisoft_sofa.components.draft import DraftBody, DraftFrame, DraftSprings, SceneDraft
from taichisoft_sofa.components.force_fields import add_weak_elements
from taichisoft_sofa.components.known_components import instead_of, is_without_effect, known_types
from taichisoft_sofa.components.mappings import held_joints
from taichisoft_sofa.components.reading import described, independent_state, mapping_of, node_of
from taichisoft_sofa.components.states import (
    FrameMotion,
    FramePoses,
    PointsTarget,
    base_frames,
    composed,
    local_position,
    rigid_indices,
    start_position,
    start_values,
)
from taichisoft_sofa.components.visuals import visible_shapes
from taichisoft_sofa.loading import SceneTree
from taichisoft_sofa.translation.parts import SoftPart, Translation, body_names, clean, collides, contact_table
from taichisoft_sofa.translation.rigid_bodies import (
    add_obstacle,
    add_rigid_body,
    add_rigid_parts,
    degrees,
    frames_apart,
    groups_of,
    is_driven,
    joined,
    joined_surfaces,
    note_springs,
    only_sphere,
    parts_of_bodies,
    shape_of,
)
from taichisoft_sofa.translation.soft_bodies import add_soft_body, body_tetrahedra
from taichisoft_sofa.tree.component import Component, misspelt, names_of
from taichisoft_sofa.tree.node import OF_NODES, Node
from taichisoft_sofa.tree.scene_controller import OwnComponent
from taichisoft_sofa.tree.value_kinds import LINK, Declared, canonical

# Springs: within a soft body between its nodes, else as cables that stretch, push as well as pull, and are held.


def add_springs(draft: "SceneDraft", translation: "Translation") -> None:
    """Add all springs of a scene to its soft bodies; a spring needs a soft body at one end at least."""
    soft = translation.tables.get("soft_bodies", {})
    for number, springs in enumerate(draft.springs):
        name = translation.names.get(springs.ends[0], "")
        if springs.is_inside and name in soft:
            _add_inside(f"springs{number}", springs, translation.soft[name], soft[name], draft)
        elif not springs.is_inside:
            _add_between(f"spring{number}", springs, draft, translation)


def _add_inside(name: str, springs: DraftSprings, part: SoftPart, table: dict[str, Any], draft: "SceneDraft") -> None:
    """Add springs between nodes of a body: those that push, and those that only pull."""
    node_of_point = np.full(len(part.body.position), -1)
    node_of_point[part.points] = np.arange(len(part.points))
    nodes = node_of_point[springs.pairs]
    if (nodes < 0).any():
        draft.depart(f"{springs.component.getPathName()}: springs at points that are left out have no effect")
    for suffix, chosen in (("", springs.pushes), ("cords", ~springs.pushes)):
        kept = chosen & (nodes >= 0).all(axis=1)
        if kept.any():
            columns = {"stiffness": springs.stiffness, "length": springs.lengths, "damping": springs.damping}
            table.setdefault("springs", {})[name + suffix] = {
                "nodes": nodes[kept].tolist(),
                "tension_only": bool(suffix),
                **{key: column[kept].tolist() for key, column in columns.items()},
            }


def _add_between(name: str, springs: DraftSprings, draft: "SceneDraft", translation: "Translation") -> None:
    for number, points in enumerate(springs.pairs.tolist()):
        ends = [_end(state, point, translation) for state, point in zip(springs.ends, points, strict=True)]
        if ends[0][0] not in translation.soft:
            ends.reverse()
        (owner, first), (other, second) = ends
        if owner not in translation.soft:
            raise springs.component.refused("joins no soft body; springs between rigid bodies are not there")
        distance = float(springs.distances[number])
        stiff = {"axial_stiffness": float(springs.stiffness[number]) * distance, "rod": bool(springs.pushes[number])}
        if other is None:  # a place that nothing moves
            ends_of_cable = {"points": [first], "pull_point": second, "pull_point_moves": False}
        else:
            ends_of_cable = {"points": [first, second if other == owner else {"body": other, "point": second}]}
        own = f"{name}_{number}"
        translation.tables["soft_bodies"][owner].setdefault("cables", {})[own] = stiff | ends_of_cable
        translation.springs[f"{owner}.{own}"] = distance - float(springs.lengths[number])


def _end(state: "Component", point: int, translation: "Translation") -> "tuple[str | None, list[float]]":
    """Name of the body that has a point, or None, and the point in the coordinates of the body [mm]."""
    base = independent_state(node_of(state))
    name = translation.names.get(base) if base is not None else None
    if name in translation.soft:
        return name, start_position(state)[point, :3].tolist()
    mapping = mapping_of(state)
    index = point if mapping is None else rigid_indices(mapping, len(start_position(state)))[point]
    for name, body in translation.rigid.items():
        if body.state is base and (body.index == index or not body.rigid):
            return name, ([0.0, 0.0, 0.0] if state is base else local_position(state)[point, :3].tolist())
    return None, start_position(state)[point, :3].tolist()


# Planes of penalty forces as native planes, which do not give way, without friction.

DISTANCE, ALARM = 0.01, 0.05
"""Contact distance and alarm distance of a scene without contacts, as shares of its smallest body's size [-]."""


def add_planes(draft: "SceneDraft", translation: "Translation") -> None:
    """Add the planes of a scene; they stand a contact distance behind where bodies stop."""
    if not draft.planes:
        return
    tables = translation.tables
    names = [translation.names.get(plane.body.state) for plane in draft.planes]
    if not collides(draft):
        sizes = [np.ptp(plane.body.position[:, :3], axis=0).min() for plane in draft.planes if not plane.body.rigid]
        size = float(min(sizes, default=100.0)) or 1.0
        tables["contact"] = {"friction": 0.0, "contact_distance": DISTANCE * size, "alarm_distance": ALARM * size}
    distance = tables.get("contact", {}).get("contact_distance", 1.0)
    group = 1 + max(
        (one for body in draft.bodies.values() for s in body.surfaces.values() for one in s.groups), default=0
    )
    for number, (plane, name) in enumerate(zip(draft.planes, names, strict=True)):
        body: dict[str, Any] = tables.get("soft_bodies", {}).get(name) or tables.get("rigid_bodies", {}).get(name, {})
        part = translation.soft.get(name or "")
        if name is None or (part is None and not body.get("collides")):
            draft.refuse(plane.component, "acts on a body without a surface; give it collision models")
            continue
        if part is not None and not body.get("collides", True):
            points = plane.body.position[part.points]
            skin = translation.files.surface(f"{name}-skin", points, boundary_triangles(part.elements))
            body |= {"collides": True, "collision_surface": [{"file": skin, "groups": [group + draft.own_groups]}]}
        own = f"plane{number}"
        place = ((plane.offset - distance) * plane.normal).tolist()
        tables.setdefault("obstacles", {})[own] = {"plane": {"point": place, "normal": plane.normal.tolist()}}
        tables["contact"].setdefault("pairs", []).append({"bodies": [name, own], "friction": 0.0})
        draft.depart(f"{plane.component.getPathName()}: does not give way; in SOFA by force over stiffness")
    if len(tables.get("soft_bodies", {})) + len(tables.get("rigid_bodies", {})) > len(set(names)):
        draft.depart("planes: are there for all bodies that collide")


# The bodies of a scene that move or collide by themselves.


def own_bodies(draft: SceneDraft) -> list[DraftBody]:
    """Bodies that are not parts of others, and not mere points: these touch nothing and nothing joins them."""
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
    return [frame for body in bodies if id(body) not in left_out for frame in frames_apart(body)]


def _is_mere_points(body: DraftBody) -> bool:
    """Whether nothing joins the points of a body and they touch nothing, but for spheres of a goal without mass."""
    touches = body.mass is not None or any(not len(surface.spheres) for surface in body.surfaces.values())
    if body.materials or body.cavities or body.cables or body.shapes or (body.surfaces and touches):
        return False
    return body.mass is None if body.rigid else not len(body_tetrahedra(body))


def moved_by(body: DraftBody, draft: SceneDraft) -> "Component | None":
    """The solver that moves a body; None if it stands still."""
    solver = draft.solver_above(body.node)
    if solver is not None and draft.above(body.node, draft.linear_solvers) is None:
        draft.depart(
            f"{body.node.getPathName()}: moves, though it has no linear solver, without which SOFA moves nothing"
        )
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


# Rigid bodies that follow frames: joints turn these, the scene places them, or springs lead them without inertia.


def is_placed(body: DraftBody, solver: "Component | None") -> bool:
    """Whether the scene places a moving rigid body: it has no mass, or springs lead it in overdamped dynamics."""
    if not body.rigid or solver is None:
        return False
    if motion_of(body) is not None:
        return True
    held = any(anchor.follows_rest or anchor.target for anchor in body.anchors)
    return body.mass is None or (held and solver.read_flag("firstOrder"))


def motion_of(body: DraftBody) -> FrameMotion | None:
    """The motion that the scene prescribes for the frames of a rigid body, or None."""
    return next((anchor.target for anchor in body.anchors if isinstance(anchor.target, FrameMotion)), None)


def driven_frames(draft: "SceneDraft") -> list[DraftFrame]:
    """Frames that become bodies of their own; surfaces on frames that a soft body moves are given to that body."""
    parts, found = parts_of_bodies(draft), []
    for key, own in draft.bodies.items():  # in the order of the tree
        if key in parts and own.rigid and (own.surfaces or own.shapes):
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
    state, index = body.state, body.index
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
        points, triangles = joined(frame.shapes)
    pose = FramePoses(start_values).of(frame.state)[frame.index]
    translation.tables.setdefault("rigid_bodies", {})[name] = {
        **shape_of(name, points, triangles, ball, translation),
        "follows": name,
        "collides": touches,
        "groups": groups_of(frame),
        "position": pose[:3].tolist(),
        "rotation": degrees(pose[3:]),
        **({"colour": frame.colours[0]} if frame.colours else {}),
        **({"axes": True} if frame.state.read_flag("showObject") else {}),
    }
    translation.add_frame(name, frame.state, frame.index)
    if touches:
        draft.depart(f"{node_of(frame.state).getPathName()}: pushes what it touches, and does not give way")


def add_picture(draft: "SceneDraft", translation: "Translation") -> None:
    """Let a scene in which nothing moves or touches show its visual models, as one body that does neither."""
    points, triangles = joined(visible_shapes(draft.visuals))
    if translation.tables.keys() & {"soft_bodies", "rigid_bodies"} or not len(triangles) or draft.refused:
        return
    name = clean(node_of(draft.visuals[0]).getName())
    table = {"surface": translation.files.surface(name, points, triangles), "follows": "base", "collides": False}
    translation.tables["rigid_bodies"] = {name: table}
    draft.depart("nothing moves or touches anything; the run shows the visual models")


# Data of a scene without effect: data with an effect in SOFA only, and data that nothing here reads.

LONGEST = 60
"""Largest number of characters of a value in a line."""
UNREAD = {"name", "template", "tags", "printLog", "listening", "componentState", "bbox"}
"""Data that move nothing in SOFA either."""


def _note_data(component: "Component", draft: SceneDraft, translation: Translation) -> None:
    """List the data of the scene that nothing reads; misspelt ones, and those with an effect in SOFA, one by one."""
    names = names_of(component.type_name)
    for name, data in component.data_by_name.items():
        if not data.is_set() or data.is_own() or name in UNREAD:
            continue
        known = component.declared_data(name)
        line = f"{described(component)}: {name} = {_shown(data.written_text())}"
        if known is None:
            if meant := misspelt(name, names):
                draft.depart(f"{line} is not read here; did you mean '{meant}'?")
            else:
                translation.not_read.setdefault(component.type_name, {})[name] = None
        elif not (known.unused or data.was_read or known.live):
            translation.not_read.setdefault(component.type_name, {})[name] = None
        elif known.kind is LINK:
            broken = [path for path, target in component.linked_all(name) if path.startswith("@") and target is None]
            draft.refused += [f"{described(component)}: {name} = '{path}' leads to nothing" for path in broken]
        elif known.unused and not _is_default(data.given(), known):
            draft.depart(f"{line} has no effect here")


def _is_default(value: Any, known: Declared) -> bool:
    """Whether a value is SOFA's default, for vectors an empty one or zeros."""
    if isinstance(value, np.ndarray):
        return not value.any()
    return bool(value == (known.default if known.default is not None else value))


def _shown(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) <= LONGEST else f"{line[: LONGEST - 3]}..."


# Reasons for which components are refused: the inverse solver, and types that are not known here.

INVERSE = {
    "QPInverseProblemSolver",
    *("PositionEffector", "BarycentricCenterEffector", "CableEffector", "VolumeEffector", "ForceEffector"),
    *("JointActuator", "CableActuator", "SurfacePressureActuator", "ForcePointActuator", "ForceSurfaceActuator"),
    *("SlidingActuator", "YoungModulusActuator", "ForceLocalizationActuator", "AffineActuator"),
    *("CableEquality", "PositionEquality", "SurfacePressureEquality", "ForcePointEquality", "SlidingEquality"),
    *("CableSensor", "PositionSensor", "SurfacePressureSensor", "ForceSurfaceSensor", "BarycentricCenterSensor"),
}
"""Types of SoftRobots.Inverse."""

PURPOSES = {
    "ForceField": "forces on the bodies",
    "Mass": "the mass of a body",
    "Solver": "how bodies move in time",
    "ConstraintCorrection": "how constraints move a body",
    "Constraint": "what bodies must not do, or an actuator",
    "CollisionModel": "a surface that touches others",
    "Intersection": "how contacts are found",
    "Mapping": "points that follow a body",
    "Loader": "a mesh",
    "Container": "the topology of a body",
    "Topology": "the topology of a body",
    "ROI": "a selection of points",
    "Engine": "data that other components read",
    "Controller": "what happens while the scene runs",
    "Actuator": "an actuator",
}
"""Purpose of a type of component, by the end of its name."""


def refuse_unknown(component: "Component") -> str:
    """Reason for which a component of a type that is not known here is refused."""
    kind = component.type_name
    purposes = [f"; it would be needed for {what}" for ending, what in PURPOSES.items() if kind.endswith(ending)]
    near = difflib.get_close_matches(kind, known_types(), n=1, cutoff=0.9)  # a misspelt name, not another component
    hint = f"; did you mean '{near[0]}'?" if near else ""
    return f"{described(component)}: is not known here{''.join(purposes[:1])}{hint}"


def refuse_inverse(components: "Sequence[Component]") -> str:
    """Reason for which a scene with components of the inverse solver is refused, in one line for all of them."""
    others = sorted({component.type_name for component in components} - {components[0].type_name})
    beside = f", beside {', '.join(others)}" if others else ""
    return (
        f"{described(components[0])}: belongs to the inverse solver of SoftRobots.Inverse{beside}, whose method is "
        "patented and not built here; a controller of the scene's own, or `taichisoft study optimise`, can find what "
        "reaches a goal"
    )


# Translation of a scene.

MOST_BODIES = 1000
"""Largest number of bodies of a scene."""
BODIES = ("soft_bodies", "rigid_bodies", "obstacles")
"""Native tables of bodies."""


NO_VACUUM = 1e12
"""Atmosphere of a scene whose pressures may be as low as they like, as in SOFA [kPa]."""


def translate(tree: "SceneTree", exact: bool = False) -> Translation:
    """Make a native scene of a tree.

    Args:
        tree: result of `load_tree`.
        exact: whether to follow SOFA exactly where the default departs from it.

    Returns:
        The translation; `refused` lists what could not be translated.
    """
    root = tree.root
    root._exact, root._find_file = exact, tree.find_file
    draft, translation = SceneDraft(exact=exact), Translation()
    for node in root.walk():
        for name in ("gravity", "dt"):
            if node is not root and node.is_given(name):
                translation.not_read.setdefault("Node", {})[name] = None
        for name in vars(node) | node.data_by_name:
            if name not in OF_NODES and not name.startswith("_") and (meant := misspelt(name, tuple(OF_NODES))):
                draft.depart(f"{node.described()}: {name} is not read here; did you mean '{meant}'?")
    active = [component for node in root.walk() if _is_active(node) for component in node.objects]
    for component in active:
        _gather(component, draft, translation)
    if draft.inverse:
        draft.refused.insert(0, refuse_inverse(draft.inverse))
    time_step = float(root.dt.read_value())
    bodies: list[DraftBody] = []
    frames: list[DraftFrame] = []
    with draft.refusing():
        add_weak_elements(draft)
        bodies, frames = own_bodies(draft), driven_frames(draft)
    dynamics = _dynamics(bodies, draft)
    draft.effort_of_value = translation.effort_of_value = 1.0 if dynamics == "overdamped" else 1.0 / time_step
    translation.tables = {
        "title": Path(tree.path).stem,
        "gravity": [float(value) for value in root.gravity.read_value()],
        "time": {"step": time_step, **({"dynamics": dynamics} if dynamics else {})},
    }
    if not draft.free_motion and any(body.cavities or body.cables for body in draft.bodies.values()):
        draft.depart(
            "pressures and cables act, though there is no FreeMotionAnimationLoop, without which SOFA has none"
        )
    if any(body.cavities for body in draft.bodies.values()):
        translation.tables["atmosphere"] = NO_VACUUM
    with draft.refusing():
        if contact := contact_table(draft):
            translation.tables["contact"] = contact
    translation.joints = held_joints(draft)
    with draft.refusing():
        _add_bodies(bodies, frames, draft, translation)
        add_springs(draft, translation)
    add_planes(draft, translation)
    add_picture(draft, translation)
    translation.sprung = draft.sprung
    translation.motions = {body.state: motion for body in bodies if (motion := motion_of(body)) is not None}
    if draft.appearance:
        translation.tables["appearance"] = draft.appearance
    for component in active:
        if canonical(component.type_name) in known_types():
            with draft.refusing():
                _note_data(component, draft, translation)
    translation.departures += draft.departures
    translation.refused += dict.fromkeys(draft.refused)  # several components may refuse the same value
    return translation


def _is_active(node: "Node") -> bool:
    """Whether a node and those on one way up to the root are active."""
    data = node.findData("activated")  # an attribute would search all components and children first
    active = data is None or bool(data.read_value())
    return active and (not node.parents or any(map(_is_active, node.parents)))


def _gather(component: "Component", draft: SceneDraft, translation: Translation) -> None:
    """Add a component to the draft."""
    kind = component.type_name
    known = known_types().get(canonical(kind))
    if known is not None:
        translation.understood[kind] = translation.understood.get(kind, 0) + 1
        with draft.refusing():
            known.translate(component, draft)
    elif is_without_effect(kind):
        translation.ignored[kind] = translation.ignored.get(kind, 0) + 1
        if missed := instead_of(kind):
            draft.depart(f"{described(component)}: {missed}")
    elif kind in INVERSE:
        draft.inverse.append(component)
    elif isinstance(component, OwnComponent):
        draft.refuse(component, component.refusal)
    elif type(component) is Component:  # else a controller that the scene defines
        draft.refused.append(refuse_unknown(component))


def _dynamics(bodies: list[DraftBody], draft: SceneDraft) -> str:
    """How bodies move: without inertia ("overdamped"), to equilibrium ("static"), or ""; mixed scenes are refused."""
    found = [(body, moved_by(body, draft)) for body in bodies]
    moved = [solver for body, solver in found if solver is not None and not is_placed(body, solver)]
    first_order = {solver.read_flag("firstOrder") for solver in moved}
    static = {solver.type_name == "StaticSolver" for solver in moved}
    if len(first_order) > 1:
        draft.refuse(moved[0], "firstOrder; all bodies of a scene have inertia, or none has")
    if len(static) > 1:
        draft.refuse(moved[0], "StaticSolver for some of the bodies; all of a scene are at equilibrium, or none is")
    return "static" if static == {True} else "overdamped" if first_order == {True} else ""


def _add_bodies(bodies: list[DraftBody], frames: list[DraftFrame], draft: SceneDraft, translation: Translation) -> None:
    if len(bodies) > MOST_BODIES:  # each has its own meshes and surfaces, which would be written first
        raise bodies[MOST_BODIES].state.refused(f"is one of {len(bodies)} bodies; at most {MOST_BODIES} are known here")
    names = body_names([*(body.node for body in bodies), *(node_of(frame.state) for frame in frames)])
    for name, frame in zip(names[len(bodies) :], frames, strict=True):
        add_driven_body(name, frame, draft, translation)
    for name, body in zip(names[: len(bodies)], bodies, strict=True):
        with draft.refusing():
            add_rigid_parts(body, draft)
            _add_body(name, body, draft, translation)
        for kind in BODIES:
            if body.colours and name in translation.tables.get(kind, {}):
                translation.tables[kind][name]["colour"] = body.colours[0]
        if body.state.read_flag("showObject") and name in translation.tables.get("rigid_bodies", {}):
            translation.tables["rigid_bodies"][name]["axes"] = True  # for soft bodies SOFA shows the points


def _add_body(name: str, body: DraftBody, draft: SceneDraft, translation: Translation) -> None:
    """Add a body as a rigid body, soft body or obstacle."""
    solver = moved_by(body, draft)
    held = (anchor for anchor in body.anchors if anchor.target is None and not anchor.follows_rest)
    if body.rigid and any(anchor.directions == "xyz" for anchor in held):
        solver = None  # its frame is fixed
    if not body.rigid and len(body_tetrahedra(body)):
        add_soft_body(name, body, solver, draft, translation)
    elif is_placed(body, solver):
        add_driven_body(name, placed_frame(body, draft), draft, translation)
    elif solver is None and body.shapes and not (body.surfaces and collides(draft)):
        add_driven_body(name, DraftFrame(body.state, body.index, {}, body.colours, body.shapes), draft, translation)
    elif solver is None:
        add_obstacle(name, body, draft, translation)
    elif body.rigid or (len(body.position) == 1 and only_sphere(body) is not None):
        add_rigid_body(name, body, draft, translation)
    else:
        draft.refuse(body.state, "moves, but is neither rigid nor made of tetrahedra")
