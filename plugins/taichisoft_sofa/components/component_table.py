"""The table of components: translations by type."""

from collections.abc import Callable
from itertools import combinations

import numpy as np
import trimesh

from taichisoft.errors import SceneError
from taichisoft_sofa.components import (
    actuator_components,
    component_table,
    contact_components,
    dynamics,
    joints,
    selections,
    visuals,
)
from taichisoft_sofa.components.draft import DraftBody, DraftSpring, DraftSurface, SceneDraft
from taichisoft_sofa.components.frames import FramePoses, composed, local_position, start_values
from taichisoft_sofa.components.graph import (
    STATE,
    TOPOLOGIES,
    inputs_of,
    is_assembled,
    linked_state,
    mapping_of,
    nearest,
    node_of,
)
from taichisoft_sofa.components.states import is_rigid, start_position
from taichisoft_sofa.components.typed_values import computed, described, flag, is_given, number, numbers, text
from taichisoft_sofa.tree.component import Component
from taichisoft_sofa.tree.value_kinds import canonical

# Collision spheres about the points of mechanical objects.

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


# Springs between two points, of one mechanical object or of two.

STIFFNESS, DAMPING = 100.0, 5.0
"""SOFA's defaults of springs that are given one by one [mN/mm] and [mN s/mm]."""
MOST = 500
"""Largest number of springs of a scene: each is a row of the constraint solver."""
CELLS = {"lines": ("edges", 2), "triangles": ("triangles", 3), "quads": ("quads", 4)}
CELLS |= {"tetrahedra": ("tetrahedra", 4), "tetras": ("tetrahedra", 4), "cubes": ("hexahedra", 8)}
"""Kinds of cells whose corners springs of a mesh join, with their number of corners."""


def single_springs(component: "Component", draft: "SceneDraft") -> None:
    """Translate springs that are listed: by `spring`, rows of two indices, stiffness, damping and length at rest, or by
    `indices1` and `indices2`."""
    ends = _ends(component)
    rows = numbers(component, "spring", "springs")
    if rows.size % 5:
        raise SceneError(f"{described(component)}: spring has {rows.size} numbers; they are not rows of five")
    rows = rows.reshape(-1, 5)
    if not len(rows):
        first, second = (numbers(component, f"indices{end}").astype(np.int64) for end in (1, 2))
        if len(first) != len(second):
            raise SceneError(f"{described(component)}: indices1 has {len(first)} points, indices2 {len(second)}")
        lengths = numbers(component, "lengths", "length")
        if len(lengths) not in (len(first), 1):
            lengths = np.array([]) if not len(lengths) else lengths[:1]
        given = np.broadcast_to(lengths, len(first)) if len(lengths) else np.full(len(first), np.nan)
        each = (number(component, "stiffness", default=STIFFNESS), number(component, "damping", default=DAMPING))
        rows = np.column_stack([first, second, *(np.full(len(first), value) for value in each), given])
    damped = False
    for one, other, stiffness, damping, length in rows.tolist():
        damped |= damping > 0.0
        _add(component, draft, ends, (int(one), int(other)), stiffness, length)
    _note_damping(component, draft, damped)


def mesh_springs(component: "Component", draft: "SceneDraft") -> None:
    """Translate springs along edges and across cells of a topology; their stiffness is by relative stretch."""
    ends = _ends(component)
    link = text(component, "topology")
    topology = component.linked("topology") if link else nearest(node_of(component), TOPOLOGIES)
    if topology is None:
        draft.refuse(component, "finds no topology in its node or above")
        return
    done: set[tuple[int, int]] = set()
    damped = False
    for name, (kind, corners) in CELLS.items():
        modulus = number(component, f"{name}Stiffness", "stiffness", default=0.0)
        damped |= number(component, f"{name}Damping", "damping", default=0.0) > 0.0
        for cell in computed(topology, kind, corners).tolist() if modulus > 0.0 else ():
            for pair in combinations(cell, 2):
                if (key := (min(pair), max(pair))) not in done:
                    done.add(key)
                    _add(component, draft, ends, key, modulus, np.nan, relative=True)
    _note_damping(component, draft, damped)


def _ends(component: "Component") -> "tuple[Component, Component]":
    """The mechanical objects of the first and the second points: linked ones, else the one of the node."""
    own, found = nearest(node_of(component), {STATE}), []
    for name in ("object1", "object2"):
        links = component.linked_all(name) if is_given(component, name) else []
        state = linked_state(component, *links[0]) if links else own
        if state is None:
            raise SceneError(f"{described(component)}: finds no MechanicalObject in its node or above")
        found.append(state)
    return found[0], found[1]


