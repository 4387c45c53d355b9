"""Mechanical objects, and the mappings and joints by which they follow others."""

from taichisoft_sofa.components.draft import DraftJoint, SceneDraft
from taichisoft_sofa.components.meshes import TRANSFORMED, TURNED_AGAIN
from taichisoft_sofa.components.reading import STATE, in_node, inputs_of, is_assembled, mapping_of, node_of
from taichisoft_sofa.components.states import (
    FramePoses,
    index_pairs,
    is_rigid,
    rest_position,
    start_values,
    state_position,
    width_of,
)
from taichisoft_sofa.tree.component import Component, component, derived, unused, without_effect
from taichisoft_sofa.tree.value_kinds import FROM_0, INDICES, LINK, Declared, ValueKind, fixed, vectors


def _coordinates(state: "Component") -> ValueKind:
    return vectors(max(width_of(state), 1))


def _derivatives(state: "Component") -> ValueKind:
    return vectors(6 if is_rigid(state) else max(width_of(state), 1))


@component(
    STATE,
    position=derived(_coordinates, state_position),
    rest_position=Declared(_coordinates, live=True, compute=rest_position),
    velocity=_derivatives,
    force=_derivatives,
    externalForce=Declared(_derivatives, unused=True),
    free_position=_coordinates,
    free_velocity=_derivatives,
    reset_position=_coordinates,
    size=0,
    **TRANSFORMED,
    **TURNED_AGAIN,
    **{f"{letter}{axis}{more}": 0.0 for letter in "dr" for axis in "xyz" for more in ("", "2")},
    **{f"s{axis}": 1.0 for axis in "xyz"},
    showObject=False,
    restScale=1.0,
    **without_effect("freePosition restPosition reset_velocity"),
)
def mechanical_object(component: "Component", draft: "SceneDraft") -> None:
    """Make a body of an independent mechanical object, or of points that are put together from several others."""
    if draft.joint_of(component) is None and (
        mapping_of(component) is None or (is_assembled(component) and not is_rigid(component))
    ):
        draft.body_of(component)


# Mappings and the joints of articulated systems.

MAPPING = {
    **dict.fromkeys(("input", "input1", "input2", "output", "object1", "object2"), LINK),
    **dict.fromkeys(("mapConstraints", "mapForces", "mapMasses"), unused(True)),
}
"""Data of every mapping."""


@component("BarycentricMapping", "IdentityMapping", **MAPPING)
@component(
    "RigidMapping",
    **MAPPING,
    index=0,
    rigidIndexPerPoint=(INDICES, (), FROM_0),
    indexFromEnd=unused(False),
    repartition=unused(()),
    globalToLocalCoords=False,
)
@component("SkinningMapping", **MAPPING, nbRef=INDICES, indices=INDICES, weight=())
@component("SubsetMapping", **MAPPING, indices=(INDICES, (), FROM_0))
@component("ArticulatedHierarchyContainer", filename="")
@component(
    "ArticulationCenter",
    parentIndex=0,
    childIndex=0,
    posOnParent=fixed(3),
    posOnChild=fixed(3),
    articulationProcess=unused(0),
    **without_effect("articulations"),
)
@component(
    "Articulation",
    translation=False,
    rotation=False,
    rotationAxis=(fixed(3), (1.0, 0.0, 0.0)),
    articulationIndex=0,
)
def accept_mapping(component: "Component", draft: "SceneDraft") -> None:
    """Accept a mapping or a part of a joint, by which points and frames follow others."""


@component("ArticulatedSystemMapping", **MAPPING, indexInput2=0)
def articulated_mapping(component: "Component", draft: "SceneDraft") -> None:
    """Turn and shift frames by angles that springs hold to their rest position; soft bodies follow the frames."""
    state = in_node(node_of(component), {STATE})
    if state is None or not is_rigid(state):
        raise component.refused("turns nothing: there is no MechanicalObject of Rigid3 in its node")
    joint = next((draft.joint_of(angles) for angles in inputs_of(component)[:1]), None)
    if joint is None:
        raise component.refused("input1 must be a MechanicalObject of Vec1")
    FramePoses(start_values).of(state)
    joint.is_used = True


@component("SubsetMultiMapping", **MAPPING, indexPairs=INDICES)
def subset_mapping(component: "Component", draft: "SceneDraft") -> None:
    """Put points or frames together from several mechanical objects: points on frames are rigid parts of a body."""
    state = in_node(node_of(component), {STATE})
    if state is None:
        draft.refuse(component, "puts nothing together: there is no MechanicalObject in its node")
    elif is_rigid(state):
        FramePoses(start_values).of(state)
    else:
        index_pairs(component, len(inputs_of(component)))


def weigh_joint(component: "Component", joint: "DraftJoint") -> None:
    """Record the inertia of a joint: `vertexMass`, or a share of `totalMass`."""
    each = component.read_numbers("vertexMass", "mass")
    total = component.read_numbers("totalMass")[0]
    joint.mass = float(each[0]) if len(each) else float(total) / max(len(start_values(joint.state)), 1)


def held_joints(draft: "SceneDraft") -> "list[DraftJoint]":
    """Angles that turn frames, which bodies do not turn; angles that no mapping uses, or that are free, are refused."""
    held = []
    for joint in draft.joints.values():
        if not joint.is_used:
            draft.refuse(joint.state, "template 'Vec1'; known are Vec3 and Rigid3, and Vec1 for the angles of joints")
        elif joint.springs is None and not joint.moved:
            draft.refuse(joint.state, "turns freely; only angles that springs or a JointConstraint hold are known here")
        else:
            with draft.refusing():
                joint.stiffness(), joint.rest()
            joint.solver = draft.solver_above(node_of(joint.state))
            held.append(joint)
            draft.depart("joints: bodies do not turn them; in SOFA their springs give way by torque over stiffness")
    return held
