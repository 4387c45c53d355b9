"""Data of SOFA's components that are not read.

Data that affect the motion of bodies in SOFA are reported if a scene changes their default. Other data concern drawing
or the solution of equations, and are not reported.
"""

from typing import Any

from taichisoft_sofa.components import declarations as declarations  # data that are read are declared first
from taichisoft_sofa.tree.value_kinds import declare_unused, declare_without_effect

LOOPS = ("FreeMotionAnimationLoop", "DefaultAnimationLoop")
DIRECT_SOLVERS = (
    *("SparseLDLSolver", "AsyncSparseLDLSolver", "SparseCholeskySolver", "SparseLUSolver", "EigenSimplicialLDLT"),
    *("EigenSimplicialLLT", "EigenSparseLU", "EigenSparseQR", "BTDLinearSolver", "PrecomputedLinearSolver"),
    "CholeskySolver",
)
ITERATIVE_SOLVERS = (
    *("CGLinearSolver", "CGLinearSolver2", "ParallelCGLinearSolver", "MinResLinearSolver", "PCGLinearSolver"),
    "ShewchukPCGLinearSolver",
)
CORRECTIONS = (
    *("LinearSolverConstraintCorrection", "GenericConstraintCorrection", "UncoupledConstraintCorrection"),
    "PrecomputedConstraintCorrection",
)
CONSTRAINT_SOLVERS = (
    *("BlockGaussSeidelConstraintSolver", "ProjectedGaussSeidelConstraintSolver"),
    *("UnbuiltGaussSeidelConstraintSolver", "NNCGConstraintSolver", "ImprovedJacobiConstraintSolver"),
    "LCPConstraintSolver",
)
LOADERS = ("MeshVTKLoader", "MeshSTLLoader", "MeshOBJLoader", "MeshGmshLoader", "GIDMeshLoader")
CONTAINERS = (
    "HexahedronSetTopologyContainer",
    *("MeshTopology", "TetrahedronSetTopologyContainer", "TriangleSetTopologyContainer", "QuadSetTopologyContainer"),
    *("EdgeSetTopologyContainer", "PointSetTopologyContainer"),
)
MAPPINGS = (
    *("BarycentricMapping", "RigidMapping", "IdentityMapping", "SubsetMultiMapping", "SkinningMapping"),
    "SubsetMapping",
    "ArticulatedSystemMapping",
)
TOPOLOGICAL = (
    *("Tetra2TriangleTopologicalMapping", "Hexa2TetraTopologicalMapping", "Hexa2QuadTopologicalMapping"),
    "Quad2TriangleTopologicalMapping",
)
ROIS = ("BoxROI", "SphereROI")
MASSES = ("UniformMass", "MeshMatrixMass", "DiagonalMass")
TETRAHEDRA = (
    *("TetrahedronFEMForceField", "FastTetrahedralCorotationalForceField", "TetrahedralCorotationalFEMForceField"),
    "TetrahedronHyperelasticityFEMForceField",
)
FIXED = ("FixedProjectiveConstraint", "PartialFixedProjectiveConstraint")
PHASES = (
    *("BruteForceBroadPhase", "BruteForceDetection", "IncrSAP", "DirectSAP", "ParallelBruteForceBroadPhase"),
    *("BVHNarrowPhase", "ParallelBVHNarrowPhase"),
)
DISTANCES = ("LocalMinDistance", "MinProximityIntersection", "NewProximityIntersection", "DiscreteIntersection")
MODELS = ("TriangleCollisionModel", "LineCollisionModel", "PointCollisionModel", "SphereCollisionModel")
VISUALS = ("OglModel", "VisualModel")
CAMERAS = ("Camera", "InteractiveCamera")

