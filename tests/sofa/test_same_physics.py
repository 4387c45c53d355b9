"""Values that act as in SOFA or are refused, where they once meant something else without a word."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from blocks import make_block
from scenes_of_sofa import BODY, Run, loaded

from taichisoft import Control, Simulation, make_model, write_volume_mesh
from taichisoft.errors import SceneError
from taichisoft.mesh import boundary_triangles, enclosed_volume, write_stl
from taichisoft.scene import scene_from_dict
from taichisoft_sofa.loading import load_tree
from taichisoft_sofa.scene_reader import with_files_in
from taichisoft_sofa.translation.parts import Translation
from taichisoft_sofa.translation.translate import translate

SIZE = (20.0, 10.0, 10.0)
CHILD = """
child = {body}.addChild("child")
child.addObject("MechanicalObject", position=[[10, 5, 5], [9, 1, -2]])
child.addObject("BarycentricMapping")
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    block = make_block((2, 1, 1), SIZE)
    write_volume_mesh(block, tmp_path / "block.vtk")
    write_stl(block.nodes, boundary_triangles(block.elements), tmp_path / "block.stl")
    return tmp_path


def translated(folder: Path, create: str) -> Translation:
    return translate(loaded(folder, create, BODY))


def refused(folder: Path, create: str) -> str:
    return " ".join(translated(folder, create).refused)


def forces_on_nodes(table: dict[str, Any], count: int) -> np.ndarray:
    total = np.zeros((count, 3))
    for force in table["forces"]:
        total[force["nodes"]] += np.array(force["force"]) / len(force["nodes"])
    return total


def test_force_on_a_mapped_point_keeps_its_sum_and_moment(folder: Path) -> None:
    """J^T f: the nodes of the element around the point share the force by its weights."""
    create = "body(root)\n" + CHILD.format(body='root.getChild("body")')
    create += 'child.addObject("ConstantForceField", indices=[0], totalForce=[0, 0, 7], indexFromEnd=True)\n'
    translation = translated(folder, create)
    assert not translation.refused
    nodes = make_block((2, 1, 1), SIZE).nodes
    forces = forces_on_nodes(translation.tables["soft_bodies"]["body"], len(nodes))
    np.testing.assert_allclose(forces.sum(axis=0), [0, 0, 7], atol=1e-12)
    np.testing.assert_allclose(np.cross(nodes, forces).sum(axis=0), np.cross([9, 1, -2], [0, 0, 7]), atol=1e-10)


@pytest.mark.parametrize(
    "component",
    [
        '"RestShapeSpringsForceField", points=[0], stiffness=10',
        '"UniformMass", totalMass=0.5',
        '"DiagonalMass", totalMass=0.5',
        '"PlaneForceField", normal=[0, 0, 1]',
        '"FixedProjectiveConstraint", indices=[0]',
        '"LinearMovementProjectiveConstraint", indices=[0], keyTimes=[0, 1], movements=[[0, 0, 0], [1, 0, 0]]',
        '"TetrahedronFEMForceField", youngModulus=5',
    ],
)
def test_what_acts_by_numbers_of_mapped_points_is_refused(folder: Path, component: str) -> None:
    create = "body(root)\n" + CHILD.format(body='root.getChild("body")') + f"child.addObject({component})\n"
    assert "acts on points that follow others by BarycentricMapping" in refused(folder, create)


def test_same_points_below_mapped_ones_follow_their_mapping(folder: Path) -> None:
    create = "body(root)\n" + CHILD.format(body='root.getChild("body")')
    push = '.addObject("ConstantForceField", indices=[0], force=[0, 0, 7])\n'
    below = 'same = child.addChild("same")\nsame.addObject("MechanicalObject")\nsame.addObject("IdentityMapping")\n'
    held = refused(folder, create + below + 'same.addObject("RestShapeSpringsForceField", points=[0])\n')
    assert "acts on points that follow others by BarycentricMapping" in held
    forces = [
        translated(folder, create + more).tables["soft_bodies"]["body"]["forces"]
        for more in ("child" + push, below + "same" + push)
    ]
    assert forces[0] == forces[1]


