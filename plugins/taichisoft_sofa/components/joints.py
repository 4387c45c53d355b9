"""Joints: angles held by springs, and the frames that they turn."""

from typing import TYPE_CHECKING

from taichisoft_sofa.components.frames import FramePoses, index_pairs, start_values
from taichisoft_sofa.components.graph import STATE, in_node, inputs_of, node_of
from taichisoft_sofa.components.states import is_rigid
from taichisoft_sofa.components.typed_values import numbers

if TYPE_CHECKING:
    from taichisoft_sofa.components.draft import DraftJoint, SceneDraft
    from taichisoft_sofa.tree.component import Component


def articulated_mapping(component: "Component", draft: "SceneDraft") -> None:
    """Turn and shift frames by angles that springs hold to their rest position; soft bodies follow the frames."""
    state = in_node(node_of(component), {STATE})
    if state is None or not is_rigid(state):
        draft.refuse(component, "turns nothing: there is no MechanicalObject of Rigid3 in its node")
        return
    joint = next((draft.joint_of(angles) for angles in inputs_of(component)[:1]), None)
    if joint is None:
        draft.refuse(component, "input1 must be a MechanicalObject of Vec1")
        return
    FramePoses(start_values).of(state)
    joint.is_used = True


def subset_mapping(component: "Component", draft: "SceneDraft") -> None:
    """Put points or frames together from several mechanical objects: points on frames are rigid parts of a body."""
    state = in_node(node_of(component), {STATE})
    if state is None:
        draft.refuse(component, "puts nothing together: there is no MechanicalObject in its node")
    elif is_rigid(state):
        FramePoses(start_values).of(state)
    else:
        index_pairs(component, len(inputs_of(component)))


def check_joints(draft: "SceneDraft") -> None:
    """Refuse angles that no mapping uses, or that no springs hold; record that bodies do not turn the others."""
    for joint in draft.joints.values():
        if not joint.is_used:
            draft.refuse(joint.state, "template 'Vec1'; known are Vec3 and Rigid3, and Vec1 for the angles of joints")
        elif joint.springs is None:
            draft.refuse(
                joint.state, "turns freely; only angles that a RestShapeSpringsForceField holds are known here"
            )
        else:
            draft.depart("joints: bodies do not turn them; in SOFA their springs give way by torque over stiffness")


def hold_joint(component: "Component", joint: "DraftJoint") -> None:
    """Record the springs of a joint."""
    joint.springs = component


def weigh_joint(component: "Component", joint: "DraftJoint") -> None:
    """Record the inertia of a joint: `vertexMass`, or a share of `totalMass`."""
    each = numbers(component, "vertexMass", "mass")
    total = numbers(component, "totalMass", default=[1.0])[0]
    joint.mass = float(each[0]) if len(each) else float(total) / max(len(start_values(joint.state)), 1)
