"""Joints, the frames that they turn, rigid parts of soft bodies, and bodies that follow frames."""

from pathlib import Path

import numpy as np
import pytest
from blocks import make_block
from scenes_of_sofa import BODY, Run, loaded, written
from scipy.spatial.transform import Rotation

from taichisoft import Simulation, load_scene, make_controller, write_volume_mesh
from taichisoft.errors import SceneError
from taichisoft.mesh import boundary_triangles, read_surface, write_stl
from taichisoft_sofa.components.states import FramePoses, composed, relative, start_values
from taichisoft_sofa.controller.sofa_controller import SofaController
from taichisoft_sofa.loading import load_tree
from taichisoft_sofa.translation.translate import translate

TURN, STEP, LAG = 0.5, 0.01, 0.05

# A servo whose wheel (frame 1) turns about y, and a block whose points are shared out among frames and a free part.
SCENE = """
import numpy as np

def servo(root, spring=1e9, mass=0.01, rest=0.0):
    servo = root.addChild("servo")
    base = servo.addChild("base")
    base.addObject("MechanicalObject", name="dofs", template="Rigid3", translation=[-30, 0, 0], rotation=[0, 0, 90])
    base.addObject("FixedProjectiveConstraint", indices=0)
    base.addObject("UniformMass", totalMass=0.01)
    joint = servo.addChild("joint")
    joint.addObject("MechanicalObject", name="dofs", template="Vec1", position=[[0]], rest_position=[[rest]])
    joint.addObject("RestShapeSpringsForceField", points=0, stiffness=spring)
    joint.addObject("UniformMass", totalMass=mass)
    wheel = joint.addChild("wheel")
    wheel.addObject("MechanicalObject", name="dofs", template="Rigid3", position=[[0, 0, 0, 0, 0, 0, 1]] * 2)
    wheel.addObject("ArticulatedSystemMapping", input1="@../dofs", input2="@../../base/dofs", output="@./")
    centre = joint.addChild("centre")
    centre.addObject("ArticulationCenter", parentIndex=0, childIndex=1)
    centre.addChild("axes").addObject("Articulation", rotation=True, rotationAxis=[1, 0, 0], articulationIndex=0)
    joint.addObject("ArticulatedHierarchyContainer")
    return wheel

def rigidified(root, node, groups, frames):
    points = np.array(node.loader.position.value)
    rigid = [i for group in groups for i in group]
    free = [i for i in range(len(points)) if i not in rigid]
    parts = root.addChild("parts")
    soft = parts.addChild("soft")
    soft.addObject("MechanicalObject", name="dofs", position=points[free])
    stiff = parts.addChild("stiff")
    stiff.addObject("MechanicalObject", name="dofs", template="Rigid3", position=frames)
    carried = stiff.addChild("carried")
    carried.addObject("MechanicalObject", name="dofs", position=points[rigid])
    which = [number for number, group in enumerate(groups) for _ in group]
    carried.addObject("RigidMapping", globalToLocalCoords=True, rigidIndexPerPoint=which)
    pairs = [[0, free.index(i)] if i in free else [1, rigid.index(i)] for i in range(len(points))]
    node.addObject("SubsetMultiMapping", input=[soft.dofs.linkpath, carried.dofs.linkpath],
                   output=node.dofs.linkpath, indexPairs=pairs)
    for name in ("EulerImplicitSolver", "SparseLDLSolver"):
        node.removeObject(name)
    soft.addChild(node)
    carried.addChild(node)
    return stiff

def ends(node):
    x = np.array(node.loader.position.value)[:, 0]
    return [np.flatnonzero(x < -19).tolist(), np.flatnonzero(x > 19).tolist()]

def createScene(root):
    free_motion(root)
    root.dt = 0.01
    root.addObject("EulerImplicitSolver", rayleighStiffness=0.05)
    root.addObject("SparseLDLSolver")
    root.addObject("GenericConstraintCorrection")
    node = body(root, correction=False)
"""
SERVO = SCENE.partition("def createScene")[0]

