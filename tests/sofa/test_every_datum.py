"""Every datum of every known component changes the result, is listed as having no effect, or is refused.

The data are those that the components declare, and each gets a value other than its default: a new component is tested
as soon as it is declared, and needs an entry in CASES only if it does nothing in the node of a soft body.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest
from blocks import make_block
from scenes_of_sofa import BODY, Run, loaded

from taichisoft import write_volume_mesh
from taichisoft.errors import SceneError, TaichisoftError
from taichisoft.mesh import boundary_triangles, write_stl
from taichisoft_sofa.components.known_components import known_types
from taichisoft_sofa.translation.translate import translate
from taichisoft_sofa.tree.component import Component
from taichisoft_sofa.tree.data import Data

BEFORE = (
    BODY
    + """
def put(node, former, kind, **data):
    if former:
        node.removeObject(node.getObject(former))
    return node.addObject(kind, **data)

def child(node, **data):
    below = node.addChild("child")
    below.addObject("MechanicalObject", name="dofs", **{"position": [[2, 2, 2], [9, 3, 4]], **data})
    return below

def rigid(root, **data):
    node = root.addChild("ball")
    node.addObject("EulerImplicitSolver")
    node.addObject("CGLinearSolver", name="solver")
    node.addObject("MechanicalObject", name="dofs", template="Rigid3", **{"position": [0, 0, 0, 0, 0, 0, 1], **data})
    node.addObject("UniformMass", totalMass=1e-3)
    node.addObject("UncoupledConstraintCorrection")
    return node

def grid(root, kind="RegularGridTopology", **data):
    node = root.addChild("body")
    node.addObject("EulerImplicitSolver")
    node.addObject("SparseLDLSolver")
    node.addObject(kind, name="grid", **data)
    node.addObject("MechanicalObject", name="dofs")
    node.addObject("UniformMass", totalMass=0.05)
    node.addObject("HexahedronFEMForceField", youngModulus=500)
    return node

def arm(root, of, **data):
    def given(kind, **usual):
        return {**usual, **(data if kind == of else {})}
    angles = root.addChild("angles")
    angles.addObject("EulerImplicitSolver")
    angles.addObject("MechanicalObject", name="dofs", template="Vec1", position=[0.3, 0.2])
    angles.addObject("RestShapeSpringsForceField", stiffness=1e5)
    angles.addObject("UniformMass", totalMass=0.1)
    angles.addObject("ArticulatedHierarchyContainer", **given("ArticulatedHierarchyContainer"))
    centre = angles.addChild("centre")
    centre.addObject("ArticulationCenter", **given("ArticulationCenter", parentIndex=0, childIndex=1))
    joint = {"rotation": True, "rotationAxis": [0, 0, 1], "articulationIndex": 0}
    centre.addChild("joint").addObject("Articulation", **given("Articulation", **joint))
    base = root.addChild("base")
    two = [[0, 0, 0, 0, 0, 0, 1], [5, 0, 0, 0, 0, 0, 1]]
    base.addObject("MechanicalObject", name="dofs", template="Rigid3", position=two)
    frames = angles.addChild("frames")
    frames.addObject("MechanicalObject", name="dofs", template="Rigid3", position=[[0, 0, 0, 0, 0, 0, 1]] * 3)
    links = {"input1": "@../dofs", "input2": "@/base/dofs", "output": "@dofs"}
    frames.addObject("ArticulatedSystemMapping", **given("ArticulatedSystemMapping", **links))
    shown = frames.addChild("shown")
    shown.addObject("MeshSTLLoader", name="loader", filename="block.stl")
    shown.addObject("OglModel", src="@loader")
    shown.addObject("RigidMapping", index=1)
