"""The table of components: translations by type, types without effect, and purposes of unknown types."""

from collections.abc import Callable

from taichisoft_sofa.components import actuator_components, contact_components, dynamics, selections, visuals
from taichisoft_sofa.components.draft import SceneDraft
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
    """Make a body of an independent mechanical object."""
    if not draft.is_mapped(component):
        draft.body_of(component)


UNDERSTOOD: dict[str, Contribution] = {
    # time and systems of equations
    "FreeMotionAnimationLoop": dynamics.animation_loop,
    "DefaultAnimationLoop": dynamics.animation_loop,
    "EulerImplicitSolver": dynamics.time_integration,
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
            "GenericConstraintSolver",
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
            "MeshTopology",
            "TetrahedronSetTopologyContainer",
            "TriangleSetTopologyContainer",
            "QuadSetTopologyContainer",
            "EdgeSetTopologyContainer",
            "PointSetTopologyContainer",
            "Tetra2TriangleTopologicalMapping",
            "BarycentricMapping",
            "RigidMapping",
            "IdentityMapping",
        ),
        _is_read,
    ),
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
    "TetrahedronHyperelasticityFEMForceField": dynamics.hyperelasticity,
    "RestShapeSpringsForceField": dynamics.rest_shape_springs,
    "FixedProjectiveConstraint": dynamics.fixed_points,
    "PartialFixedProjectiveConstraint": dynamics.fixed_points,
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

IGNORED = {
    "RequiredPlugin",
    "AddDataRepository",
    "AddPluginRepository",
    "DefaultVisualManagerLoop",
    "VisualManagerLoop",
    "VisualStyle",
    "VisualModelImpl",
    "OglGrid",
    "OglLabel",
    "OglViewport",
    "OglShadowShader",
    "LightManager",
    "DirectionalLight",
    "SpotLight",
    "PositionalLight",
    "RecordedCamera",
    "ViewerSetting",
    "StatsSetting",
    "MouseButtonSetting",
    "AttachBodyButtonSetting",
    "SofaDefaultPathSetting",
    "APIVersion",
    "InfoComponent",
    "MessageHandlerComponent",
    "FileMessageHandlerComponent",
    "Monitor",
    "VTKExporter",
    "STLExporter",
    "OBJExporter",
    "MeshExporter",
    "VisualModelOBJExporter",
    "WriteState",
    "ExtraMonitor",
    "Visual3DText",
    "PythonMainScriptController",
    # modifiers of meshes, and geometry algorithms: meshes never change here
    "TetrahedronSetTopologyModifier",
    "TetrahedronSetTopologyAlgorithms",
    "TetrahedronSetGeometryAlgorithms",
    "TriangleSetTopologyModifier",
    "TriangleSetTopologyAlgorithms",
    "TriangleSetGeometryAlgorithms",
    "EdgeSetTopologyModifier",
    "EdgeSetTopologyAlgorithms",
    "EdgeSetGeometryAlgorithms",
    "PointSetTopologyModifier",
    "PointSetTopologyAlgorithms",
    "PointSetGeometryAlgorithms",
}
"""Types without effect on the motion of a scene."""

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


def purpose(type_name: str) -> str:
    """Purpose of an unknown component, by its name."""
    return next((what for ending, what in PURPOSES.items() if type_name.endswith(ending)), "an unknown purpose")