DRIVEN = """
    root.gravity = [0, 0, 0]
    wheel = servo(root, rest=0.5)
    left, _ = ends(node)
    stiff = rigidified(root, node, [left], [[0, 0, 0, 0, 0, 0, 1]])
    wheel.addChild(stiff)
    stiff.addObject("SubsetMultiMapping", input=[wheel.linkpath], output="@./", indexPairs=[0, 1])
"""
FREE = """
    root.gravity = [0, 0, -9810]
    left, right = ends(node)
    stiff = rigidified(root, node, [left, right], [[-30, 0, 0, 0, 0, 0, 1], [25, 0, 0, 0, 0, 0, 1]])
    {held}
"""
HELD = 'stiff.addObject("FixedProjectiveConstraint", indices=[0])'

HELD_BY_SPRINGS = 'stiff.addObject("RestShapeSpringsForceField", points=[0, 1], stiffness=1e9, angularStiffness=1e9)'


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sofa: None) -> Path:
    monkeypatch.setenv("TAICHISOFT_CACHE", str(tmp_path / "cache"))
    write_volume_mesh(make_block((6, 3, 3), (60.0, 30.0, 30.0)), tmp_path / "block.vtk")
    return tmp_path


def started(folder: Path, lines: str, scene: str = SCENE) -> Run:
    """A run of a scene that ends with these lines."""
    return Run(folder, scene + lines)


def test_a_joint_follows_its_rest_angle_as_implicit_euler_does(folder: Path) -> None:
    """Without mass the error of the angle shrinks by b / (b + h) in each step, with Rayleigh's b by stiffness."""
    run = started(folder, DRIVEN.replace("servo(root, rest=0.5)", "servo(root, rest=0.5, mass=1e-9)"))
    angles = []
    for _ in range(5):
        run.steps(1)
        angles.append(run.controller._values and float(run.root.servo.joint.dofs.rest_position.value[0][0]))
    run.steps(1)
    angle = float(run.root.servo.joint.dofs.position.value[0][0])
    assert angle == pytest.approx(TURN * (1.0 - (LAG / (LAG + STEP)) ** 6), rel=1e-9)
    assert angles == [TURN] * 5


def test_joint_constraint_imposes_its_angle(folder: Path) -> None:
    """At the end of every step, whatever the springs of the angle are, or without any."""
    for lines in ("", "    root.servo.joint.removeObject('RestShapeSpringsForceField')\n"):
        lines += "    root.servo.joint.addObject('JointConstraint', name='motor', value=0.3)\n"
        run = started(folder, DRIVEN + lines)
        for angle in (0.3, 0.7):
            run.root.servo.joint.motor.value = angle
            run.steps(2)
            assert run.root.servo.joint.dofs.position.value[0][0] == pytest.approx(angle, abs=1e-12)


def test_a_body_on_a_wheel_turns_with_it(folder: Path) -> None:
    """Without weight the block at rest is the block at the start, turned about the wheel's axis through its centre.

    The base is turned by 90 degrees about z, so its x axis, about which the wheel turns, is the y axis of space.
    """
    run = started(folder, DRIVEN)
    position = run.steps(250)
    centre = np.array([-30.0, 0.0, 0.0])
    turned = Rotation.from_rotvec([0.0, TURN, 0.0]).apply(run.start - centre) + centre
    assert np.abs(turned - run.start).max() > 20.0
    assert position == pytest.approx(turned, abs=1e-3)
    wheel = run.root.servo.joint.wheel.dofs.position.value
    assert wheel[0] == pytest.approx([-30, 0, 0, 0, 0, np.sqrt(0.5), np.sqrt(0.5)])
    assert wheel[1, :3] == pytest.approx(centre)
    # SOFA's base can be moved by a controller though it is fixed; what stands on it follows at once.
    run.root.servo.base.dofs.position = [[-30, 7, 0, 0, 0, np.sqrt(0.5), np.sqrt(0.5)]]
    left = run.start[:, 0] < -29
    assert run.steps(1)[left] == pytest.approx(turned[left] + [0, 7, 0], abs=1e-3)


def test_rigid_parts_keep_shape_or_place(folder: Path) -> None:
    run = started(folder, FREE.format(held=HELD))
    left, right = run.start[:, 0] < -19, run.start[:, 0] > 19
    position = run.steps(60)
    assert position[left] == pytest.approx(run.start[left], abs=1e-6)
    shift = np.abs(position[right] - run.start[right]).max()
    assert shift > 0.1
    pairs = [
        [points[i] - points[j] for i in range(9) for j in range(i)] for points in (run.start[right], position[right])
    ]
    lengths, now = (np.linalg.norm(pair, axis=1) for pair in pairs)
    assert np.abs(now - lengths).max() < 2e-4 * shift