"""
)
SHOWN = 'root.addChild("shown").addObject({put})'
BLOCK = make_block((1, 1, 1), (20.0, 10.0, 10.0))
CORNERS, SKIN = BLOCK.nodes.tolist(), boundary_triangles(BLOCK.elements).tolist()


@dataclass(frozen=True)
class Case:
    """The smallest scene with a component, its usual data, and values for data whose kind says too little."""

    scene: str = "node = body(root)\nnode.addObject({put})"
    usual: Mapping[str, Any] = field(default_factory=dict)
    values: Mapping[str, Any] = field(default_factory=dict)


def of_mass(**values: Any) -> Case:
    return Case('put(body(root), "UniformMass", {put})', values=values)


def of_contact(former: str, usual: Mapping[str, Any] = MappingProxyType({}), **values: Any) -> Case:
    scene = 'collisions(root)\nput(root, "{}", {{put}})\nsurface(body(root), "block.stl")'
    return Case(scene.format(former), usual, values)


def of_springs(**usual: Any) -> Case:
    return Case(
        Case.scene + "\nrigid(root)", usual, {"object1": "@/ball/dofs", "object2": "@/ball/dofs", "topology": "@/no"}
    )


def of_arm() -> Case:
    return Case("arm(root, {put})", values={"indexInput2": 0, "articulationIndex": 1, "rotationAxis": [1, 0, 0]})


IMPOSED = {"index": 1, "value": [0.2, 0.5], "valueType": "force", "valueIndex": 1}


LOADED = 'node = root.addChild("node")\nnode.addObject({put})\nnode.addObject("OglModel", src="@[-1]")'
CONTAINERS = {
    name: Case(LOADED, {"position": CORNERS})
    for name in (
        "MeshTopology",
        *(f"{cell}SetTopologyContainer" for cell in ("Tetrahedron", "Triangle", "Quad", "Hexahedron", "Edge", "Point")),
    )
}
COLLIDING = Case(
    'collisions(root)\ninner = surface(body(root), "block.stl")\n'
    'for cell in ("Triangle", "Line", "Point"):\n    inner.removeObject(inner.getObject(cell + "CollisionModel"))\n'
    "inner.addObject({put})",
    values={"listRadius": [1.5] * 12, "group": [3]},
)
SOFTENING = """
import Sofa
class Soften(Sofa.Core.Controller):
    def onAnimateBeginEvent(self, event):
        self.field.youngModulus = 100.0