@pytest.mark.parametrize(
    ("mass", "expected"),
    [
        ('"DiagonalMass"', 1.0),
        ('"MeshMatrixMass", lumping=True', 1.0),
        ('"MeshMatrixMass", totalMass=0.04, massDensity=2, lumping=True', 0.04),
        ('"DiagonalMass", totalMass=0.04, vertexMass=[0.001] * 12', 0.04),
        ('"DiagonalMass", massDensity=2e-5, vertexMass=[0.001] * 12', 0.04),
        ('"MeshMatrixMass", totalMass=0.04, lumping=True', 0.04),
        ('"DiagonalMass", totalMass=0.04', 0.04),
        ('"DiagonalMass", vertexMass=[0.001] * 12', 0.012),
        ('"DiagonalMass", vertexMass=[0.001] * 3', "vertexMass has 3 numbers, not one for all of 12 points"),
        ('"DiagonalMass", vertexMass=[0.001] * 11 + [0.002]', "vertexMass has 12 numbers, not one for all"),
        ('"MeshMatrixMass", vertexMass=[0.001] * 12', "vertexMass without lumping is an error in SOFA"),
        ('"UniformMass", totalMass=0.04, indices=[0, 1]', "gives some of the points a mass"),
        ('"UniformMass", totalMass=0.04, localRange=[0, 3]', "gives some of the points a mass"),
        ('"UniformMass", filename="torus.rigid"', "filename 'torus.rigid' is not read; give vertexMass"),
        ('"DiagonalMass", filename="torus.mass"', "filename 'torus.mass' is not read; give totalMass or massDensity"),
    ],
)
def test_mass_of_a_body(folder: Path, mass: str, expected: float | str) -> None:
    create = f'node = body(root)\nnode.removeObject(node.getObject("UniformMass"))\nnode.addObject({mass})\n'
    translation = translated(folder, create)
    if isinstance(expected, str):
        assert expected in " ".join(translation.refused)
        return
    assert not translation.refused
    tables = with_files_in(folder, translation.tables)
    translation.files.write(folder)
    model = make_model(scene_from_dict(tables, "a test"))
    assert model.soft_bodies[0].node_mass.sum() == pytest.approx(expected, rel=1e-12)


def test_springs_without_lengths_have_length_zero(folder: Path) -> None:
    create = "node = body(root)\n"
    create += 'node.addObject("StiffSpringForceField", indices1=[0, 1], indices2=[2, 3], stiffness=[10, 20])\n'
    (springs,) = translated(folder, create).tables["soft_bodies"]["body"]["springs"].values()
    assert springs["nodes"] == [[0, 2], [1, 3]]
    assert springs["stiffness"] == [10.0, 20.0]
    assert springs["length"] == [0.0, 0.0]


def test_springs_beyond_a_list_have_its_last_number(folder: Path) -> None:
    create = 'springs = body(root).addObject("StiffSpringForceField", indices1=[0, 1, 4], indices2=[2, 3, 5])\n'
    create += "springs.stiffness, springs.lengths, springs.enabled = [10, 20], [1, 2], [True, False, True]\n"
    (springs,) = translated(folder, create).tables["soft_bodies"]["body"]["springs"].values()
    assert springs["nodes"] == [[0, 2], [4, 5]]
    assert springs["stiffness"] == [10.0, 20.0]
    assert springs["length"] == [1.0, 2.0]


SMALL = """
def createScene(root):
    root.gravity = [0, 0, 0]
    node = body(root)
    node.getObject("TetrahedronFEMForceField").method = "METHOD"
    node.addObject("FixedProjectiveConstraint", indices=[0, 3, 6])
    node.addObject("ConstantForceField", indices=[11], force=[0, 0, FORCE])
"""


@pytest.mark.parametrize(("method", "is_linear"), [("small", True), ("large", False)])
def test_method_small_is_linear(folder: Path, method: str, is_linear: bool) -> None:
    """Ten times the force moves every node ten times as far, however far the body turns."""
    moved = []
    for force in (2000, 20000):
        run = Run(folder, SMALL.replace("METHOD", method).replace("FORCE", str(force)))
        moved.append(run.steps(5) - run.start)
    assert np.abs(moved[1]).max() > 5.0
    assert np.allclose(moved[1], 10.0 * moved[0], atol=1e-9, rtol=0.0) is is_linear


