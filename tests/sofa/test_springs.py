"""Springs, planes and collision spheres, against m g / k."""

from pathlib import Path
from textwrap import dedent

import numpy as np
import pytest
from blocks import make_block
from scenes_of_sofa import BODY, Run, loaded, written
from test_rigid_parts import SERVO, started
from test_rigid_parts import folder as folder

from taichisoft import Simulation, load_scene, make_controller, write_volume_mesh
from taichisoft.mesh import read_surface
from taichisoft_sofa.translation.parts import Translation
from taichisoft_sofa.translation.translate import translate

MASS = 0.05
HUNG = """
def createScene(root):
    root.dt = 0.01
    root.gravity = [0, 0, -9810]
    free_motion(root)
    node = body(root)
    post = root.addChild("post")
    post.addObject("MechanicalObject", name="points", position=[[9, 9, 60], [0, 5, 60]])
    tool = root.addChild("tool")
    for kind in ("EulerImplicitSolver", "SparseLDLSolver", "LinearSolverConstraintCorrection"):
        tool.addObject(kind)
    tool.addObject("MechanicalObject", name="frame", template="Rigid3", position=[0, -5, -50, 0, 0, 0, 1])
    tool.addObject("UniformMass", totalMass=0.01)
    points = np.array(node.loader.position.value)
    top, low = (int(np.argmin(np.linalg.norm(points - place, axis=1))) for place in ([0, 5, 15], [0, -5, -15]))
    node.addObject("StiffSpringForceField", object1="@../post/points", object2="@dofs", spring=[1, top, 50, 0, 40])
    node.addObject("StiffSpringForceField", object1="@dofs", object2="@../tool/frame", indices1=[low], indices2=[0],
                   stiffness=20, damping=0, lengths=35)
"""


def test_a_block_and_what_hangs_on_it_hang_by_their_weights(folder: Path) -> None:
    """At rest the springs are longer than at rest by weight / k: (0.05 + 0.01) g / 50 mN/mm, and 0.01 g / 20 mN/mm."""
    hung = started(folder, HUNG, SERVO)
    hung.steps(250)
    lengths, tensions = (
        list(values.values())
        for values in (hung.simulation.observe().cable_lengths, hung.simulation.observe().cable_tensions)
    )
    assert lengths == pytest.approx([40 + 0.06 * 9810 / 50, 35 + 0.01 * 9810 / 20], rel=5e-3)
    assert tensions == pytest.approx([0.06 * 9810, 0.01 * 9810], rel=1e-2)


def test_mesh_springs_join_corners_of_cells(tmp_path: Path) -> None:
    """Six tetrahedra of a box have 19 edges; stiffness and damping are by relative stretch."""
    write_volume_mesh(make_block((1, 1, 1), (20.0, 10.0, 10.0)), tmp_path / "block.vtk")
    field = 'body(root).addObject("MeshSpringForceField", tetrahedraStiffness=30, tetrahedraDamping=1, {})'
    translation = translate(loaded(tmp_path, field.format("noCompression=True"), BODY))
    assert not translation.refused
    (springs,) = translation.tables["soft_bodies"]["body"]["springs"].values()
    assert len(springs["nodes"]) == 19
    assert springs["tension_only"]
    assert np.multiply(springs["stiffness"], springs["length"]) == pytest.approx(np.full(19, 30.0))
    assert np.multiply(springs["damping"], springs["length"]) == pytest.approx(np.ones(19))
    assert any("its damping takes the velocities at the end" in line for line in translation.departures)


ALONE = """
def createScene(root):
    root.dt = 0.01
    root.gravity = [0, 0, -9810]
    free_motion(root)
    node = body(root)
    node.removeObject(node.getObject("TetrahedronFEMForceField"))
    points = np.array(node.loader.position.value)
    top, low = ([i for i, point in enumerate(points) if point[2] == end] for end in (15, -15))
    node.addObject("FixedProjectiveConstraint", indices=[i for i, point in enumerate(points) if point[2] > -15])
    above = [min(top, key=lambda i: np.linalg.norm(points[i] - points[j])) for j in low]
    node.addObject("SpringForceField", indices1=low, indices2=above, stiffness=50, damping=0.5,
                   lengths=[LENGTH] * len(low))
"""


@pytest.mark.parametrize("length", [25.0, 35.0])
def test_springs_alone_hold_a_body(folder: Path, length: float) -> None:
    """Each stretches to length + m g / k at rest, where it is longer than at the start or shorter."""
    hung = started(folder, ALONE.replace("LENGTH", str(length)), SERVO)
    hung.steps(300)
    position, rest = hung.simulation.state.position, hung.simulation.model.rest_position
    low, top = rest[:, 2] == rest[:, 2].min(), rest[:, 2] == rest[:, 2].max()
    each = 0.05 / len(rest) * 9810 / 50
    assert position[top, 2].mean() - position[low, 2] == pytest.approx(np.full(low.sum(), length + each), rel=1e-3)