def _add(
    component: "Component",
    draft: "SceneDraft",
    ends: "tuple[Component, Component]",
    points: tuple[int, int],
    stiffness: float,
    length: float,
    relative: bool = False,
) -> None:
    """Add a spring; without a length it is at rest, and with a relative stiffness that is by relative stretch."""
    places = []
    for state, point in zip(ends, points, strict=True):
        if not draft.has_points(component, np.array([point]), len(start_position(state))):
            return
        places.append(_place(state, point))
    distance = float(np.linalg.norm(places[1] - places[0]))
    if distance == 0.0:
        draft.refuse(component, f"joins points {points[0]} and {points[1]} at one place; a spring needs a length here")
        return
    if len(draft.springs) == MOST:
        draft.refuse(component, f"makes more than {MOST} springs; elements of a mesh are the way to have so many")
    if len(draft.springs) >= MOST or stiffness <= 0.0:
        return
    rest = distance if np.isnan(length) else length
    modulus = stiffness * distance if not relative else stiffness
    pushes = not flag(component, "noCompression", False)
    draft.springs.append(DraftSpring(component, ends, points, modulus, distance - rest, pushes))


def _place(state: "Component", point: int) -> np.ndarray:
    """Place of a point at the start [mm], also of one that is given in the axes of a frame."""
    mapping, local = mapping_of(state), local_position(state)[[point], :3]
    if mapping is not None and canonical(mapping.type_name) == "RigidMapping":
        local = composed(FramePoses(start_values).of(inputs_of(mapping)[0])[:1], local)
    found: np.ndarray = local[0]
    return found


def _note_damping(component: "Component", draft: "SceneDraft", damped: bool) -> None:
    if damped:
        draft.depart(f"{component.getPathName()}: its springs have no damping of their own here")


Contribution = Callable[[Component, SceneDraft], None]


def _is_read(component: Component, draft: SceneDraft) -> None:
    """Accept loaders, containers, engines and mappings, which other components read."""


def _selection(component: Component, draft: SceneDraft) -> None:
    """Accept an engine, and record points whose selection differs from SOFA's by round-off."""
    lost = selections.lost_to_round_off(component)
    if len(lost):
        draft.depart(
            f"{component.getPathName()}: point {lost[0]} lies on a face of the box; in SOFA the round-off of a zero "
            "decides, against it"
        )


def _state(component: Component, draft: SceneDraft) -> None:
    """Make a body of an independent mechanical object, or of points that are put together from several others."""
    if draft.joint_of(component) is None and (
        not draft.is_mapped(component) or (is_assembled(component) and not is_rigid(component))
    ):
        draft.body_of(component)


