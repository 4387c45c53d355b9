"""Declarations of the data that are read: kinds, SOFA's defaults, and valid ranges."""

from taichisoft_sofa.components.graph import STATE, nearest, node_of
from taichisoft_sofa.components.states import is_rigid, width_of
from taichisoft_sofa.components.typed_values import text
from taichisoft_sofa.tree.component import Component
from taichisoft_sofa.tree.value_kinds import (
    ABOVE_0,
    ALIASES,
    ANY,
    BOOL,
    BOOLS,
    FINITE,
    FROM_0,
    INDICES,
    INTEGER,
    LIMIT,
    LIMIT_FROM_0,
    LINK,
    RATIO,
    SCALAR,
    TEXT,
    VECTOR,
    ValueKind,
    declare,
    fixed,
    index_rows,
    vectors,
)

# Names that components had in older versions of SOFA.

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


def _coordinates(state: Component) -> ValueKind:
    return vectors(max(width_of(state), 1))


def _derivatives(state: Component) -> ValueKind:
    return vectors(6 if is_rigid(state) else max(width_of(state), 1))


def _forces(component: Component) -> ValueKind:
    """Forces on points, or with torques on frames."""
    state = nearest(node_of(component), {STATE}) if component.getContext() is not None else None
    rigid = text(component, "template").startswith("Rigid") or (state is not None and is_rigid(state))
    return vectors(6 if rigid else 3)


declare(
    "MechanicalObject",
    velocity=_derivatives,
    force=_derivatives,
    externalForce=(_derivatives, None, FINITE, True),
    free_position=_coordinates,
    free_velocity=_derivatives,
    reset_position=_coordinates,
    size=INTEGER,
    translation=fixed(3),
    translation2=fixed(3),
    rotation=fixed(3),
    rotation2=fixed(3),
    scale=(SCALAR, 1.0),
    scale3d=(fixed(3), (1.0, 1.0, 1.0)),
    **{f"{letter}{axis}": SCALAR for letter in "dr" for axis in "xyz"},
    showObject=BOOL,
    topology=LINK,
    filename=TEXT,
)
for _loader in ("MeshVTKLoader", "MeshSTLLoader", "MeshOBJLoader", "MeshGmshLoader", "GIDMeshLoader"):
    declare(
        _loader,
        filename=TEXT,
        fileMesh=TEXT,
        fileTopology=TEXT,
        scale=(SCALAR, 1.0),
        scale3d=(fixed(3), (1.0, 1.0, 1.0)),
        rotation=fixed(3),
        rotation2=fixed(3),
        translation=fixed(3),
        translation2=fixed(3),
    )
for _container in (
    "MeshTopology",
    "TetrahedronSetTopologyContainer",
    "TriangleSetTopologyContainer",
    "QuadSetTopologyContainer",
    "HexahedronSetTopologyContainer",
    "EdgeSetTopologyContainer",
    "PointSetTopologyContainer",
):
    declare(
        _container,
        filename=TEXT,
        fileTopology=TEXT,
        nbPoints=(INTEGER, 0, FROM_0),
        scale=(SCALAR, 1.0),
        scale3d=(fixed(3), (1.0, 1.0, 1.0)),
        rotation=fixed(3),
        translation=fixed(3),
    )
declare(
    "BoxROI",
    box=vectors(6),
    orientedBox=vectors(10),
    position=vectors(3),
    strict=(BOOL, True),
    doUpdate=(BOOL, True),
    edges=index_rows(2),
    triangles=index_rows(3),
    quads=index_rows(4),
    tetrahedra=index_rows(4),
    hexahedra=index_rows(8),
)
declare(
    "SphereROI",
    centers=vectors(3),
    radii=(VECTOR, (), FROM_0),
    position=vectors(3),
    strict=(BOOL, True),
    doUpdate=(BOOL, True),
    edges=index_rows(2),
    triangles=index_rows(3),
    quads=index_rows(4),
    tetrahedra=index_rows(4),
    hexahedra=index_rows(8),
)
LINKS = dict.fromkeys(("input", "input1", "input2", "output", "object1", "object2"), LINK)
for _mapping in ("BarycentricMapping", "RigidMapping", "IdentityMapping", "SubsetMultiMapping", "SkinningMapping"):
    declare(_mapping, **LINKS)
declare("RigidMapping", index=INTEGER, rigidIndexPerPoint=(INDICES, (), FROM_0), globalToLocalCoords=BOOL)
declare("SubsetMultiMapping", indexPairs=INDICES)
declare("SubsetMapping", **LINKS, indices=(INDICES, (), FROM_0))
declare("SkinningMapping", nbRef=INDICES, indices=INDICES, weight=VECTOR)
declare("ArticulatedSystemMapping", **LINKS, indexInput2=INTEGER)
declare("ArticulatedHierarchyContainer", filename=TEXT)
declare("ArticulationCenter", parentIndex=INTEGER, childIndex=INTEGER, posOnParent=fixed(3), posOnChild=fixed(3))
declare(
    "Articulation",
    translation=BOOL,
    rotation=BOOL,
    rotationAxis=(fixed(3), (1.0, 0.0, 0.0)),
    articulationIndex=INTEGER,
)
for _made in ("Tetra2Triangle", "Hexa2Tetra", "Hexa2Quad", "Quad2Triangle"):
    declare(f"{_made}TopologicalMapping", input=LINK, output=LINK)