UNUSED: dict[tuple[str, ...], dict[str, Any]] = {
    ("FreeMotionAnimationLoop",): {"solveVelocityConstraintFirst": False},
    ("EulerImplicitSolver",): {"vdamping": 0.0, "solveConstraint": False},
    (*CORRECTIONS, *CONSTRAINT_SOLVERS): {"regularizationTerm": 0.0},
    ("UncoupledConstraintCorrection",): {"compliance": (), "defaultCompliance": 1e-5},
    ("LCPConstraintSolver",): {"mu": 0.6},
    LOADERS: {"transformation": "", "flipNormals": False},
    MAPPINGS: {"mapConstraints": True},
    ("ArticulationCenter",): {"articulationProcess": 0},
    TOPOLOGICAL: {"flipNormals": False},
    MASSES: {"rayleighMass": 0.0},
    ("UniformMass",): {"compliance": 0.0, "handleTopologicalChanges": False},
    (*TETRAHEDRA, "RestShapeSpringsForceField"): {"rayleighStiffness": 0.0, "isCompliance": False},
    ("TetrahedronFEMForceField",): {
        **{"localStiffnessFactor": (), "plasticMaxThreshold": 0.0, "plasticYieldThreshold": 0.0001},
        **{"plasticCreep": 0.9},
    },
    ("TetrahedronHyperelasticityFEMForceField",): {"AnisotropyDirections": ()},
    ("RestShapeSpringsForceField",): {"activeDirections": (), "mstate": ""},
    ("PlaneForceField",): {"indices": (), "localRange": ()},
    ("PartialFixedProjectiveConstraint",): {"projectVelocity": False},
    ("FixedProjectiveConstraint",): {"activate_projectVelocity": False},
    ("RuleBasedContactManager",): {"rules": "", "variables": ""},
    MODELS: {
        **{"active": True, "proximity": 0.0, "contactDistance": 0.0, "contactStiffness": 10.0, "contactFriction": 0.0},
        **{"contactRestitution": 0.0, "contactResponse": ""},
    },
}
"""Data that affect the motion of bodies in SOFA, with SOFA's defaults."""

