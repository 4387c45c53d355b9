"""Kinds of the data that controllers read and write: text becomes numbers, and the older generation gets rows.

Data of types that are not here keep what the scene wrote.
"""

from taichisoft_sofa.components import older_names as older_names  # declared under the present names
from taichisoft_sofa.components.states import is_rigid
from taichisoft_sofa.tree.component import Component
from taichisoft_sofa.tree.kinds import (
    BOOL,
    INDICES,
    INTEGER,
    LINK,
    SCALAR,
    TEXT,
    VECTOR,
    Kind,
    declare,
    fixed,
    index_rows,
    vectors,
)


def _coordinates(state: Component) -> Kind:
    return vectors(7 if is_rigid(state) else 3)


def _derivatives(state: Component) -> Kind:
    return vectors(6 if is_rigid(state) else 3)


declare(
    "MechanicalObject",
    velocity=_derivatives,
    force=_derivatives,
    externalForce=_derivatives,
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
    showObjectScale=(SCALAR, 0.1),
    showIndices=BOOL,
    showIndicesScale=(SCALAR, 0.02),
    showVectors=BOOL,
    showColor=VECTOR,
    drawMode=INTEGER,
    topology=LINK,
    filename=TEXT,
)
for _loader in ("MeshVTKLoader", "MeshSTLLoader", "MeshOBJLoader", "MeshGmshLoader"):
    declare(
        _loader,
        filename=TEXT,
        scale=(SCALAR, 1.0),
        scale3d=(fixed(3), (1.0, 1.0, 1.0)),
        rotation=fixed(3),
        translation=fixed(3),
        triangulate=BOOL,
    )
for _container in (
    "MeshTopology",
    "TetrahedronSetTopologyContainer",
    "TriangleSetTopologyContainer",
    "QuadSetTopologyContainer",
    "EdgeSetTopologyContainer",
    "PointSetTopologyContainer",
):
    declare(_container, filename=TEXT, fileTopology=TEXT, createTriangleArray=BOOL, nbPoints=INTEGER)
declare(
    "BoxROI",
    box=vectors(6),
    orientedBox=vectors(10),
    position=vectors(3),
    strict=(BOOL, True),
    doUpdate=(BOOL, True),
    drawBoxes=BOOL,
    drawPoints=BOOL,
    drawTetrahedra=BOOL,
    drawTriangles=BOOL,
    drawEdges=BOOL,
    drawSize=SCALAR,
    edges=index_rows(2),
    triangles=index_rows(3),
    quads=index_rows(4),
    tetrahedra=index_rows(4),
    hexahedra=index_rows(8),
    computeTriangles=(BOOL, True),
    computeTetrahedra=(BOOL, True),
    computeEdges=(BOOL, True),
    mechanicalObject=LINK,
)
declare(
    "SphereROI",
    centers=vectors(3),
    radii=VECTOR,
    position=vectors(3),
    strict=(BOOL, True),
    doUpdate=(BOOL, True),
    drawSphere=BOOL,
    drawPoints=BOOL,
    triangles=index_rows(3),
    tetrahedra=index_rows(4),
)
declare(
    "SurfacePressureConstraint",
    value=(VECTOR, (0.0,)),
    valueIndex=INTEGER,
    valueType=(TEXT, "pressure"),
    triangles=index_rows(3),
    quads=index_rows(4),
    flipNormal=BOOL,
    minPressure=SCALAR,
    maxPressure=SCALAR,
    minVolumeGrowth=SCALAR,
    maxVolumeGrowth=SCALAR,
    maxPressureVariation=SCALAR,
    maxVolumeGrowthVariation=SCALAR,
    pressure=SCALAR,
    initialCavityVolume=SCALAR,
    cavityVolume=SCALAR,
    volumeGrowth=SCALAR,
    drawPressure=BOOL,
    drawScale=SCALAR,
    visualization=BOOL,
    showVisuScale=SCALAR,
)
declare(
    "CableConstraint",
    value=(VECTOR, (0.0,)),
    valueIndex=INTEGER,
    valueType=(TEXT, "displacement"),
    indices=INDICES,
    pullPoint=fixed(3),
    hasPullPoint=(BOOL, True),
    minForce=SCALAR,
    maxForce=SCALAR,
    maxPositiveDisp=SCALAR,
    maxNegativeDisp=SCALAR,
    maxDispVariation=SCALAR,
    cableInitialLength=SCALAR,
    cableLength=SCALAR,
    displacement=SCALAR,
    force=SCALAR,
    eqForce=VECTOR,
    eqDisp=VECTOR,
    method=(TEXT, "point"),
    centers=vectors(3),
    radii=VECTOR,
    surfaceTopology=LINK,
    color=VECTOR,
    drawPullPoint=BOOL,
    drawPoints=BOOL,
    drawPulledAreas=BOOL,
)
declare(
    "EulerImplicitSolver",
    rayleighStiffness=SCALAR,
    rayleighMass=SCALAR,
    vdamping=SCALAR,
    firstOrder=BOOL,
    trapezoidalScheme=BOOL,
    solveConstraint=BOOL,
    linearSolver=LINK,
)