UNDERSTOOD: dict[str, Contribution] = {
    # time and systems of equations
    "FreeMotionAnimationLoop": dynamics.animation_loop,
    "DefaultAnimationLoop": dynamics.animation_loop,
    "EulerImplicitSolver": dynamics.time_integration,
    "StaticSolver": dynamics.time_integration,
    **dict.fromkeys(
        (
            "SparseLDLSolver",
            "AsyncSparseLDLSolver",
            "SparseCholeskySolver",
            "SparseLUSolver",
            "EigenSimplicialLDLT",
            "EigenSimplicialLLT",
            "EigenSparseLU",
            "EigenSparseQR",
            "BTDLinearSolver",
            "PrecomputedLinearSolver",
            "CGLinearSolver",
            "CGLinearSolver2",
            "ParallelCGLinearSolver",
            "MinResLinearSolver",
            "PCGLinearSolver",
            "ShewchukPCGLinearSolver",
            "CholeskySolver",
        ),
        dynamics.linear_solver,
    ),
    **dict.fromkeys(
        (
            "LinearSolverConstraintCorrection",
            "GenericConstraintCorrection",
            "UncoupledConstraintCorrection",
            "PrecomputedConstraintCorrection",
        ),
        dynamics.constraint_correction,
    ),
    **dict.fromkeys(
        (
            "BlockGaussSeidelConstraintSolver",
            "ProjectedGaussSeidelConstraintSolver",
            "UnbuiltGaussSeidelConstraintSolver",
            "NNCGConstraintSolver",
            "ImprovedJacobiConstraintSolver",
            "LCPConstraintSolver",
        ),
        contact_components.role("constraint solver"),
    ),
    # meshes, topology, selections, mappings
    **dict.fromkeys(
        (
            "MeshVTKLoader",
            "MeshSTLLoader",
            "MeshOBJLoader",
            "MeshGmshLoader",
            "GIDMeshLoader",
            "MeshTopology",
            "TetrahedronSetTopologyContainer",
            "TriangleSetTopologyContainer",
            "QuadSetTopologyContainer",
            "EdgeSetTopologyContainer",
            "PointSetTopologyContainer",
            "HexahedronSetTopologyContainer",
            "RegularGridTopology",
            "SparseGridTopology",
            "Tetra2TriangleTopologicalMapping",
            "Hexa2TetraTopologicalMapping",
            "Hexa2QuadTopologicalMapping",
            "Quad2TriangleTopologicalMapping",
            "BarycentricMapping",
            "RigidMapping",
            "IdentityMapping",
            "SkinningMapping",
            "SubsetMapping",
            "ArticulatedHierarchyContainer",
            "ArticulationCenter",
            "Articulation",
        ),
        _is_read,
    ),
    **dict.fromkeys(
        ("TransformEngine", "IndexValueMapper", "ValuesFromIndices", "PointsFromIndices", "MergeSets"), _is_read
    ),
    "SubsetMultiMapping": joints.subset_mapping,
    "ArticulatedSystemMapping": joints.articulated_mapping,
    "MechanicalObject": _state,
    "BoxROI": _selection,
    "SphereROI": _selection,
    # masses, elasticity, supports
    "UniformMass": dynamics.uniform_mass,
    "MeshMatrixMass": dynamics.mass_by_volume,
    "DiagonalMass": dynamics.mass_by_volume,
    "TetrahedronFEMForceField": dynamics.tetrahedron_elasticity,
    "FastTetrahedralCorotationalForceField": dynamics.tetrahedron_elasticity,
    "TetrahedralCorotationalFEMForceField": dynamics.tetrahedron_elasticity,
    "HexahedronFEMForceField": dynamics.hexahedron_elasticity,
    "ParallelHexahedronFEMForceField": dynamics.hexahedron_elasticity,
    "TetrahedronHyperelasticityFEMForceField": dynamics.hyperelasticity,
    "RestShapeSpringsForceField": dynamics.rest_shape_springs,
    "FixedProjectiveConstraint": dynamics.fixed_points,
    "PartialFixedProjectiveConstraint": dynamics.fixed_points,
    "StiffSpringForceField": component_table.single_springs,
    "SpringForceField": component_table.single_springs,
    "MeshSpringForceField": component_table.mesh_springs,
    "PlaneForceField": contact_components.penalty_plane,
    "ConstantForceField": dynamics.constant_forces,
    "LinearMovementProjectiveConstraint": dynamics.prescribed_motion,
    # contact
    "CollisionPipeline": contact_components.role("pipeline"),
    **dict.fromkeys(
        (
            "BruteForceBroadPhase",
            "BruteForceDetection",
            "IncrSAP",
            "DirectSAP",
            "ParallelBruteForceBroadPhase",
        ),
        contact_components.role("broad phase"),
    ),
    **dict.fromkeys(("BVHNarrowPhase", "ParallelBVHNarrowPhase"), contact_components.role("narrow phase")),
    "RuleBasedContactManager": contact_components.role("response"),
    **dict.fromkeys(
        (
            "LocalMinDistance",
            "MinProximityIntersection",
            "NewProximityIntersection",
            "DiscreteIntersection",
        ),
        contact_components.role("distance"),
    ),
    **dict.fromkeys(
        (
            "TriangleCollisionModel",
            "LineCollisionModel",
            "PointCollisionModel",
        ),
        contact_components.collision_model,
    ),
    "SphereCollisionModel": component_table.sphere_model,
    # actuators
    "SurfacePressureConstraint": actuator_components.cavity,
    "CableConstraint": actuator_components.cable,
    # appearance
    "OglModel": visuals.visual_model,
    "VisualModel": visuals.visual_model,
    "BackgroundSetting": visuals.background,
    "OglSceneFrame": visuals.axes,
    **dict.fromkeys(("Camera", "InteractiveCamera"), visuals.camera),
}
"""Translation of each type to the draft of a scene."""
