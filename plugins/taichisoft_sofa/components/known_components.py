"""The components that are known: modules with translations, and types without effect on the motion of a scene."""

from taichisoft_sofa.components import (
    air_and_cables,
    contact,
    dynamics,
    engines,
    force_fields,
    mappings,
    meshes,
    topologies,
    visuals,
)
from taichisoft_sofa.tree.component import TYPES, ComponentType, register

MODULES = (dynamics, meshes, topologies, mappings, engines, force_fields, contact, air_and_cables, visuals)
"""Modules with functions that translate components, see `tree.component.component`."""


def known_types() -> dict[str, ComponentType]:
    """The types that are translated, by their present names."""
    if not TYPES:
        register(*MODULES)
    return TYPES


PLUGINS_AND_SETTINGS = """
    RequiredPlugin AddDataRepository AddPluginRepository AddResourceRepository SofaDefaultPathSetting PluginRepository
    APIVersion InfoComponent MessageHandlerComponent FileMessageHandlerComponent StatsSetting ViewerSetting
    ViewerDimensionSetting MouseButtonSetting AttachBodyButtonSetting FixPickedParticleButtonSetting
    CarvingButtonSetting PauseAnimationOnEvent PythonMainScriptController PythonEnvironment AnimationEditor
"""

PICTURES = """
    DefaultVisualManagerLoop VisualManagerLoop CompositingVisualLoop VisualStyle VisualModelImpl VisualGrid OglGrid
    VisualTransform VisualMesh VisualBoundingBox VisualPointCloud VisualVectorField LineAxis Visual3DText OglLabel
    OglViewport OglShader OglShadowShader OglColorMap OglTexture OglTexture2D OglCylinderModel PostProcessManager
    SlicedVolumetricModel TrailRenderer ClipPlane DataDisplay MergeVisualModels LightManager DirectionalLight SpotLight
    PositionalLight RecordedCamera VisualManagerPass VisualManagerSecondaryPass
"""

RECORDS = """
    Monitor ExtraMonitor MechanicalStateMonitor EvalPointsDistance EvalSurfaceDistance CompareState CompareTopology
    VTKExporter STLExporter OBJExporter MeshExporter GIDMeshExporter PlyExporter BlenderExporter
    VisualModelOBJExporter WriteState WriteTopology
"""

CELLS = ("Tetrahedron", "Hexahedron", "Triangle", "Quad", "Edge", "Point")
PARTS = ("TopologyModifier", "TopologyAlgorithms", "GeometryAlgorithms")
MODIFIERS = " ".join(f"{cell}Set{part}" for cell in CELLS for part in PARTS)
# Meshes never change here.

EQUATIONS = """
    MechanicalMatrixMapper MappedMatrixForceFieldAndMass MatrixLinearSystem ConstantSparsityPatternSystem
    TypedMatrixLinearSystem AssemblingMatrixSystem CompositeLinearSystem MatrixFreeSystem RotationMatrixSystem
    PrecomputedMatrixSystem BlockJacobiPreconditioner JacobiPreconditioner SSORPreconditioner WarpPreconditioner
    RotationFinder PrecomputedWarpPreconditioner IncompleteCholeskyPreconditioner DefaultCollisionGroupManager
    CollisionGroup NewtonRaphsonSolver
"""
# The equations are solved directly and together.

MEASURES = "VolumeFromTriangles VolumeFromTetrahedrons"

DEVICES = "SerialPortBridgeGeneric CommunicationController ServerCommunicationOSC ServerCommunicationZMQ"

IGNORED = set(" ".join((PLUGINS_AND_SETTINGS, PICTURES, RECORDS, MODIFIERS, EQUATIONS, MEASURES, DEVICES)).split())
"""Types without effect on the motion of a scene."""
BEGINNINGS, ENDINGS = ("Ogl",), ("Exporter", "Monitor", "Light", "Shader")
"""Beginnings and ends of the names of other such types."""

EXPORT = "writes nothing here; `taichisoft recording export` writes the frames of a recording"


def is_without_effect(type_name: str) -> bool:
    """Whether a type without translation concerns pictures, records, settings or devices alone."""
    return type_name in IGNORED or type_name.startswith(BEGINNINGS) or type_name.endswith(ENDINGS)


def instead_of(type_name: str) -> str | None:
    """What a type does not do here, if its scene is used for that; else None."""
    if type_name in DEVICES.split():
        return "exchanges nothing here with a device or program"
    return EXPORT if type_name.endswith("Exporter") or type_name.startswith("Write") else None