field = put(body(root), "TetrahedronFEMForceField", {put})
root.addObject(Soften()).field = field
"""
CAVITY = 'free_motion(root)\nnode = surface(body(root), "block.stl")\nnode.addObject({put})'
CASES: dict[str, Case] = {
    **dict.fromkeys(("EulerImplicitSolver", "StaticSolver"), Case('put(body(root), "EulerImplicitSolver", {put})')),
    "CGLinearSolver": Case('put(rigid(root), "solver", {put})', values={"threshold": 1e-13}),
    **dict.fromkeys(("UniformMass", "DiagonalMass", "MeshMatrixMass"), of_mass(localRange=[0, 3], totalMass=0.3)),
    "RestShapeSpringsForceField": Case(
        usual={"points": [0, 2], "stiffness": [5.0]},
        values={"points": [3], "external_rest_shape": "@/nowhere"},
    ),
    "RestShapeSpringsForceField.angularStiffness": Case("rigid(root).addObject({put})", {"stiffness": [5.0]}),
    "RestShapeSpringsForceField.external_points": Case(
        'child(root.addChild("goal"))\nbody(root).addObject({put})',
        {"points": [3], "external_rest_shape": "@/goal/child/dofs", "external_points": [0]},
    ),
    "ConstantForceField": Case(usual={"indices": [0], "force": [1, 2, 3]}, values={"indices": [3]}),
    "LinearMovementProjectiveConstraint": Case(
        usual={"indices": [1], "keyTimes": [0, 1], "movements": [[0, 0, 0], [1, 0, 0]]}, values={"indices": [3]}
    ),
    "PartialLinearMovementProjectiveConstraint": Case(
        usual={"indices": [1], "keyTimes": [0, 1], "movements": [[0, 0, 0], [1, 1, 1]]},
        values={"indices": [3], "movedDirections": [1, 0, 1]},
    ),
    "PositionConstraint": Case(
        usual={"value": [1.0, 3.0]},
        values=IMPOSED | {"useDirections": [0, 1, 0], "directions": [[1, 0, 0], [0, 0, 1], [0, 1, 0]]},
    ),
    "JointConstraint": Case('arm(root, "")\nroot.getChild("angles").addObject({put})', {"value": [0.1, 0.3]}, IMPOSED),
    **dict.fromkeys(
        ("FixedProjectiveConstraint", "PartialFixedProjectiveConstraint"),
        Case(values={"fixedDirections": [1, 0, 1], "indices": [3]}),
    ),
    **dict.fromkeys(
        ("StiffSpringForceField", "SpringForceField"),
        of_springs(indices1=[0], indices2=[3], lengths=[8.0], damping=[0.0]),
    ),
    "MeshSpringForceField": of_springs(),
    **dict.fromkeys(
        (f"MeshSpringForceField.{cells}{of}" for cells in ("quads", "cubes") for of in ("Stiffness", "Damping")),
        Case("grid(root).addObject({put})"),
    ),
    **dict.fromkeys(
        (f"MeshSpringForceField.{name}" for name in ("topology", "object1", "object2", "noCompression", "localRange")),
        of_springs(tetrahedraStiffness=20.0),
    ),
    **dict.fromkeys(
        ("HexahedronFEMForceField", "ParallelHexahedronFEMForceField"),
        Case('put(grid(root), "HexahedronFEMForceField", {put})', values={"topology": "@/no"}),
    ),
    "TetrahedronHyperelasticityFEMForceField": Case(
        'put(body(root), "TetrahedronFEMForceField", {put})',
        {"materialName": "NeoHookean", "ParameterSet": [200.0, 300.0]},
        {"materialName": "StVenantKirchhoff", "topology": "@/no"},
    ),
    **{
        f"{kind}.updateStiffness": Case(SOFTENING)
        for kind in (
            "TetrahedronFEMForceField",
            "FastTetrahedralCorotationalForceField",
            "TetrahedralCorotationalFEMForceField",
        )
    },
    **{
        kind: Case(LOADED, {"filename": file}, {name: other for name in ("fileMesh", "fileTopology", "filename")})
        for kind, file, other in (
            ("MeshVTKLoader", "block.vtk", "other.vtk"),
            ("MeshSTLLoader", "block.stl", "other.stl"),
            ("MeshOBJLoader", "block.obj", "other.obj"),
            ("MeshGmshLoader", "block.msh", "other.msh"),
            ("GIDMeshLoader", "block.gid", "other.gid"),
        )
    },
    **CONTAINERS,
    "ComplementaryROI": Case(usual={"position": CORNERS, "nbSet": 1, "setIndices1": [0]}, values={"nbSet": 25}),
    "GenerateRigidMass": Case(usual={"position": CORNERS, "triangles": SKIN}, values={"quads": [[0, 1, 3, 2]]}),
    "SphereLoader": Case(usual={"filename": "block.sph"}, values={"filename": "other.sph"}),
    "RegularGridTopology": Case("grid(root, {put})"),
    "SparseGridTopology": Case(
        "grid(root, {put})",
        {"n": [3, 3, 3], "fileTopology": "block.stl"},
        {"cellWidth": 4.0, "min": [-11, -6, -6], "max": [11, 6, 6]},
    ),
    "MechanicalObject": Case('put(body(root), "dofs", {put})', values={"position": (1.1 * np.array(CORNERS)).tolist()}),
    "MechanicalObject.showObject": Case('put(rigid(root), "dofs", {put})', {"template": "Rigid3"}),
    "MechanicalObject.position": Case('put(rigid(root), "dofs", {put})', {"template": "Rigid3"}),
    **dict.fromkeys(
        ("Articulation", "ArticulationCenter", "ArticulatedHierarchyContainer", "ArticulatedSystemMapping"), of_arm()
    ),
    **dict.fromkeys(
        ("BarycentricMapping", "IdentityMapping", "SubsetMapping", "SkinningMapping"),
        Case("child(body(root)).addObject({put})"),
    ),
    **dict.fromkeys(
        ("TriangleCollisionModel", "LineCollisionModel", "PointCollisionModel", "SphereCollisionModel"), COLLIDING
    ),
    "SurfacePressureConstraint": Case(CAVITY, {"value": [0.3]}),
    "SurfacePressureConstraint.maxVolumeGrowthVariation": Case(CAVITY, {"value": [9.0], "valueType": "volumeGrowth"}),
    "CableConstraint": Case(CAVITY, {"indices": [0, 3], "pullPoint": [-5, 1, 1], "value": [1.0]}),
    "RuleBasedContactManager": of_contact(
        "CollisionResponse", {"response": "FrictionContactConstraint"}, responseParams="mu=0.9"
    ),
    "RuleBasedContactManager.default": of_contact("CollisionResponse"),
    "BoxROI": Case(values={"box": [-1, -1, -1, 5, 20, 20], "orientedBox": [0, 0, 0, 0, 10, 0, 20, 10, 0, 20]}),
    "SphereROI": Case(
        usual={"centers": [[0, 0, 0]], "radii": [1.0]}, values={"radii": [15.0], "centers": [[10, 5, 5]]}
    ),
    **dict.fromkeys(
        ("LocalMinDistance", "MinProximityIntersection", "NewProximityIntersection", "DiscreteIntersection"),
        of_contact("LocalMinDistance"),
    ),
    **dict.fromkeys(("OglModel", "VisualModel"), Case(SHOWN, {"filename": "block.stl"})),
    **dict.fromkeys(
        ("OglModel.color", "VisualModel.color"), Case("body(root).addObject({put})", values={"color": "red"})
    ),
    "OglSceneFrame": Case(SHOWN),
    "BackgroundSetting": Case(SHOWN, values={"color": "red"}),
    **dict.fromkeys(("Camera", "InteractiveCamera"), Case(SHOWN, {"position": [1, 2, 3]})),
}


USUAL = Case()


def case_of(kind: str, name: str) -> Case:
    return CASES.get(f"{kind}.{name}", CASES.get(kind, USUAL))


def another(data: Data) -> Any:
    """A valid value of the datum's kind that is not its default."""
    known = data.owner.declared_data(data.name)
    assert known is not None
    default, kind = data.given(), data.kind
    for factor, more in ((1.3, 0.2), (0.5, 0.1), (0.0, 0.3)):
        if kind.name == "true or false":
            return not default
        if kind.name == "an integer":
            value: Any = int(default) + 1
        elif kind.name == "a number":
            value = float(default) * factor + more
        elif kind.name == "indices":
            value = [1]
        elif kind.row:
            start = np.ravel(default) if np.size(default) else np.zeros(kind.row)
            value = start * factor + more * (1 + np.arange(start.size))
            value = np.round(value + 1) if "indices" in kind.name else value
            value = value.tolist()
        else:
            return "@/nowhere" if kind.name == "a link" else "other"
        if known.bounds is None or not known.bounds.problem(value):
            return value
    raise AssertionError(f"no other value of {data.described()}")