def test_second_rotation_turns_what_the_first_translation_moved(folder: Path) -> None:
    create = 'state = body(root).getObject("dofs")\nstate.translation = [100, 0, 0]\nstate.rotation2 = [0, 0, 90]\n'
    translation = translated(folder, create)
    nodes = make_block((2, 1, 1), SIZE).nodes
    moved = np.column_stack([-nodes[:, 1], nodes[:, 0] + 100.0, nodes[:, 2]])
    assert translation.soft["body"].body.position == pytest.approx(moved, abs=1e-9)


@pytest.mark.parametrize(
    ("written", "factors", "shift"),
    [
        ("dofs.scale, node.dofs.scale3d = 2, [1, 1, 3]", [2, 2, 2], 0),
        ("dofs.sx = 3", [3, 1, 1], 0),
        ("dofs.dx2 = 7", [1, 1, 1], 7),
        ("loader.scale, node.loader.scale3d = 2, [1, 1, 3]", [2, 2, 6], 0),
    ],
)
def test_scales_and_shifts_of_other_names(folder: Path, written: str, factors: list[float], shift: float) -> None:
    """A number `scale` replaces `scale3d` of a mechanical object, and multiplies that of a loader."""
    position = translated(folder, f"node = body(root)\nnode.{written}\n").soft["body"].body.position
    assert position == pytest.approx(make_block((2, 1, 1), SIZE).nodes * factors + [shift, 0, 0], abs=1e-9)


def test_second_motion_leaves_the_rest_shape(folder: Path) -> None:
    """Springs pull a body back to where it was before `translation2`, and boxes select there."""
    run = Run(
        folder,
        """
def createScene(root):
    root.gravity = [0, 0, 0]
    node = body(root)
    node.dofs.translation2 = [5, 3, 0]
    node.addObject("PartialFixedProjectiveConstraint", fixAll=True, fixedDirections=[0, 1, 0])
    node.addObject("BoxROI", name="end", box=[-1, -99, -99, 1, 99, 99])
    node.addObject("RestShapeSpringsForceField", points="@end.indices", stiffness=100)
""",
    )
    assert run.steps(150) - run.start == pytest.approx(np.tile([-5, 0, 0], (12, 1)), abs=1e-3)


def test_rigid_bodies_follow_others_from_where_they_begin(folder: Path) -> None:
    create = """
for name, place in (("other", 10), ("own", {place})):
    node = root.addChild(name)
    node.addObject("EulerImplicitSolver")
    node.addObject("SparseLDLSolver")
    node.addObject("MechanicalObject", name="dofs", template="Rigid3", position=[[place, 0, 0, 0, 0, 0, 1]])
    node.addObject("UniformMass", totalMass=0.01)
node.addObject("RestShapeSpringsForceField", external_rest_shape="@/other/dofs")
"""
    translation = translated(folder, create.format(place=10))
    assert "springs" in translation.tables["rigid_bodies"]["own"]
    assert "/other/dofs begins elsewhere" in refused(folder, create.format(place=11))


def test_misspelt_data_of_nodes_are_listed(folder: Path) -> None:
    (folder / "scene.scn").write_text('<Node gravty="0 0 -9810"/>')
    for tree in (loaded(folder, "root.gravty = [0, 0, -9810]", BODY), load_tree(folder / "scene.scn")):
        assert "node 'root': gravty is not read here; did you mean 'gravity'?" in translate(tree).departures


def test_box_without_a_size_is_the_unit_cube(folder: Path) -> None:
    shift = (0.5 - make_block((2, 1, 1), SIZE).nodes[3]).tolist()
    create = f'node = body(root)\nnode.dofs.translation = {shift}\nnode.addObject("BoxROI", name="roi")\n'
    create += 'node.addObject("FixedProjectiveConstraint", indices="@roi.indices")\n'
    (anchors,) = translated(folder, create).tables["soft_bodies"]["body"]["anchors"]
    assert anchors["nodes"] == [3]