def test_a_free_rigid_part_falls_as_everything_does(folder: Path) -> None:
    """Implicit Euler falls by g h^2 n (n + 1) / 2 in n steps."""
    run = started(folder, FREE.format(held="root.EulerImplicitSolver.rayleighStiffness = 0"))
    fallen = run.steps(10) - run.start
    assert fallen == pytest.approx(np.tile([0.0, 0.0, -9810.0 * STEP**2 * 55.0], (len(fallen), 1)), rel=1e-5, abs=1e-5)


def test_joints_of_a_chain_turn_and_shift_what_comes_after_them(tmp_path: Path) -> None:
    tree = loaded(
        tmp_path,
        """
        root.addObject("MechanicalObject", name="angles", template="Vec1", position=[[0.3], [7.0], [-0.8]])
        arm = root.addChild("arm")
        arm.addObject("MechanicalObject", name="dofs", template="Rigid3", position=[[1, 2, 3, 0, 0, 0, 1]] * 3)
        arm.addObject("ArticulatedSystemMapping", input1="@../angles")
        root.addObject("ArticulatedHierarchyContainer")
        first = root.addChild("first")
        first.addObject("ArticulationCenter", parentIndex=0, childIndex=1, posOnParent=[9, 0, 0], posOnChild=[-5, 0, 0])
        first.addObject("Articulation", rotation=True, rotationAxis=[0, 0, 1], articulationIndex=0)
        first.addObject("Articulation", translation=True, rotationAxis=[1, 0, 0], articulationIndex=1)
        second = root.addChild("second")
        second.addObject("ArticulationCenter", parentIndex=1, childIndex=2, posOnParent=[5, 0, 0])
        second.addObject("Articulation", rotation=True, rotationAxis=[0, 2, 0], articulationIndex=2)
        """,
    )
    poses = FramePoses(start_values).of(tree.root.arm.dofs)
    first = Rotation.from_rotvec([0, 0, 0.3])
    middle = np.array([10, 2, 3]) + first.apply([7.0, 0, 0]) + first.apply([5, 0, 0])
    assert poses[1, :3] == pytest.approx(middle)
    assert poses[2, :3] == pytest.approx(middle + first.apply([5, 0, 0]))
    assert Rotation.from_quat(poses[2, 3:]).as_matrix() == pytest.approx(
        (first * Rotation.from_rotvec([0, -0.8, 0])).as_matrix()
    )
    points = np.random.default_rng(3).normal(size=(3, 3))
    assert composed(poses, relative(poses, points)) == pytest.approx(points)


@pytest.mark.parametrize(
    ("lines", "refusal"),
    [
        (
            "root.addChild('a').addObject('MechanicalObject', template='Vec1')",
            "template 'Vec1'; known are Vec3 and Rigid3, and Vec1 for",
        ),
        ("servo(root).getParents()[0].removeObject('RestShapeSpringsForceField')", "turns freely"),
        (FREE.format(held="stiff.addObject('UniformMass', totalMass=1)"), "gives mass to a frame of a soft body"),
        (
            "stiff = rigidified(root, node, [ends(node)[0][:3]], [[0, 0, 0, 0, 0, 0, 1]])",
            "frame 0 moves freely, and its 3 points fill no volume",
        ),
        (
            FREE.format(held=HELD_BY_SPRINGS.replace("1e9", "1e3")),
            "stiffness = 1000 on a frame that others follow; 1e+06 or more",
        ),
        (DRIVEN.replace("indexPairs=[0, 1]", "indexPairs=[0, 7]"), "names frame 7 of /servo/joint/wheel/dofs"),
        (DRIVEN.replace("indexPairs=[0, 1]", "indexPairs=[4, 1]"), "indexPairs must be pairs of one of 1 inputs"),
        (DRIVEN.replace("wheel.linkpath", "'@nowhere'"), "'@nowhere' leads to no MechanicalObject"),
    ],
)
def test_what_cannot_be_driven_is_refused_in_one_line(folder: Path, lines: str, refusal: str) -> None:
    from textwrap import dedent, indent

    own = indent(dedent(lines.strip("\n")), "    ")
    written(folder, {"scene.py": BODY + SCENE + own})
    from taichisoft_sofa.loading import load_tree

    refused = translate(load_tree(folder / "scene.py")).refused
    assert any(refusal in line for line in refused), refused


