"""Rigid bodies that frames, springs or the scene itself lead: servos without a soft body, mazes, tools."""

from pathlib import Path

import numpy as np
import pytest
from blocks import make_block
from scenes_of_sofa import BODY, written
from test_rigid_parts import SCENE, Run
from test_rigid_parts import folder as folder

from taichisoft.errors import SceneError
from taichisoft.mesh import boundary_triangles, read_surface, write_stl
from taichisoft_sofa.loading import load_tree
from taichisoft_sofa.translation.translate import translate

SERVO = SCENE.partition("def createScene")[0]
ALONE = """
def createScene(root):
    root.dt = 0.01
    root.gravity = [0, 0, 0]
    collisions(root)
    root.addObject("EulerImplicitSolver", rayleighStiffness={lag})
    root.addObject("SparseLDLSolver")
    wheel = servo(root, rest=0.5, mass=1e-9)
    arm = wheel.addChild("arm")
    arm.addObject("MechanicalObject", position=[[0, 20, 0]])
    arm.addObject("SphereCollisionModel", radius=4)
    arm.addObject("RigidMapping", index=1)
"""


def run(folder: Path, monkeypatch: pytest.MonkeyPatch, lines: str) -> Run:
    """A run of a scene with these lines after BODY and the servo."""
    monkeypatch.setattr("test_rigid_parts.SCENE", SERVO)
    return Run(folder, lines)