def test_uppermost_time_integration_moves_everything_below(folder: Path) -> None:
    create = 'root.addObject("EulerImplicitSolver", rayleighMass=3)\nbody(root)\n'
    assert translated(folder, create).tables["soft_bodies"]["body"]["rayleigh_mass"] == 3.0


def test_penalty_contacts_touch_without_free_motion(folder: Path) -> None:
    contact = 'root.addObject("CollisionPipeline")\nroot.addObject("BruteForceBroadPhase")\n'
    contact += 'root.addObject("BVHNarrowPhase")\nroot.addObject("RuleBasedContactManager", response="{}")\n'
    contact += 'root.addObject("DefaultAnimationLoop")\nsurface(body(root), "block.stl")\n'
    for response, touches in (
        ("PenalityContactForceField", True),
        ("default", True),
        ("FrictionContactConstraint", False),
    ):
        translation = translated(folder, contact.format(response))
        assert not translation.refused
        assert translation.tables["soft_bodies"]["body"].get("collides", True) is touches


def test_contacts_without_a_narrow_phase_or_friction_are_listed(folder: Path) -> None:
    create = "collisions(root)\nsurface(body(root), 'block.stl')\nroot.CollisionResponse.responseParams = 'Mu=0.3'\n"
    lines = " ".join(translated(folder, create + 'root.removeObject(root.getObject("BVHNarrowPhase"))').departures)
    assert "there is no narrow phase" in lines
    assert "responseParams has no mu; friction is SOFA's 0.8" in lines


def test_force_below_a_mapped_node_acts_on_its_points(folder: Path) -> None:
    """A node without points of its own acts on those of the nearest node above, which follow the body."""
    push = '.addObject("ConstantForceField", indices=[1], totalForce=[0, 0, 7])\n'
    create = "body(root)\n" + CHILD.format(body='root.getChild("body")')
    tables = [
        translated(folder, create + where + push).tables["soft_bodies"]["body"]["forces"]
        for where in ("child", 'child.addChild("below")')
    ]
    assert tables[0] == tables[1]


IDENTITY = 'child = body(root).addChild("child")\nchild.addObject("MechanicalObject")\n'
IDENTITY += 'child.addObject("IdentityMapping")\nchild.addObject('
HEXAHEDRA = """
node = root.addChild("g")
node.addObject("RegularGridTopology")
node.addObject("MechanicalObject")
node.addObject("HexahedronFEMForceField", method="small")
"""
ON_FRAME = """
a = root.addChild("a")
a.addObject("MechanicalObject", template="Rigid3")
surface(a, "block.stl", name="b", mapping="RigidMapping").RigidMapping.index = 5
"""


@pytest.mark.parametrize(
    ("create", "line"),
    [
        ('body(root).addObject("UniformMass", name="more")', "is a second mass of its body, beside UniformMass"),
        ("body(root).dofs.restScale = 0.5", "position differs from rest_position"),
        ('body(root).addObject("EulerImplicitSolver", name="more")', "is a second time integration in its node"),
        ('body(root).addObject("RestShapeSpringsForceField", points=[0, 1], external_rest_shape="@dofs")', "of 12 in"),
        (HEXAHEDRA, "method 'small'; hexahedra turn with the body here: large, polar"),
        (
            'root.addObject("CollisionResponse", response="FrictionContactConstrain")',
            "response 'FrictionContactConstrain'",
        ),
        ('root.addObject("CollisionResponse", response="StickContactConstraint")', "response 'StickContactConstraint'"),
        (IDENTITY + '"FixedProjectiveConstraint")', "acts on points that follow others by IdentityMapping"),
        (ON_FRAME, "RigidMapping '/a/b/RigidMapping' "),
        (ON_FRAME.replace("index = 5", "rigidIndexPerPoint = [0]"), "rigidIndexPerPoint has 1 numbers for 12 points"),
        ('body(root).addObject("RestShapeSpringsForceField", external_rest_shape="@/gone")', "leads to no Mechanical"),
        ('surface(body(root), "block.stl").BarycentricMapping.input = "@/gone"', "input = '@/gone' leads to nothing"),
    ],
)
def test_values_without_a_meaning_here_are_refused(folder: Path, create: str, line: str) -> None:
    assert line in refused(folder, create)


