"""Names that components had in older versions of SOFA."""

from taichisoft_sofa.tree.value_kinds import ALIASES

ALIASES.update(
    {
        "EulerImplicit": "EulerImplicitSolver",
        "CollisionResponse": "RuleBasedContactManager",
        "DefaultContactManager": "RuleBasedContactManager",
        "DefaultPipeline": "CollisionPipeline",
        "FixedConstraint": "FixedProjectiveConstraint",
        "PartialFixedConstraint": "PartialFixedProjectiveConstraint",
        "GenericConstraintSolver": "BlockGaussSeidelConstraintSolver",
        "FreeMotionMasterSolver": "FreeMotionAnimationLoop",
        "LinearMovementConstraint": "LinearMovementProjectiveConstraint",
        "Sphere": "SphereCollisionModel",
        "SphereModel": "SphereCollisionModel",
        "SphereSet": "SphereCollisionModel",
        "RegularGrid": "RegularGridTopology",
        "SparseGrid": "SparseGridTopology",
        "HexahedralFEMForceField": "HexahedronFEMForceField",
        "RigidRigidMapping": "RigidMapping",
        "Mesh": "MeshTopology",
        "MeshObjLoader": "MeshOBJLoader",
        "Triangle": "TriangleCollisionModel",
        "TriangleModel": "TriangleCollisionModel",
        "TriangleSet": "TriangleCollisionModel",
        "Line": "LineCollisionModel",
        "LineModel": "LineCollisionModel",
        "LineSet": "LineCollisionModel",
        "Point": "PointCollisionModel",
        "PointModel": "PointCollisionModel",
        "PointSet": "PointCollisionModel",
    }
)