def test_a_servo_alone_turns_the_ball_on_its_arm(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The scene has no soft body. The arm's ball is 20 mm from the axis and turns by the angle of the joint.

    The servo's base is turned by 90 degrees about z, so that the axis x of the joint points along y, and the arm's y
    along -x: the ball, whose centre of mass it is, moves in the plane of x and z.
    """
    servo = run(folder, monkeypatch, ALONE.format(lag=0.0))
    servo.steps(2)  # without mass and damping the angle is its rest angle after one step
    body = servo.simulation.model.body_names.index("wheel")
    place = [-30 - 20 * np.cos(0.5), 0, 20 * np.sin(0.5)]
    assert servo.simulation.state.rigid_position[body] == pytest.approx(place, abs=1e-9)
    turn = servo.simulation.state.rigid_rotation[body]
    assert turn[0] == pytest.approx(np.cos(0.25) * np.cos(np.pi / 4), abs=1e-9)
    assert servo.simulation.observe().normal_forces == {}


MAZE = """
def createScene(root):
    root.dt = 0.01
    root.gravity = [0, 0, -9810]
    collisions(root)
    tray = root.addChild("tray")
    tray.addObject("EulerImplicitSolver", firstOrder=True)
    tray.addObject("CGLinearSolver")
    tray.addObject("MechanicalObject", name="dofs", template="Rigid3")
    tray.addObject("RestShapeSpringsForceField", points=0, stiffness=1e5, angularStiffness=1e5)
    tray.addObject("UncoupledConstraintCorrection")
    surface(tray, "block.stl", mapping="RigidMapping")
    ball = root.addChild("ball")
    for kind in ("EulerImplicitSolver", "SparseLDLSolver", "LinearSolverConstraintCorrection"):
        ball.addObject(kind)
    ball.addObject("MechanicalObject", name="dofs", position=[0, 0, 20.1])
    ball.addObject("UniformMass", totalMass=1e-3)
    ball.addObject("SphereCollisionModel", radius=4)
"""


def test_a_tray_on_springs_without_mass_is_where_its_rest_pose_is(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It moves in overdamped dynamics beside a ball that does not, and lifts the ball by what the scene writes."""
    block = make_block((1, 1, 1), (60.0, 60.0, 30.0))
    write_stl(block.nodes, boundary_triangles(block.elements), folder / "block.stl")
    maze = run(folder, monkeypatch, MAZE)
    names = maze.simulation.model.body_names
    for number in range(20):
        maze.root.tray.dofs.rest_position = [[0, 0, 0.1 * number, 0, 0, 0, 1]]
        maze.steps(1)
    heights = maze.simulation.state.rigid_position[:, 2]
    assert heights[names.index("tray")] == pytest.approx(1.9, abs=1e-12)
    assert heights[names.index("ball")] == pytest.approx(15 + 1.9 + 4 + 1, abs=0.2)  # radius and contact distance


HELD = """
def createScene(root):
    root.dt = 0.01
    root.gravity = [0, 0, 0]
    free_motion(root)
    tool = root.addChild("tool")
    for kind in ("EulerImplicitSolver", "SparseLDLSolver", "LinearSolverConstraintCorrection"):
        tool.addObject(kind)
    tool.addObject("MechanicalObject", name="dofs", template="Rigid3", position=[1, 2, 3, 0, 0, 0, 1])
    tool.addObject("UniformMass", totalMass=0.01)
    tool.addObject("RestShapeSpringsForceField", points=0, stiffness=200, angularStiffness=1e4)
    tool.addObject("ConstantForceField", indices=[0], forces=[[100, 0, 0, {torque}, 0, 0]])
"""


def test_a_rigid_body_on_springs_gives_way_to_a_force(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By F / k = 100 mN / (200 mN/mm) at rest, from the rest pose that the scene writes."""
    tool = run(folder, monkeypatch, HELD.format(torque=0))
    tool.root.tool.dofs.rest_position = [[1, 2, 8, 0, 0, 0, 1]]
    tool.steps(300)
    assert tool.simulation.state.rigid_position[0] == pytest.approx([1.5, 2, 8], abs=1e-6)


def test_torques_on_rigid_bodies_are_refused(folder: Path) -> None:
    written(folder, {"scene.py": BODY + SERVO + HELD.format(torque=5)})
    (line,) = translate(load_tree(folder / "scene.py")).refused
    assert "has a torque on a rigid body; forces alone act on rigid bodies here" in line


def test_a_scene_in_which_nothing_moves_shows_its_visual_models(folder: Path) -> None:
    block = make_block((1, 1, 1), (60.0, 60.0, 30.0))
    write_stl(block.nodes, boundary_triangles(block.elements), folder / "block.stl")
    text = """
def createScene(root):
    root.addObject("MeshSTLLoader", name="loader", filename="block.stl", translation=[5, 0, 0])
    seen = root.addChild("seen")
    seen.addObject("MechanicalObject", name="dofs", position=root.loader.position.getLinkPath())
    seen.addObject("UniformMass", totalMass=1.0)
    root.addChild("visual").addObject("OglModel", src=root.loader.getLinkPath(), translation=[1, 2, 3])
"""
    written(folder, {"scene.py": text})
    translation = translate(load_tree(folder / "scene.py"))
    assert not translation.refused
    translation.files.write(folder)
    (table,) = translation.tables["rigid_bodies"].values()
    points, _ = read_surface(str(folder / table["surface"]))
    assert points.mean(axis=0) == pytest.approx([6, 2, 3])
    assert table["follows"] == "base"
    assert not table["collides"]


def test_points_of_a_subset_are_those_of_the_body(folder: Path) -> None:
    lines = """
    part = node.addChild("part")
    part.addObject("MechanicalObject", name="dofs")
    part.addObject("SubsetMapping", indices=[{}])
"""
    written(folder, {"scene.py": BODY + SCENE + lines.format("3, 1")})
    tree = load_tree(folder / "scene.py")
    assert not translate(tree).refused
    body = tree.root.body
    assert np.array_equal(body.part.dofs.position.value, np.array(body.dofs.position.value)[[3, 1]])
    written(folder, {"scene.py": BODY + SCENE + lines.format("999")})
    tree = load_tree(folder / "scene.py")
    translate(tree)
    with pytest.raises(SceneError, match="names point 999; there are 112, from 0 on"):
        np.array(tree.root.body.part.dofs.position.value)