PUSHED = """
def createScene(root):
    root.gravity = [0, 0, {gravity}]
    node = body(root)
    node.EulerImplicitSolver.rayleighMass = 0.0
    node.addObject("FixedProjectiveConstraint", indices=[0, 1, 2, 3])
    node.addObject("ConstantForceField", indices=[11], force=[0, 90, 0])
    {mass}
"""


def test_body_without_mass_moves_by_its_stiffness(folder: Path) -> None:
    """SOFA's system has no mass then: a steady force leads to the same place as with one, and weight is nothing."""
    ends = []
    without, light = 'node.removeObject(node.getObject("UniformMass"))', "node.UniformMass.totalMass = 1e-4"
    for gravity, mass in ((-9810, without), (0, light)):
        run = Run(folder, PUSHED.format(gravity=gravity, mass=mass))
        ends.append(run.steps(150) - run.start)
    assert np.abs(ends[1]).max() > 0.1
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-4 * np.abs(ends[1]).max())


def test_included_files_are_nodes_with_other_names(folder: Path) -> None:
    """An `include` is the outermost node of its file, with the attributes of the `include`."""
    inside = '<Node name="floor"><MechanicalObject position="1 2 3"/><Node name="deeper"/></Node>'
    (folder / "floor.xml").write_text(inside)
    scene = "<Node>\n<include href='floor.xml' {}/>\n<Node name='last'/></Node>"
    (folder / "scene.scn").write_text(scene.format("name='ground'"))
    root = load_tree(folder / "scene.scn").root
    assert [node.getPathName() for node in root.walk()] == ["/", "/ground", "/ground/deeper", "/last"]
    assert root.ground.MechanicalObject.position.value.tolist() == [[1.0, 2.0, 3.0]]
    (folder / "floor.xml").write_text("<Node><include href='floor.xml'/></Node>")
    with pytest.raises(SceneError, match=r"floor\.xml', which includes it"):
        load_tree(folder / "scene.scn")
    (folder / "scene.scn").write_text(scene.format("Mass__totalMass='1'"))
    with pytest.raises(SceneError, match="line 2: Mass__totalMass: sets a datum inside an included file"):
        load_tree(folder / "scene.scn")


def test_mass_of_what_a_surface_encloses(folder: Path) -> None:
    create = """
        root.addObject("MeshSTLLoader", name="loader", filename="block.stl")
        surface = {"position": "@loader.position", "triangles": "@loader.triangles"}
        root.addObject("GenerateRigidMass", density=3e-6, **surface)
    """
    tree = loaded(folder, create, BODY)
    translate(tree)
    a, b, c = SIZE
    mass, volume, *inertia = tree.root.GenerateRigidMass.rigidMass.value
    assert [mass, volume] == pytest.approx([3e-6 * a * b * c, a * b * c])
    squares = np.array([b * b + c * c, a * a + c * c, a * a + b * b]) / 12.0
    np.testing.assert_allclose(np.reshape(inertia, (3, 3)), np.diag(squares), atol=1e-9)


def test_triangle_models_of_a_mesh_of_cells_are_its_skin(folder: Path) -> None:
    translation = translated(folder, 'collisions(root)\nbody(root).addObject("TriangleCollisionModel")')
    (surface,) = translation.tables["soft_bodies"]["body"]["collision_surface"]
    translation.files.write(folder)
    skin = trimesh.load_mesh(folder / surface["file"])
    assert skin.is_watertight
    assert skin.volume == pytest.approx(np.prod(SIZE))


def test_friction_is_that_of_the_lcp_solver(folder: Path) -> None:
    create = 'collisions(root, mu=0.3)\nroot.removeObject(root.getObject("GenericConstraintSolver"))\n'
    create += 'root.addObject("LCPConstraintSolver")\nsurface(body(root), "block.stl")'
    assert translated(folder, create).tables["contact"]["friction"] == 0.6