def test_controllers_read_where_the_parts_of_a_body_are(folder: Path) -> None:
    """The free frame of a falling body falls with it, and free points are where the body's are."""
    run = started(folder, FREE.format(held="root.EulerImplicitSolver.rayleighStiffness = 0"))
    run.steps(10)
    run.controller.control(run.simulation.observe())
    fall = -9810.0 * STEP**2 * 55.0
    frames = run.root.parts.stiff.dofs.position.value
    assert frames == pytest.approx(np.array([[-30, 0, fall, 0, 0, 0, 1], [25, 0, fall, 0, 0, 0, 1]]), abs=1e-4)
    free = np.abs(run.start[:, 0]) < 19
    assert run.root.parts.soft.dofs.position.value == pytest.approx(run.start[free] + [0, 0, fall], abs=1e-4)
    carried = run.root.parts.stiff.carried.dofs.position.value
    assert sorted(carried[:, 2]) == pytest.approx(sorted(run.start[~free, 2] + fall), abs=1e-4)


def test_writing_position_keeps_rest_position(folder: Path) -> None:
    """SOFA keeps it from the initialisation; the tutorials move a servo from there, step by step."""
    run = started(folder, DRIVEN)
    base = run.root.servo.base.dofs
    rest = base.rest_position.value.copy()
    for shift in (1.0, 2.0):
        base.position = rest + np.array([0, 0, shift, 0, 0, 0, 0])
        run.steps(1)
        assert base.rest_position.value == pytest.approx(rest)
    left = run.start[:, 0] < -29
    assert run.simulation.state.position[left].mean(axis=0)[2] == pytest.approx(2.0, abs=1e-6)


def test_constraint_forces_are_contact_impulses(folder: Path, tmp_path: Path) -> None:
    """The normal impulses of a body at rest on a floor balance its weight in a step, m g h."""
    written(
        folder,
        {
            "scene.py": BODY
            + """
def createScene(root):
    collisions(root, mu=0.5)
    root.gravity = [0, 0, -9810]
    root.dt = 0.01
    floor = root.addChild("floor")
    floor.addObject("MechanicalObject", template="Rigid3")
    surface(floor, "mesh/cube.obj", mapping="RigidMapping")
    ball = root.addChild("ball")
    ball.addObject("EulerImplicitSolver")
    ball.addObject("CGLinearSolver", threshold=1e-30)
    ball.addObject("MechanicalObject", name="point", position=[[0, 0, 3.9]])
    ball.addObject("UniformMass", totalMass=0.01)
    ball.addObject("SphereCollisionModel", radius=2)
    ball.addObject("UncoupledConstraintCorrection")
"""
        },
    )
    scene = load_scene(folder / "scene.py")
    simulation, controller = Simulation(scene), make_controller(scene)
    assert isinstance(controller, SofaController)
    controller.reset(simulation.model)
    for _ in range(50):
        simulation.step(controller.control(simulation.observe()))
    controller.control(simulation.observe())
    forces = controller._tree.root.GenericConstraintSolver.constraintForces.value.reshape(-1, 3)
    assert forces[:, 0].sum() == pytest.approx(0.01 * 9810.0 * 0.01, rel=1e-3)
    assert np.abs(forces[:, 1:]).max() < 1e-3


def test_frames_on_stiff_springs_follow_their_rest_poses(folder: Path) -> None:
    run = started(folder, FREE.format(held=HELD_BY_SPRINGS))
    run.steps(2)
    assert run.simulation.state.position == pytest.approx(run.start, abs=0.05)
    right = run.start[:, 0] > 19
    quarter = [0, 0, np.sin(0.1), np.cos(0.1)]
    run.root.parts.stiff.dofs.rest_position = [[-30, 0, 0, 0, 0, 0, 1], [25, 3, 0, *quarter]]
    position = run.steps(1)[right]
    turned = Rotation.from_quat(quarter).apply(run.start[right] - [25, 0, 0]) + np.array([25, 3, 0])
    assert position == pytest.approx(turned, abs=1e-6)


# Rigid bodies that frames, springs or the scene itself lead: servos without a soft body, mazes, tools.


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