def outcome(folder: Path, case: Case, kind: str, data: Mapping[str, Any]) -> tuple[Any, Component | None]:
    """All that a scene leads to, and the component in it."""
    text = case.scene.format(put=f'"{kind}", **{dict(data)!r}')
    try:
        tree = loaded(folder, text, BEFORE)
        subject = [item for item in tree.components() if item.type_name == kind][-1]
        made = translate(tree)
        own = [
            str(subject.findData(name).read_value())
            for name, known in known_types()[kind].data.items()
            if known.compute
        ]
    except SceneError as error:
        return str(error), None
    joints = [(joint.mass, joint.stiffness().tolist(), joint.rest().tolist()) for joint in made.joints]
    listed = (made.refused, made.departures, made.not_read, made.springs, made.signs.values(), joints)
    return (made.tables, made.files.fingerprint(), own, *map(str, listed)), subject


def run(folder: Path, case: Case, kind: str, data: Mapping[str, Any]) -> Any:
    """Where the points of a scene are after some steps."""
    text = case.scene.format(put=f'"{kind}", **{dict(data)!r}').replace("\n", "\n    ")
    try:
        return Run(folder, BEFORE.removeprefix(BODY) + f"\ndef createScene(root):\n    {text}\n").steps(3).tobytes()
    except TaichisoftError as error:
        return str(error)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("scenes")
    for name, size in (("block", (20.0, 10.0, 10.0)), ("other", (20.0, 10.0, 12.0))):
        block = make_block((2, 1, 1), size)
        for suffix in (".vtk", ".msh"):
            write_volume_mesh(block, folder / f"{name}{suffix}")
        skin = boundary_triangles(block.elements)
        write_stl(block.nodes, skin, folder / f"{name}.stl")
        lines = [
            *("v {} {} {}".format(*node) for node in block.nodes),
            *("f {} {} {}".format(*row) for row in skin + 1),
        ]
        (folder / f"{name}.obj").write_text("\n".join(lines))
        rows = ["{} {} {} {}".format(i + 1, *node) for i, node in enumerate(block.nodes)]
        cells = ["{} {} {} {} {}".format(i + 1, *row) for i, row in enumerate(block.elements + 1)]
        text = ["MESH dimension 3 ElemType Tetrahedra Nnode 4", "Coordinates", *rows, "End Coordinates", "Elements"]
        (folder / f"{name}.sph").write_text(f"Xsp 4.0\nsphe 0 1 2 3 {size[2]}\nsphe 1 4 5 6 2.5\n")
        (folder / f"{name}.gid").write_text("\n".join([*text, *cells, "End Elements"]))
    return folder


@pytest.mark.parametrize("kind", sorted(known_types()))
def test_every_datum_acts_or_is_listed(kind: str, folder: Path) -> None:
    silent, usually = [], {}
    for name in known_types()[kind].data:
        case = case_of(kind, name)
        usual = dict(case.usual)
        if id(case) not in usually:
            usually[id(case)] = outcome(folder, case, kind, usual)
        before, subject = usually[id(case)]
        assert subject is not None, before
        value = case.values[name] if name in case.values else another(subject.findData(name))
        after, _ = outcome(folder, case, kind, usual | {name: value})
        if after == before and run(folder, case, kind, usual) == run(folder, case, kind, usual | {name: value}):
            silent.append(f"{name} = {value}")
    assert not silent