def test_body_may_begin_as_a_rigid_motion_of_its_rest_shape(folder: Path) -> None:
    create = 'state = body(root).getObject("dofs")\nrest = state.position.array()\nstate.rest_position = rest\n'
    create += "turn = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])\nstate.position = rest @ turn.T + [7, 8, 9]\n"
    translation = translated(folder, create)
    assert not translation.refused
    nodes = make_block((2, 1, 1), SIZE).nodes
    moved = np.column_stack([7 - nodes[:, 1], 8 + nodes[:, 0], 9 + nodes[:, 2]])
    assert translation.soft["body"].body.position == pytest.approx(moved)


MOVEMENTS = [[0, 0, 0, 0, 0, 0], [20, 0, 4, 0, 0, 1]]
RIGID = """
def createScene(root):
    root.gravity = [0, 0, -1000]
    node = root.addChild("ball")
    node.addObject("EulerImplicitSolver")
    node.addObject("SparseLDLSolver")
    node.addObject("MechanicalObject", template="Rigid3", position=[[0, 0, 0, 0, 0, 0, 1]])
    node.addObject("UniformMass", totalMass=0.01)
    node.addObject("UncoupledConstraintCorrection")
    node.addObject({})
"""


@pytest.mark.parametrize(
    ("component", "place", "turn"),
    [
        ('"PartialFixedProjectiveConstraint", fixedDirections=[1, 1, 1, 0, 0, 0]', [0, 0, 0], 0),
        ('"PartialFixedProjectiveConstraint", fixedDirections=[0, 0, 0, 1, 1, 1]', [0, 0, -5.5], 0),
        (
            '"LinearMovementProjectiveConstraint", keyTimes=[0, 1], movements=[[0] * 6, [20, 0, 4, 0, 0, 1]]',
            [2, 0, 0.4],
            0.1,
        ),
    ],
)
def test_rigid_body_is_held_in_part_or_moved(folder: Path, component: str, place: list[float], turn: float) -> None:
    """After ten steps of 0.01 s: free fall by g h^2 (1 + ... + 10), or a tenth of the movement."""
    run = Run(folder, RIGID.format(component))
    run.steps(10)
    state = run.simulation.state
    np.testing.assert_allclose(state.rigid_position[0], place, atol=1e-6)
    np.testing.assert_allclose(state.rigid_rotation[0], [np.cos(turn / 2), 0, 0, np.sin(turn / 2)], atol=1e-9)


def test_rest_position_beside_another_position_is_refused(folder: Path) -> None:
    create = 'state = body(root).getObject("dofs")\nstate.position = state.position.array()\n'
    create += "state.rest_position = state.position.array() * 1.2\n"
    assert "position differs from rest_position; a body begins at rest here" in refused(folder, create)


@pytest.mark.parametrize("growth", [40.0, -90.0])
def test_first_step_meets_the_growth_of_a_volume_linearly(folder: Path, growth: float) -> None:
    """SOFA's constraint is of V(x) + dV/dx dx: the volume itself overshoots, as in its scene Springy.py."""
    scene = """
def createScene(root):
    free_motion(root)
    root.gravity = [0, 0, 0]
    cavity = surface(body(root), "block.stl")
    cavity.addObject("SurfacePressureConstraint", value={}, valueType="volumeGrowth")
"""
    run = Run(folder, scene.format(growth))
    moved = run.steps(1) - run.start
    skin = boundary_triangles(make_block((2, 1, 1), SIZE).elements)
    ahead, behind = (enclosed_volume(run.start + way * moved, skin) for way in (1e-3, -1e-3))
    assert (ahead - behind) / 2e-3 == pytest.approx(growth, rel=1e-6)


def test_pressures_below_a_vacuum_act(folder: Path) -> None:
    create = 'node = body(root)\ncavity = node.addChild("cavity")\n'
    create += 'cavity.addObject("MeshSTLLoader", name="loader", filename="block.stl")\n'
    create += 'cavity.addObject("MechanicalObject", src="@loader")\ncavity.addObject("BarycentricMapping")\n'
    create += 'cavity.addObject("SurfacePressureConstraint", triangles="@loader.triangles", value=1)\n'
    translation = translated(folder, create)
    tables = with_files_in(folder, translation.tables)
    translation.files.write(folder)
    simulation = Simulation(scene_from_dict(tables, "a test"))
    name = simulation.model.cavities.names[0]
    assert simulation.step(Control(pressure={name: -500.0})).observation.pressures[name] == -500.0