declare("Hexa2TetraTopologicalMapping", swapping=BOOL)
declare(
    "RegularGridTopology",
    n=(INDICES, (2, 2, 2), ABOVE_0),
    min=fixed(3),
    max=(fixed(3), (1.0, 1.0, 1.0)),
    p0=fixed(3),
    cellWidth=(SCALAR, 0.0, FROM_0),
    **{f"n{axis}": (INTEGER, 2, ABOVE_0) for axis in "xyz"},
    **{f"{axis}{end}": (SCALAR, value) for axis in "xyz" for end, value in (("min", 0.0), ("max", 1.0))},
)

declare(
    "SparseGridTopology",
    n=(INDICES, (2, 2, 2), ABOVE_0),
    min=fixed(3),
    max=fixed(3),
    cellWidth=(SCALAR, 0.0, FROM_0),
    **{f"n{axis}": (INTEGER, 2, ABOVE_0) for axis in "xyz"},
    filename=TEXT,
    fileTopology=TEXT,
    src=TEXT,
    scale=(SCALAR, 1.0),
    scale3d=(fixed(3), (1.0, 1.0, 1.0)),
    rotation=fixed(3),
    translation=fixed(3),
    vertices=vectors(3),
)

declare(
    "TransformEngine",
    input_position=vectors(3),
    translation=fixed(3),
    rotation=VECTOR,
    scale=(fixed(3), (1.0, 1.0, 1.0)),
    inverse=BOOL,
)
declare(
    "IndexValueMapper",
    inputValues=VECTOR,
    indices=(INDICES, (), FROM_0),
    value=SCALAR,
    defaultValue=(SCALAR, 1.0),
)
declare("ValuesFromIndices", indices=(INDICES, (), FROM_0), **{"in": VECTOR})
declare("PointsFromIndices", position=vectors(3), indices=(INDICES, (), FROM_0))
declare("MergeSets", in1=INDICES, in2=INDICES, op=(TEXT, "union"))

# time and systems of equations

for _integration in ("EulerImplicitSolver", "StaticSolver"):
    declare(
        _integration,
        rayleighStiffness=(SCALAR, 0.0, FROM_0),
        rayleighMass=(SCALAR, 0.0, FROM_0),
        firstOrder=BOOL,
        trapezoidalScheme=BOOL,
    )
declare("StaticSolver", newton_iterations=INTEGER)
declare("CGLinearSolver", threshold=(SCALAR, 1e-5, FROM_0))

# masses, elasticity, supports

declare(
    "UniformMass",
    totalMass=(SCALAR, 1.0, FROM_0),
    vertexMass=VECTOR,
    mass=VECTOR,
)
declare("MeshMatrixMass", lumping=BOOL)
for _mass in ("MeshMatrixMass", "DiagonalMass"):
    declare(_mass, totalMass=(SCALAR, 1.0, ABOVE_0), massDensity=(VECTOR, (1.0,), ABOVE_0))
for _field in (
    "TetrahedronFEMForceField",
    "FastTetrahedralCorotationalForceField",
    "TetrahedralCorotationalFEMForceField",
    "HexahedronFEMForceField",
    "ParallelHexahedronFEMForceField",
):
    declare(
        _field,
        youngModulus=(VECTOR, (5000.0,), FROM_0),
        poissonRatio=(VECTOR, (0.45,), RATIO),
        method=(TEXT, "large"),
        updateStiffness=BOOL,
        topology=LINK,
    )
declare("TetrahedronHyperelasticityFEMForceField", materialName=TEXT, ParameterSet=VECTOR, topology=LINK)
declare(
    "RestShapeSpringsForceField",
    points=(INDICES, (), FROM_0),
    indices=(INDICES, (), FROM_0),
    stiffness=(VECTOR, (), FROM_0),
    angularStiffness=(VECTOR, (), FROM_0),
    external_rest_shape=LINK,
    external_points=(INDICES, (), FROM_0),
)
for _support in ("FixedProjectiveConstraint", "PartialFixedProjectiveConstraint"):
    declare(
        _support,
        indices=(INDICES, (0,), FROM_0),
        fixAll=BOOL,
        fixedDirections=(BOOLS, (True, True, True)),
    )

for _springs in ("StiffSpringForceField", "SpringForceField"):
    declare(
        _springs,
        object1=LINK,
        object2=LINK,
        spring=VECTOR,
        springs=VECTOR,
        indices1=(INDICES, (), FROM_0),
        indices2=(INDICES, (), FROM_0),
        lengths=(VECTOR, (), FROM_0),
        length=(VECTOR, (), FROM_0),
        stiffness=(VECTOR, (100.0,), FROM_0),
        damping=(VECTOR, (5.0,), FROM_0),
    )
