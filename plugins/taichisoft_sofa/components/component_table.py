"""The table of components: translations by type."""

from collections.abc import Callable

from taichisoft_sofa.components import (
    actuator_components,
    contact_components,
    dynamics,
    joints,
    selections,
    spheres,
    springs,
    visuals,
)
from taichisoft_sofa.components.draft import SceneDraft
from taichisoft_sofa.components.graph import is_assembled
from taichisoft_sofa.components.states import is_rigid
from taichisoft_sofa.tree.component import Component

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
    "StiffSpringForceField": springs.single_springs,
    "SpringForceField": springs.single_springs,
    "MeshSpringForceField": springs.mesh_springs,
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
    "SphereCollisionModel": spheres.sphere_model,
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