MOVED = """
import Sofa

class Raise(Sofa.Core.Controller):
    def onAnimateBeginEvent(self, event):
        self.constraint.value = [0.0, self.constraint.value[1] + 0.5]

def createScene(root):
    root.gravity = [0, 0, 0]
    node = body(root)
    node.addObject("FixedProjectiveConstraint", indices=[0, 3, 6, 9])
    node.addObject("PositionConstraint", name="push", indices=[2, 5], useDirections=[0, 1, 0],
                   value=[0, 0], valueIndex=1)
    node.addObject("PartialFixedProjectiveConstraint", indices=[2], fixedDirections=[1, 0, 0])
    root.addObject(Raise()).constraint = node.push
"""


def test_position_constraint_moves_points_along_its_axes(folder: Path) -> None:
    """By its present value, exactly, whatever else holds the other axes of the same points."""
    run = Run(folder, MOVED)
    for value in (0.5, 1.0, 1.5):
        moved = run.steps(1) - run.start
        np.testing.assert_allclose(moved[[2, 5], 1], value, atol=1e-6)
    assert moved[2, 0] == pytest.approx(0.0, abs=1e-6)
    assert abs(moved[5, 0]) > 1e-3


def test_later_support_decides_along_its_axis_alone(folder: Path) -> None:
    run = Run(folder, MOVED.replace("useDirections=[0, 1, 0]", "useDirections=[1, 1, 1]"))
    np.testing.assert_allclose((run.steps(1) - run.start)[[2, 5]], [[0.0, 0.5, 0.5], [0.5, 0.5, 0.5]], atol=1e-6)


@pytest.mark.parametrize(
    "component",
    [
        '"PositionConstraint", indices=[], value=1',
        '"LinearMovementConstraint", indices=[], keyTimes=[0, 1], movements=[[0, 0, 0], [1, 1, 1]]',
        '"PartialLinearMovementConstraint", keyTimes=[0, 1], movements=[[0] * 3, [1] * 3], movedDirections=[0, 0, 0]',
    ],
)
def test_constraints_of_nothing_move_nothing(folder: Path, component: str) -> None:
    run = Run(
        folder, f"\ndef createScene(root):\n    root.gravity = [0, 0, 0]\n    body(root).addObject({component})\n"
    )
    np.testing.assert_allclose(run.steps(2), run.start, atol=1e-12)


PARTLY = """
def createScene(root):
    root.gravity = [0, 0, 0]
    root.dt = 0.01
    node = body(root)
    node.addObject("FixedProjectiveConstraint", indices=[0, 3, 6, 9])
    node.addObject("PartialLinearMovementConstraint", indices=[2, 5], keyTimes=[0, 0.02],
                   movements=[[0, 0, 0], [9, 9, 1]], movedDirections=[0, 0, 1])
"""


def test_partial_movement_leaves_other_axes_free(folder: Path) -> None:
    run = Run(folder, PARTLY)
    np.testing.assert_allclose((run.steps(1) - run.start)[[2, 5], 2], 0.5, atol=1e-6)
    moved = (run.steps(3) - run.start)[[2, 5]]
    np.testing.assert_allclose(moved[:, 2], 1.0, atol=1e-6)
    assert (np.abs(moved[:, :2]) < 3.0).all()


@pytest.mark.parametrize(
    ("scene", "message"),
    [
        ('body(root).addObject("PositionConstraint", valueType="force")', "only a displacement is imposed here"),
        ('body(root).addObject("PositionConstraint", indices=[99])', "names point 99; its points are 0 to 11"),
        ('body(root).addObject("PositionConstraint", useDirections=[1, 0])', "useDirections has 2 numbers; three"),
        ('body(root).addObject("PositionConstraint", directions=[[0, 1, 0]] * 3)', "not rigid bodies or along other"),
        ('body(root).addObject("PositionConstraint", value=[1], valueIndex=1)', "value has 1 numbers; number 1"),
        ('body(root).addObject("JointConstraint", value=1)', "acts on no angle; its node must have"),
    ],
)
def test_constraints_that_cannot_be_are_refused(folder: Path, scene: str, message: str) -> None:
    assert message in refused(folder, scene)