WITHOUT_EFFECT: dict[tuple[str, ...], str] = {
    LOOPS: """
        parallelODESolving parallelCollisionDetectionAndFreeMotion computeBoundingBox threadSafeVisitor
    """,
    ("StaticSolver",): """
        absolute_correction_tolerance_threshold relative_correction_tolerance_threshold newtonSolver
        absolute_residual_tolerance_threshold relative_residual_tolerance_threshold
        should_diverge_when_residual_is_growing
    """,
    ("EulerImplicitSolver",): """
        linearSolver computeResidual residual parallelInverseProduct
    """,
    DIRECT_SOLVERS: """
        iterations maxIterations verbose tolerance threshold savingMatrixToFile savingMatrixFilename savingPrecision
        saveMatrixToFile savingFolder parallelInverseProduct useMultiInterations ordering permutation useFilter
        filterTolerance invName share_matrix jmjt_twostep use_file init_MaxIter init_Tolerance init_Threshold
        showBlocs problem subpartSolve blockSize linearSystem useSymbolicDecomposition
        precomputeSymbolicDecomposition applyPermutation L_nnz sharedMatrix
    """,
    ITERATIVE_SOLVERS: """
        iterations maxIterations tolerance threshold warmStart verbose graph precond preconditioners preconditioner
        update_step build_precond use_precond linearSystem parallelInverseProduct
    """,
    CORRECTIONS: """
        solverName linearSolver ODESolverName wire_optimization complianceFactor rotations restRotations recompute
        debugViewFrameScale fileCompliance fileDir f_fileCompliance correctionVelocityFactor
        correctionPositionFactor useOdeSolverIntegrationFactors complianceMatrix
    """,
    CONSTRAINT_SOLVERS: """
        tolerance maxIterations maxIt tol sor scaleTolerance allVerified resolutionMethod unbuilt schemeCorrection
        multithreading reverseAccumulateOrder computeGraphs graphErrors graphConstraints graphForces graphViolations
        currentNumConstraints currentNumConstraintGroups currentIterations currentError computeConstraintForces
        newtonIterations convergence_iterations initial_guess build_lcp multi_grid
        multi_grid_levels merge_method merge_spatial_step merge_local_levels displayTime displayDebug numIterations
        showGraphs showLevels showCells showTranslation showLevelTranslation displayedGroup graph initialGuess rho
        spectralRadius
    """,
    LOADERS: """
        triangulate createSubelements onlyAttachedPoints loadMaterial storeGroups handleSeams removeDuplicatePoints
        mergePositionUsingMap headerSize forceBinary fillMesh convertPolygonToTriangle computeNormals position
        polylines edges triangles quads polygons highOrderEdgePositions highOrderTrianglePositions
        highOrderQuadPositions tetrahedra hexahedra tetras hexas pentahedra prisms pyramids edgesGroups
        trianglesGroups quadsGroups polygonsGroups tetrahedraGroups hexahedraGroups pyramidsGroups pointsGroups
        normals texcoords uv positionsDefinition normalsDefinition texcoordsDefinition material faceList
        texIndexList materials listening elements fileFormatVersion
    """,
    CONTAINERS: """
        edges triangles quads tetrahedra tetras hexahedra hexas position points seqPoints polylines lines pyramids
        pentahedra prisms polygons uv texcoords createTriangleArray checkConnexity checkConnectivity checkTopology
        drawPoints drawEdges drawTriangles drawQuads drawTetrahedra drawHexahedra computeAllBuffers nbEdges fileMesh
        scale translation rotation dx dy dz rx ry rz sx sy sz useFullEdges numberOfTriangles
    """,
    MAPPINGS: """
        mapForces mapMasses mapMatrices applyRestPosition useRestPosition isMechanical mapGeometricStiffness
        initialPoints geometricStiffness useX0 indexFromEnd repartition pointMap mapper inputTopology outputTopology
        parallelMapping handleTopologyChange ignoreNotFound resizeToModel object1 object2 pointsPerFrame displayWeights
    """,
    ("ArticulationCenter",): """
        globalPosition articulations
    """,
    ("RegularGridTopology",): """
        computeHexaList computeQuadList computeTriangleList computeEdgeList computePointList createTexCoords
        drawEdges drawTriangles drawQuads drawTetrahedra drawHexahedra uv filename points
    """,
    TOPOLOGICAL: """
        noNewTriangles noInitialTriangles object1 object2 noInitialTriangles noNewQuads
    """,
    ("MechanicalObject",): """
        showObjectScale showIndices showIndicesScale showVectors showVectorsScale showColor drawMode derivX dforce
        freePosition restPosition reset_velocity useTopology restScale reserve separate forceMask isToPrint
        ignoreLoader debugViewIndices debugViewIndicesScale initialPosition fileTopology
    """,
    ROIS: """
        drawBoxes drawPoints drawEdges drawTriangles drawTetrahedra drawHexahedra drawQuads drawSize drawROI
        drawSphere computeEdges computeTriangles computeTetrahedra computeHexahedra computeQuads computePoints
        mechanicalObject rest_position quadInROI pointsOutROI edgesOutROI trianglesOutROI tetrahedraOutROI
        hexahedraOutROI indicesOut trianglesOutIndices normal edgeAngle triAngle isVisible topology
        computeTrianglesInROI computeTemporaryTriangles
    """,
    MASSES: """
        separateGravity printMass showGravityCenter showAxisSizeFactor showInitialCenterOfGravity showX0 localRange
        preserveTotalMass filename computeMassOnRest useIndexedMass vertexMass edgeMass fileMass
        massInitializationMethod indices mstate graph topology showInitialMesh
    """,
    TETRAHEDRA: """
        computeGlobalMatrix updateStiffnessMatrix assembling initialPoints drawing drawAsEdges
        drawHeterogeneousTetra drawColor1 drawColor2 drawColor3 drawColor4 computeVonMisesStress vonMisesPerElement
        vonMisesPerNode vonMisesStressColors showStressColorMap showStressAlpha showVonMisesStressPerNode
        showVonMisesStressPerNodeColorMap showVonMisesStressPerElement showElementGapScale gatherPt gatherBsize
        exportEdges numMaxInvertIters updateStiffness matrixRegularization stiffnessMatrixRegularizationWeight
        indices filename listening edgeInfo tetraInfo topology initialPosition mstate
    """,
    ("RestShapeSpringsForceField",): """
        angularStiffness drawSpring springColor recompute_indices topology
    """,
    ("StiffSpringForceField", "SpringForceField", "MeshSpringForceField"): """
        showArrowSize drawMode drawMinElongationRange drawMaxElongationRange drawSpringSize template showFactorSize
    """,
    ("PlaneForceField",): """
        showPlane showPlaneSize planeColor color drawSize drawIsEnabled template damping maxForce
    """,
    ("ConstantForceField",): """
        arrowSizeCoef showArrowSize showColor indexFromEnd topology
    """,
    ("LinearMovementProjectiveConstraint",): """
        showMovement topology
    """,
    FIXED: """
        drawSize showObject topology
    """,
    ("CollisionPipeline",): """
        verbose draw depth doPrintInfoMessage broadPhaseDetection narrowPhaseDetection
    """,
    PHASES: """
        draw box bothSide threshold mode nbPairs maxDepth nbThreads
    """,
    ("RuleBasedContactManager",): """
        variables
    """,
    DISTANCES: """
        angleCone coneFactor useLMDFilters filterIntersection usePointPoint useSurfaceNormals useLineLine
        useLinePoint usePointsPoint useEdgePoint draw useSphereTriangle usePointEdge useTriangleLine
    """,
    MODELS: """
        moving simulated bothSide color numberOfPoints numberOfLines numberOfTriangles useCurvature computeNormals
        displayAsNormals enableDirectPaint topology template LineActiverPath PointActiverPath TriangleActiverPath
        useBoundaryEdges ignoreCollision displayNormals showImpostors
    """,
    ("SurfacePressureConstraint",): """
        drawPressure drawScale visualization showVisuScale showObject color topology constraintIndex visualize
    """,
    ("CableConstraint",): """
        color drawPullPoint drawPoints drawPulledAreas constraintIndex topology
    """,
    VISUALS: """
        filename fileMesh material texturename texcoords useVBO updateNormals computeTangents handleDynamicTopology
        fixMergedUVSeams keepLines rotation translation scale scale3d position rest_position restPositions edges
        triangles quads vertices normals computeNormals putOnlyTexCoords opacity cullFace blendEquation
        blendTransparency sfactor dfactor writeZTransparent alphaBlend depthTest lineSmooth lineWidth pointSize
        pointSmooth isEnabled forceFloatColors primitiveType tex3d wire castShadow srgbTexturing materials groups
        useNormals scaleTex translationTex hasTransparency transformation isToPrint visible rx ry rz dx dy dz sx sy
        sz vertPosIdx vertNormIdx xforms displacementVertexShader
    """,
    ("BackgroundSetting",): """
        image
    """,
    ("OglSceneFrame",): """
        style alignment viewportSize
    """,
    CAMERAS: """
        orientation distance fieldOfView projectionType zNear zFar computeZClip minBBox maxBBox widthViewport
        heightViewport activated fixedLookAt modelViewMatrix projectionMatrix zoomSpeed panSpeed pivot stereoEnabled
        stereoMode stereoStrategy stereoShift filename
    """,
}
"""Data without effect on the motion of bodies, by type."""


for _types, _data in UNUSED.items():
    for _type in _types:
        declare_unused(_type, **_data)
for _types, _names in WITHOUT_EFFECT.items():
    for _type in _types:
        declare_without_effect(_type, _names)