def test_springs_hold_points_without_cells(folder: Path) -> None:
    """Four points of 0.01 kg hang on four that are fixed, by m g / k; in a plane they are refused."""
    create = """
    root.gravity = [0, 0, -9810]
    node = root.addChild("net")
    node.addObject("EulerImplicitSolver", rayleighMass=5)
    node.addObject("SparseLDLSolver")
    corners = [[x, y, z] for z in (0, -20) for x, y in ((0, 0), (10, 0), (10, 10), (0, 10))]
    node.addObject("MechanicalObject", position=corners[:count])
    node.addObject("UniformMass", vertexMass=0.01)
    node.addObject("FixedProjectiveConstraint", indices=[0, 1, 2, 3])
    ends = [[0, 1, 2, 3], [4, 5, 6, 7]] if count == 8 else [[0, 1], [2, 3]]
    node.addObject("SpringForceField", indices1=ends[0], indices2=ends[1], stiffness=50, damping=0, lengths=[20] * 4)
    """
    hung = Run(folder, f"\ndef createScene(root):\n    count = 8{create}")
    shift = hung.steps(200) - hung.start
    assert shift[4:] == pytest.approx(np.tile([0.0, 0.0, -0.01 * 9810 / 50], (4, 1)), abs=1e-3)
    refused = translate(loaded(folder, f"count = 4{dedent(create)}", BODY)).refused
    assert any("which fill no volume; give them a topology" in line for line in refused), refused


@pytest.mark.parametrize(
    ("data", "refusal"),
    [
        ("spring=[0, 1, 50, 0]", "spring has 4 numbers; they are not rows of five"),
        ("spring=[0, 99, 50, 0, 1]", "names point 99; its points are 0 to 7"),
        ("indices1=[0, 1], indices2=[2]", "indices1 has 2 points, indices2 1"),
        ("spring=[3, 3, 50, 0, 1]", "joins points 3 and 3 at one place"),
        ("object1='@../nowhere', spring=[0, 1, 1, 0, 1]", "'@../nowhere' leads to no MechanicalObject"),
    ],
)
def test_springs_that_make_no_sense(tmp_path: Path, data: str, refusal: str) -> None:
    write_volume_mesh(make_block((1, 1, 1), (20.0, 10.0, 10.0)), tmp_path / "block.vtk")
    refused = translate(loaded(tmp_path, f'body(root).addObject("StiffSpringForceField", {data})', BODY)).refused
    assert any(refusal in line for line in refused), refused


# Planes of penalty forces.


FALLEN = """
def createScene(root):
    root.dt = 0.01
    root.gravity = [0, 0, -9810]
    free_motion(root)
    node = body(root, translation=[0, 0, 1])
    node.addObject("PlaneForceField", normal=[0, 0, 2], d=-30, stiffness=100)
"""


def test_a_block_lies_on_a_plane(folder: Path) -> None:
    """Behind n x = d of a normal that is not of length 1 there is nothing of it: it lies at z = -15 mm, and weighs m g.

    The scene has no contacts of its own.
    """
    fallen = started(folder, FALLEN, SERVO)
    fallen.steps(60)
    assert fallen.simulation.state.position[:, 2].min() == pytest.approx(-15.0, abs=1e-4)
    weight = fallen.simulation.observe().normal_forces["body", "plane0"]
    assert weight == pytest.approx(0.05 * 9810, rel=1e-3)


@pytest.mark.parametrize(
    ("data", "refusal"),
    [("normal=[0, 0, 0]", "has no direction"), ("normal=[0, 0, 1], bilateral=True", "push from one side")],
)
def test_planes_that_are_not_known(tmp_path: Path, data: str, refusal: str) -> None:
    write_volume_mesh(make_block((1, 1, 1), (20.0, 10.0, 10.0)), tmp_path / "block.vtk")
    refused = translate(loaded(tmp_path, f'body(root).addObject("PlaneForceField", {data})', BODY)).refused
    assert any(refusal in line for line in refused), refused


# Collision spheres of rigid bodies, points, soft bodies and what stands still.


def translated(folder: Path, create: str) -> Translation:
    return translate(loaded(folder, create, BODY))