declare(
    "MeshSpringForceField",
    object1=LINK,
    object2=LINK,
    topology=LINK,
    noCompression=BOOL,
    **{
        f"{cells}{what}": (SCALAR, 0.0, FROM_0)
        for cells in ("lines", "triangles", "quads", "tetrahedra", "tetras", "cubes")
        for what in ("Stiffness", "Damping")
    },
    stiffness=(SCALAR, 0.0, FROM_0),
    damping=(SCALAR, 0.0, FROM_0),
)
declare(
    "PlaneForceField",
    normal=(fixed(3), (0.0, 1.0, 0.0)),
    planeNormal=(fixed(3), (0.0, 1.0, 0.0)),
    d=SCALAR,
    planeD=SCALAR,
    bilateral=BOOL,
    stiffness=(SCALAR, 500.0, FROM_0),
)
declare(
    "ConstantForceField",
    indices=(INDICES, (), FROM_0),
    points=(INDICES, (), FROM_0),
    force=_forces,
    forces=_forces,
    totalForce=_forces,
)
for _motion in ("LinearMovementProjectiveConstraint",):
    declare(
        _motion,
        indices=(INDICES, (0,), FROM_0),
        keyTimes=VECTOR,
        movements=vectors(3),
        relativeMovements=(BOOL, True),
    )

# contact

for _solver in (
    *("BlockGaussSeidelConstraintSolver", "ProjectedGaussSeidelConstraintSolver", "NNCGConstraintSolver"),
    *("UnbuiltGaussSeidelConstraintSolver", "ImprovedJacobiConstraintSolver", "LCPConstraintSolver"),
):
    declare(_solver, constraintForces=VECTOR)
declare("RuleBasedContactManager", response=(TEXT, "PenalityContactForceField"), responseParams=TEXT, default=TEXT)
for _distance in ("LocalMinDistance", "MinProximityIntersection", "NewProximityIntersection", "DiscreteIntersection"):
    declare(_distance, alarmDistance=(SCALAR, 1.0, ABOVE_0), contactDistance=(SCALAR, 0.5, FROM_0))
for _model in ("TriangleCollisionModel", "LineCollisionModel", "PointCollisionModel"):
    declare(_model, group=INDICES, selfCollision=BOOL)

declare(
    "SphereCollisionModel",
    radius=(SCALAR, 1.0, ABOVE_0),
    listRadius=(VECTOR, (), ABOVE_0),
    group=INDICES,
    selfCollision=BOOL,
)

# actuators

declare(
    "SurfacePressureConstraint",
    value=(VECTOR, (0.0,)),
    valueIndex=(INTEGER, 0, FROM_0),
    valueType=(TEXT, "pressure"),
    triangles=index_rows(3),
    quads=index_rows(4),
    flipNormal=BOOL,
    minPressure=(SCALAR, 0.0, LIMIT),
    maxPressure=(SCALAR, 0.0, LIMIT),
    minVolumeGrowth=(SCALAR, 0.0, LIMIT),
    maxVolumeGrowth=(SCALAR, 0.0, LIMIT),
    maxPressureVariation=(SCALAR, 0.0, LIMIT_FROM_0),
    maxVolumeGrowthVariation=(SCALAR, 0.0, LIMIT_FROM_0),
    pressure=SCALAR,
    initialCavityVolume=SCALAR,
    cavityVolume=SCALAR,
    volumeGrowth=SCALAR,
)
declare(
    "CableConstraint",
    value=(VECTOR, (0.0,)),
    valueIndex=(INTEGER, 0, FROM_0),
    valueType=(TEXT, "displacement"),
    indices=(INDICES, (0,), FROM_0),
    pullPoint=fixed(3),
    hasPullPoint=(BOOL, True),
    minForce=(SCALAR, 0.0, LIMIT),
    maxForce=(SCALAR, 0.0, LIMIT),
    maxPositiveDisp=(SCALAR, 0.0, LIMIT),
    maxNegativeDisp=(SCALAR, 0.0, LIMIT),
    maxDispVariation=(SCALAR, 0.0, LIMIT_FROM_0),
    cableInitialLength=(SCALAR, 0.0, FROM_0),
    cableLength=SCALAR,
    displacement=SCALAR,
    force=SCALAR,
    eqForce=VECTOR,
    eqDisp=VECTOR,
    method=(TEXT, "point"),
    centers=vectors(3),
    radii=(VECTOR, (1.0,), ABOVE_0),
    surfaceTopology=LINK,
)

# appearance

for _shown in ("OglModel", "VisualModel", "BackgroundSetting"):
    declare(_shown, color=ANY, filename=TEXT, fileMesh=TEXT)
declare("OglSceneFrame", draw=(BOOL, True))
for _camera in ("Camera", "InteractiveCamera"):
    declare(_camera, position=fixed(3), lookAt=fixed(3))
