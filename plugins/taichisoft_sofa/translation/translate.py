"""Translation of a scene."""

from pathlib import Path
from typing import TYPE_CHECKING

from taichisoft.errors import SceneError
from taichisoft_sofa.components import computed as computed  # registers computed data
from taichisoft_sofa.components.component_table import UNDERSTOOD
from taichisoft_sofa.components.draft import DraftBody, DraftFrame, SceneDraft
from taichisoft_sofa.components.graph import node_of
from taichisoft_sofa.components.joints import check_joints
from taichisoft_sofa.components.refusals import INVERSE, refuse_inverse, refuse_unknown
from taichisoft_sofa.components.remarks import remarks
from taichisoft_sofa.components.typed_values import described, flag
from taichisoft_sofa.components.without_effect import instead_of, is_without_effect
from taichisoft_sofa.translation.contact import collides, contact_table
from taichisoft_sofa.translation.distinct_names import body_names
from taichisoft_sofa.translation.driven_bodies import (
    add_driven_body,
    add_picture,
    driven_frames,
    is_placed,
    placed_frame,
)
from taichisoft_sofa.translation.own_bodies import moved_by, own_bodies
from taichisoft_sofa.translation.parts import Joint, Translation
from taichisoft_sofa.translation.penalty_planes import add_planes
from taichisoft_sofa.translation.rigid_bodies import add_obstacle, add_rigid_body, only_sphere
from taichisoft_sofa.translation.rigid_parts import add_rigid_parts
from taichisoft_sofa.translation.soft_bodies import add_soft_body, body_tetrahedra
from taichisoft_sofa.translation.spring_cables import add_springs
from taichisoft_sofa.tree.own_components import OwnComponent
from taichisoft_sofa.tree.value_kinds import canonical

if TYPE_CHECKING:
    from taichisoft_sofa.tree.component import Component
    from taichisoft_sofa.tree.loading import SceneTree
    from taichisoft_sofa.tree.node import Node

MOST_BODIES = 1000
"""Largest number of bodies of a scene."""
BODIES = ("soft_bodies", "rigid_bodies", "obstacles")
"""Native tables of bodies."""


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
        if not _is_active(node):
            continue
        for component in node.objects:
            _gather(component, draft, translation)
    if draft.inverse:
        draft.refused.insert(0, refuse_inverse(draft.inverse))
    time_step = float(root.dt.read_value())
    frames: list[DraftFrame] = []
    try:
        bodies = own_bodies(draft)
        frames = driven_frames(draft)
    except SceneError as error:
        draft.refused.append(str(error))
        bodies = []
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
    try:
        if contact := contact_table(draft):
            translation.tables["contact"] = contact
    except SceneError as error:
        draft.refused.append(str(error))
    check_joints(draft)
    translation.joints = [
        Joint(joint.state, joint.springs, joint.mass, draft.above(node_of(joint.state), draft.solvers))
        for joint in draft.joints.values()
        if joint.springs is not None
    ]
    _add_bodies(bodies, frames, draft, translation)
    add_springs(draft, translation)
    add_planes(draft, translation)
    add_picture(draft, translation)
    translation.sprung = draft.sprung
    if draft.appearance:
        translation.tables["appearance"] = draft.appearance
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
    contribute = UNDERSTOOD.get(kind) or UNDERSTOOD.get(canonical(kind))
    if contribute is not None:
        translation.understood[kind] = translation.understood.get(kind, 0) + 1
        try:
            contribute(component, draft)
            for line in remarks(component):
                draft.depart(line)
        except SceneError as error:
            draft.refused.append(str(error))
    elif is_without_effect(kind):
        translation.ignored[kind] = translation.ignored.get(kind, 0) + 1
        if missed := instead_of(kind):
            draft.depart(f"{described(component)}: {missed}")
    elif kind in INVERSE:
        draft.inverse.append(component)
    elif isinstance(component, OwnComponent):
        draft.refuse(component, component.refusal)
    elif not is_controller(component):
        draft.refused.append(refuse_unknown(component))


def _dynamics(bodies: list[DraftBody], draft: SceneDraft) -> str:
    """How bodies move: without inertia ("overdamped"), to equilibrium ("static"), or ""; mixed scenes are refused."""
    found = [(body, moved_by(body, draft)) for body in bodies]
    moved = [solver for body, solver in found if solver is not None and not is_placed(body, solver)]
    first_order = {flag(solver, "firstOrder", False) for solver in moved}
    static = {solver.type_name == "StaticSolver" for solver in moved}
    if len(first_order) > 1:
        draft.refuse(moved[0], "firstOrder; all bodies of a scene have inertia, or none has")
    if len(static) > 1:
        draft.refuse(moved[0], "StaticSolver for some of the bodies; all of a scene are at equilibrium, or none is")
    return "static" if static == {True} else "overdamped" if first_order == {True} else ""


def is_controller(component: "Component") -> bool:
    """Whether a component is a controller defined by the scene."""
    from taichisoft_sofa.tree.component import Component

    return type(component) is not Component


def _add_bodies(bodies: list[DraftBody], frames: list[DraftFrame], draft: SceneDraft, translation: Translation) -> None:
    if len(bodies) > MOST_BODIES:  # each has its own meshes and surfaces, which would be written first
        draft.refuse(bodies[MOST_BODIES].state, f"is one of {len(bodies)} bodies; at most {MOST_BODIES} are known here")
        return
    names = body_names([*(body.node for body in bodies), *(node_of(frame.state) for frame in frames)])
    for name, frame in zip(names[len(bodies) :], frames, strict=True):
        add_driven_body(name, frame, draft, translation)
    for name, body in zip(names[: len(bodies)], bodies, strict=True):
        try:
            add_rigid_parts(body, draft)
            _add_body(name, body, draft, translation)
        except SceneError as error:
            draft.refused.append(str(error))
        for kind in BODIES:
            if body.colours and name in translation.tables.get(kind, {}):
                translation.tables[kind][name]["colour"] = body.colours[0]
        if flag(body.state, "showObject", False) and name in translation.tables.get("rigid_bodies", {}):
            translation.tables["rigid_bodies"][name]["axes"] = True  # for soft bodies SOFA shows the points


def _add_body(name: str, body: DraftBody, draft: SceneDraft, translation: Translation) -> None:
    """Add a body as a rigid body, soft body or obstacle."""
    solver = moved_by(body, draft)
    if body.rigid and any(anchor.directions == "xyz" and not anchor.follows_rest for anchor in body.anchors):
        solver = None  # its frame is fixed
    if not body.rigid and len(body_tetrahedra(body)):
        add_soft_body(name, body, solver, draft, translation)
    elif is_placed(body, solver):
        add_driven_body(name, placed_frame(body, draft), draft, translation)
    elif solver is None and body.shapes and not (body.surfaces and collides(draft)):
        add_driven_body(name, DraftFrame(body.state, 0, {}, body.colours, body.shapes), draft, translation)
    elif solver is None:
        add_obstacle(name, body, draft, translation)
    elif body.rigid or (len(body.position) == 1 and only_sphere(body) is not None):
        add_rigid_body(name, body, draft, translation)
    else:
        draft.refuse(body.state, "moves, but is neither rigid nor made of tetrahedra")