BALL = """
    collisions(root, mu=0.0)
    root.gravity = [0, 0, -9810]
    floor = root.addChild("floor")
    floor.addObject("MechanicalObject", template="Rigid3", position=[0, 0, -20, 0, 0, 0, 1])
    spheres = floor.addChild("spheres")
    spheres.addObject("MechanicalObject", position=[[1, 2, 3]])
    spheres.addObject("SphereCollisionModel", radius=10)
    spheres.addObject("RigidMapping")
    ball = root.addChild("ball")
    ball.addObject("EulerImplicitSolver")
    ball.addObject("CGLinearSolver", threshold=1e-30)
    ball.addObject("MechanicalObject", name="point", position=[[1, 2, 8]])
    ball.addObject("UniformMass", totalMass=0.01)
    ball.addObject("SphereCollisionModel", radius=2)
    ball.addObject("UncoupledConstraintCorrection")
"""


def test_ball_rests_on_sphere(folder: Path, monkeypatch: pytest.MonkeyPatch, sofa: None) -> None:
    """Centres are apart by both radii and the contact distance of 1 mm."""
    monkeypatch.setenv("TAICHISOFT_CACHE", str(folder / "cache"))
    written(folder, {"scene.py": f"{BODY}\ndef createScene(root):{BALL}"})
    scene = load_scene(folder / "scene.py")
    assert scene.rigid_bodies["ball"].sphere.radius == 2.0
    assert scene.obstacles["floor"].translation == (1.0, 2.0, -17.0)
    simulation, controller = Simulation(scene), make_controller(scene)
    controller.reset(simulation.model)
    for _ in range(60):
        simulation.step(controller.control(simulation.observe()))
    assert simulation.state.rigid_position[0] == pytest.approx([1, 2, -17 + 10 + 2 + 1], abs=0.02)
    controller.control(simulation.observe())
    point = controller._tree.root.ball.point
    assert point.position.value == pytest.approx(simulation.state.rigid_position)
    assert point.velocity.value == pytest.approx(np.zeros((1, 3)), abs=1e-3)


def test_many_spheres_are_polyhedra_about_their_points(folder: Path) -> None:
    translation = translated(
        folder,
        """
        collisions(root)
        node = body(root)
        skin = node.addChild("skin")
        skin.addObject("MechanicalObject", position=[[0, 0, 0], [5, 0, 0]])
        skin.addObject("SphereCollisionModel", listRadius=[1, 2], group=3)
        skin.addObject("BarycentricMapping")
        """,
    )
    assert translation.refused == []
    (surface,) = translation.tables["soft_bodies"]["body"]["collision_surface"]
    assert surface["groups"] == [3]
    translation.files.write(folder)
    points, _ = read_surface(folder / surface["file"])
    near = np.linalg.norm(points, axis=1) < 1.5
    assert np.linalg.norm(points[near], axis=1) == pytest.approx(1.0, rel=1e-5)
    assert np.linalg.norm(points[~near] - [5, 0, 0], axis=1) == pytest.approx(2.0, rel=1e-5)
    assert any("is a polyhedron of 320 triangles" in line for line in translation.departures)


@pytest.mark.parametrize(
    ("data", "refusal"),
    [("listRadius=[1, 2, 3]", "listRadius has 3 numbers for 1 points"), ("radius=0", "0 must be above 0")],
)
def test_spheres_without_a_radius_are_refused(folder: Path, data: str, refusal: str) -> None:
    create = f"""
        node = root.addChild("ball")
        node.addObject("MechanicalObject", position=[[0, 0, 0]])
        node.addObject("SphereCollisionModel", {data})
        """
    try:
        refused = translated(folder, create).refused
    except Exception as error:
        refused = [str(error)]
    assert any(refusal in line for line in refused), refused


@pytest.mark.parametrize("template", ["Rigid3", "Vec3"])
def test_goal_without_mass_is_left_out(folder: Path, template: str) -> None:
    """Such goals have solvers of first order beside robots that have inertia, and spheres that show them."""
    pose = [1, 2, 3, 0, 0, 0, 1] if template == "Rigid3" else [1, 2, 3]
    translation = translated(
        folder,
        f"""
        collisions(root)
        body(root)
        goal = root.addChild("goal")
        goal.addObject("EulerImplicitSolver", firstOrder=True)
        goal.addObject("CGLinearSolver")
        goal.addObject("MechanicalObject", template="{template}", position={pose})
        goal.addObject("UncoupledConstraintCorrection")
        spheres = goal.addChild("spheres")
        spheres.addObject("MechanicalObject", position=[[0, 0, 0]])
        spheres.addObject("SphereCollisionModel", radius=5)
        spheres.addObject("{"RigidMapping" if template == "Rigid3" else "IdentityMapping"}")
        """,
    )
    assert translation.refused == []
    assert list(translation.tables["soft_bodies"]) == ["body"]
    assert "rigid_bodies" not in translation.tables
    assert "obstacles" not in translation.tables
    assert any("/goal: has no mass, so that the scene alone moves it" in line for line in translation.departures)