def test_a_servo_alone_turns_the_ball_on_its_arm(folder: Path) -> None:
    """The scene has no soft body. The arm's ball is 20 mm from the axis and turns by the angle of the joint.

    The servo's base is turned by 90 degrees about z, so that the axis x of the joint points along y, and the arm's y
    along -x: the ball, whose centre of mass it is, moves in the plane of x and z.
    """
    servo = started(folder, ALONE.format(lag=0.0), SERVO)
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


def test_sprung_tray_follows_its_rest_pose(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It moves in overdamped dynamics beside a ball that does not, and lifts the ball by what the scene writes."""
    block = make_block((1, 1, 1), (60.0, 60.0, 30.0))
    write_stl(block.nodes, boundary_triangles(block.elements), folder / "block.stl")
    maze = started(folder, MAZE, SERVO)
    names = maze.simulation.model.body_names
    for number in range(20):
        maze.root.tray.dofs.rest_position = [[0, 0, 0.1 * number, 0, 0, 0, 1]]
        maze.steps(1)
    heights = maze.simulation.state.rigid_position[:, 2]
    assert heights[names.index("tray")] == pytest.approx(1.9, abs=1e-12)
    assert heights[names.index("ball")] == pytest.approx(15 + 1.9 + 4 + 1, abs=0.2)  # radius and contact distance


HELD_TOOL = """
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


def test_a_rigid_body_on_springs_gives_way_to_a_force(folder: Path) -> None:
    """By F / k = 100 mN / (200 mN/mm) at rest, from the rest pose that the scene writes."""
    tool = started(folder, HELD_TOOL.format(torque=0), SERVO)
    tool.root.tool.dofs.rest_position = [[1, 2, 8, 0, 0, 0, 1]]
    tool.steps(300)
    assert tool.simulation.state.rigid_position[0] == pytest.approx([1.5, 2, 8], abs=1e-6)


def test_torques_on_rigid_bodies_are_refused(folder: Path) -> None:
    written(folder, {"scene.py": BODY + SERVO + HELD_TOOL.format(torque=5)})
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


FRAMES = """
def createScene(root):
    root.dt = 0.01
    root.gravity = [0, 0, -1000]
    collisions(root, mu=0.0)
    node = root.addChild("balls")
    node.addObject("EulerImplicitSolver")
    node.addObject("CGLinearSolver", threshold=1e-30)
    poses = [[20 * i, 0, 9, 0, 0, 0, 1] for i in range(4)]
    node.addObject("MechanicalObject", name="dofs", template="Rigid3", position=poses)
    node.addObject("UniformMass", totalMass=0.04)
    node.addObject("FixedProjectiveConstraint", indices=[1])
    node.addObject("RestShapeSpringsForceField", points=[2], stiffness=50, angularStiffness=50)
    node.addObject("ConstantForceField", indices=[3], forces=[[20, 0, 10, 0, 0, 0]])
    node.addObject("UncoupledConstraintCorrection")
    spheres = node.addChild("spheres")
    places = [[0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 3]]
    spheres.addObject("MechanicalObject", name="points", position=places)
    spheres.addObject("SphereCollisionModel", radius=2)
    spheres.addObject("RigidMapping", rigidIndexPerPoint=[3, 2, 1, 0, 0])
    floor = root.addChild("floor")
    floor.addObject("MechanicalObject", name="dofs", template="Rigid3",
                    position=[[0, 0, -9, 0, 0, 0, 1], [0, 0, 0, 0, 0, 0, 1]])
    below = floor.addChild("below")
    below.addObject("MechanicalObject", position=[[0, 0, 0]])
    below.addObject("SphereCollisionModel", radius=4)
    below.addObject("RigidMapping", index=1)
"""


def test_each_frame_has_the_angular_stiffness_of_its_spring(folder: Path) -> None:
    """As in SOFA: springs without a number of their own have 100 mN mm."""
    for given, expected in (("[7, 9]", [7.0, 9.0]), ("[7]", [7.0, 100.0])):
        springs = f"points=[3, 2], stiffness=[5, 5], angularStiffness={given}"
        scene = FRAMES.replace("points=[2], stiffness=50, angularStiffness=50", springs)
        written(folder, {"scene.py": BODY + scene})
        bodies = translate(load_tree(folder / "scene.py")).tables["rigid_bodies"].values()
        found = {body["position"][0]: body["springs"]["angular_stiffness"] for body in bodies if "springs" in body}
        assert [found[60.0], found[40.0]] == expected


def test_frames_of_one_object_are_bodies(folder: Path) -> None:
    """One rests on a sphere, one is fixed, one hangs m g / k lower, one has the acceleration g + F / m."""
    run = Run(folder, FRAMES)
    count = 100
    run.steps(count)
    run.controller.control(run.simulation.observe())
    dofs = run.root.balls.dofs.position.value
    time = 0.01 * count
    assert dofs[0, :3] == pytest.approx([0, 0, 4 + 1 + 2], abs=0.05)
    assert dofs[1, :3] == pytest.approx([20, 0, 9])
    assert dofs[2, :3] == pytest.approx([40, 0, 9 - 0.01 * 1000 / 50], abs=0.02)
    moved = 0.5 * time * (time + 0.01)  # of implicit Euler
    assert dofs[3, :3] == pytest.approx([60 + 2000 * moved, 0, 9 + (1000 - 1000) * moved], abs=1e-6)
    points = run.root.balls.spheres.points.position.value
    assert points[:4] == pytest.approx(dofs[::-1, :3], abs=1e-9)
    assert np.linalg.norm(points[4] - points[3]) == pytest.approx(3.0)
    assert run.root.balls.dofs.velocity.value[3, 0] == pytest.approx(2000 * time)


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ('node.addObject("LinearMovementConstraint", keyTimes=[0], movements=[[0] * 6])', "moves one of 2 frames"),
        ('node.addObject("PlaneForceField")', "acts on 2 frames; give each a MechanicalObject"),
    ],
)
def test_frames_that_cannot_be_bodies_are_refused(folder: Path, lines: str, message: str) -> None:
    create = 'node = root.addChild("two")\n'
    create += 'node.addObject("MechanicalObject", template="Rigid3", position=[[0] * 6 + [1]] * 2)\n'
    assert message in " ".join(translate(loaded(folder, create + lines)).refused)


def test_sphere_in_the_node_of_a_frame_is_about_its_origin(folder: Path) -> None:
    create = """
    collisions(root)
    node = root.addChild("ball")
    for kind in ("EulerImplicitSolver", "CGLinearSolver", "UncoupledConstraintCorrection"):
        node.addObject(kind)
    node.addObject("MechanicalObject", template="Rigid3", position=[1, 2, 8, 0, 0, 0, 1])
    node.addObject("UniformMass", totalMass=0.01)
    node.addObject("SphereCollisionModel", radius=2)
    """
    (ball,) = translate(loaded(folder, create, BODY)).tables["rigid_bodies"].values()
    assert ball["sphere"] == {"radius": 2.0}
    assert ball["position"] == [1.0, 2.0, 8.0]


PLACED = """
import Sofa

class Lift(Sofa.Core.Controller):
    def onAnimateBeginEvent(self, event):
        self.dofs.position = self.dofs.position.value + [[0] * 7, [0, 0, 2, 0, 0, 0, 0]]

def createScene(root):
    root.dt = 0.01
    collisions(root)
    jaws = root.addChild("jaws")
    jaws.addObject("EulerImplicitSolver")
    jaws.addObject("CGLinearSolver")
    poses = [[20 * i, 0, 0, 0, 0, 0, 1] for i in range(2)]
    jaws.addObject("MechanicalObject", name="dofs", template="Rigid3", position=poses)
    jaws.addObject("UncoupledConstraintCorrection")
    for index in range(2):
        skin = surface(jaws, "mesh/cube.obj", name=f"skin{index}", mapping="RigidMapping")
        skin.getObject("RigidMapping").index = index
    root.addObject(Lift()).dofs = jaws.dofs
"""


def test_points_on_placed_frames_are_read(folder: Path) -> None:
    run = Run(folder, PLACED)
    run.steps(3)
    run.controller._values.observe(run.simulation.observe())
    assert run.simulation.state.rigid_position == pytest.approx(np.array([[0, 0, 0], [20, 0, 6]]), abs=1e-9)
    points = [run.root.jaws[f"skin{index}"].MechanicalObject.position.value for index in range(2)]
    assert points[1] == pytest.approx(points[0] + [20, 0, 6], abs=1e-9)
