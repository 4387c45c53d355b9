"""A scene's own controllers in a run: what they read is the present state, what they write takes effect as in SOFA."""

from pathlib import Path
from textwrap import dedent, indent
from typing import Any

import numpy as np
import pytest
from blocks import make_block
from scenes_of_sofa import Run

from taichisoft import Control, KeyEvent, write_volume_mesh
from taichisoft.errors import ControllerFailed, TaichisoftError
from taichisoft.mesh import boundary_triangles, write_stl

# A hollow block held at its left end, with a chamber and a cable, and a cube far away from it.
SCENE = """
import Sofa.Core

class Mine(Sofa.Core.Controller):
    def __init__(self, root):
        super().__init__()
        self.root = root
        self.body = root.body
        self.log = []
{methods}

def createScene(root):
    root.gravity = [0, 0, 0]
    root.dt = 0.01
    collisions(root)
    node = body(root)
    node.addObject("BoxROI", name="roi", box=[-31, -100, -100, -29, 100, 100])
    node.addObject("RestShapeSpringsForceField", points="@roi.indices", stiffness=1e12)
    chamber = node.addChild("chamber")
    chamber.addObject("MeshSTLLoader", name="loader", filename="chamber.stl")
    chamber.addObject("MeshTopology", src="@loader", name="topo")
    chamber.addObject("MechanicalObject", name="walls")
    chamber.addObject("SurfacePressureConstraint", name="air", value=0.01, valueType="{value_type}")
    chamber.addObject("BarycentricMapping")
    {more}
    cable = node.addChild("cable")
    cable.addObject("MechanicalObject", name="points", position=[[-20, 0, 14], [20, 0, 14]])
    cable.addObject("CableConstraint", name="tendon", indices=[0, 1], pullPoint=[-40, 0, 14], valueType="{cable_type}")
    cable.addObject("BarycentricMapping")
    cube = root.addChild("cube")
    cube.addObject("EulerImplicitSolver")
    cube.addObject("CGLinearSolver")
    cube.addObject("MechanicalObject", name="frame", template="Rigid3", position=[0, 0, 300, 0, 0, 0, 1])
    cube.addObject("UniformMass", totalMass=0.01)
    cube.addObject("UncoupledConstraintCorrection")
    surface(cube, "mesh/cube.obj", mapping="RigidMapping")
    root.addObject(Mine(root))
"""


class KeyRun(Run):
    """A run of a block with a cavity and a cable, which a controller with these methods steers, with keys."""

    def __init__(
        self,
        folder: Path,
        methods: str,
        value_type: str = "pressure",
        cable_type: str = "displacement",
        more: str = "",
    ):
        own = indent(dedent(methods), "    ")
        scene = SCENE.format(methods=own, value_type=value_type, cable_type=cable_type, more=more.strip())
        super().__init__(folder, scene)

    def steps(self, count: int = 1, *keys: str) -> Control:
        for number in range(count):
            for key in keys if number == 0 else ():
                self.controller.key(KeyEvent(key))
            control = self.controller.control(self.simulation.observe())
            self.simulation.step(control)
        return control

    @property
    def log(self) -> list[Any]:
        (mine,) = self.controller._tree.controllers
        return mine.log


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sofa: None) -> Path:
    monkeypatch.setenv("TAICHISOFT_CACHE", str(tmp_path / "cache"))
    block = make_block((6, 3, 3), (60.0, 30.0, 30.0), hollow=True)
    write_volume_mesh(block, tmp_path / "block.vtk")
    write_stl(block.nodes, block.surface_groups["cavity"], tmp_path / "chamber.stl")
    write_stl(block.nodes, boundary_triangles(block.elements), tmp_path / "block.stl")
    return tmp_path


def test_events_come_in_sofas_order(folder: Path) -> None:
    run = KeyRun(
        folder,
        """
        def onAnimateBeginEvent(self, event): self.log.append(("begin", event["dt"]))
        def onAnimateEndEvent(self, event): self.log.append(("end", event["dt"]))
        def onKeypressedEvent(self, event): self.log.append(event["key"])
        """,
    )
    run.steps(1, "a")
    run.steps(1, "+", "up")
    assert run.log == ["A", ("begin", 0.01), ("end", 0.01), "+", chr(19), ("begin", 0.01)]


def test_key_is_released_after_a_step(folder: Path) -> None:
    run = KeyRun(
        folder,
        """
        def onKeypressedEvent(self, event): self.log.append(("down", event["key"], event["isCtrlPressed"]))
        def onKeyreleasedEvent(self, event): self.log.append(("up", event["key"], event["isShiftPressed"]))
        """,
    )
    run.controller.key(KeyEvent("a", ctrl=True))
    run.steps(1, "B")
    assert run.log == [("down", "A", True), ("down", "B", False)]
    run.steps(1, "a")
    assert run.log[2:] == [("up", "A", False), ("up", "B", True), ("down", "A", False)]
    run.steps(2)
    assert run.log[5:] == [("up", "A", False)]


def test_written_positions_are_replaced_by_the_run(folder: Path) -> None:
    run = KeyRun(
        folder,
        """
        def onKeypressedEvent(self, event): self.body.dofs.position = self.body.dofs.position.value + 100
        def onAnimateEndEvent(self, event): self.log.append(self.body.dofs.position.value.copy())
        """,
    )
    run.steps()
    with pytest.warns(UserWarning, match=r"MechanicalObject '/body/dofs' .*writes to 'position', which has no effect"):
        run.steps(2, "+")
    read, state = run.log[-1], run.simulation.state
    run.steps()
    assert np.abs(read).max() < 50.0
    assert run.log[-1] == pytest.approx(state.position, abs=1e-12)


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ("self.body.removeObject(self.body.roi)", "the scene removes BoxROI '/body/roi'"),
        ("self.root.removeChild('cube')", "the scene removes node '/cube'"),
        ("self.body.addObject('UniformMass', name='more', totalMass=3)", "the scene adds UniformMass '/body/more'"),
        ("self.root.moveChild(self.body.cable)", "the scene removes node '/body/cable'"),
        ("self.body.cable.detachFromGraph()", "the scene removes node '/body/cable'"),
        ("self.body.EulerImplicitSolver.vdamping = 3", "the scene writes to 'vdamping'"),
        ("self.body.activated = False", "the scene writes to 'activated'"),
        ("self.root.dt = 0.02", "the scene writes to 'dt'"),
        ("self.body.gravity = [0, 0, 1]", "the scene writes to 'gravity'"),
    ],
)
def test_changes_of_the_tree_in_a_run_are_said_to_have_no_effect(folder: Path, change: str, line: str) -> None:
    run = KeyRun(folder, f"def onKeypressedEvent(self, event): {change}")
    run.steps()
    with pytest.warns(UserWarning) as warned:
        run.steps(1, "+")
    said = [str(one.message) for one in warned if line in str(one.message)]
    assert len(said) == 1
    assert said[0].endswith("which has no effect in a run")
    assert "scene.py, line " in said[0]


def test_controllers_and_what_is_only_shown_may_come_and_go(folder: Path) -> None:
    import warnings

    run = KeyRun(
        folder,
        """
        def onKeypressedEvent(self, event):
            self.root.addObject("VisualStyle")
            self.root.addChild("empty")
            self.root.removeObject(self)
        """,
    )
    run.steps()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run.steps(2, "+")
    assert run.controller._tree.controllers == []


def test_a_value_of_pressure_is_an_impulse_until_it_is_changed(folder: Path) -> None:
    run = KeyRun(folder, "def onKeypressedEvent(self, event): self.body.chamber.air.value = [0.05]")
    assert run.steps().pressure == {"body.chamber": pytest.approx(1.0)}
    assert run.steps(1, "+").pressure == {"body.chamber": pytest.approx(5.0)}
    assert run.simulation.observe().pressures["body.chamber"] == pytest.approx(5.0)


def test_a_value_of_volume_growth_is_a_volume(folder: Path) -> None:
    run = KeyRun(
        folder,
        "def onKeypressedEvent(self, event): self.body.chamber.air.value.value = [50]",
        value_type="volumeGrowth",
    )
    assert run.steps().volume_growth == {"body.chamber": pytest.approx(0.01)}
    assert run.steps(1, "+").volume_growth == {"body.chamber": pytest.approx(50.0)}


@pytest.mark.parametrize(
    ("kind", "attribute", "asked"), [("displacement", "cable_pull", 2.0), ("force", "cable_tension", 200.0)]
)
def test_a_value_of_a_cable_is_a_pull_or_an_impulse(folder: Path, kind: str, attribute: str, asked: float) -> None:
    run = KeyRun(folder, "def onKeypressedEvent(self, event): self.body.cable.tendon.value = [2]", cable_type=kind)
    assert getattr(run.steps(), attribute) == {"body.cable": 0.0}
    assert getattr(run.steps(1, "+"), attribute) == {"body.cable": pytest.approx(asked)}


def test_cable_variation_is_limited(folder: Path) -> None:
    """As in SOFA by the allowed variation every two steps, since it looks at the beginning of the last one."""
    run = KeyRun(
        folder,
        """
        def onKeypressedEvent(self, event):
            self.body.cable.tendon.maxDispVariation = 0.5
            self.body.cable.tendon.value = [2]
        """,
    )
    asked = [run.steps(1, *keys).cable_pull["body.cable"] for keys in (["+"], *[[]] * 8)]
    assert asked[:2] == [0.5, 0.5]
    np.testing.assert_allclose(asked[2:], [1.0, 1.0, 1.5, 1.5, 2.0, 2.0, 2.0], atol=0.05)  # of a step linearised


def test_a_pull_point_is_moved(folder: Path) -> None:
    run = KeyRun(folder, "def onKeypressedEvent(self, event): self.body.cable.tendon.pullPoint = [-41, 0, 14]")
    assert not run.steps().pull_points
    moved = run.steps(1, "+")
    assert moved.pull_points["body.cable"].tolist() == [-41.0, 0.0, 14.0]
    assert not run.steps().pull_points
    # The cable keeps its length, so that the block is drawn to the left.
    run.steps(60)
    (length,) = run.simulation.observe().cable_lengths.values()
    assert length == pytest.approx(run.simulation.model.cables.rest_value[0], abs=1e-6)


def test_rest_positions_are_followed_node_by_node(folder: Path) -> None:
    run = KeyRun(
        folder,
        """
        def onKeypressedEvent(self, event):
            with self.body.dofs.rest_position.writeable() as rest:
                rest[:, 0] += 0.5 * rest[:, 1]
        """,
    )
    assert not run.steps().anchor_positions
    control = run.steps(1, "up")
    nodes = make_block((6, 3, 3), (60.0, 30.0, 30.0), hollow=True).nodes
    held = np.flatnonzero(nodes[:, 0] == -30.0)
    sheared = nodes[held] + np.outer(0.5 * nodes[held, 1], [1.0, 0.0, 0.0])
    assert control.anchor_positions["body"] == pytest.approx(sheared)
    run.steps(150)
    assert run.simulation.state.position[held] == pytest.approx(sheared, abs=1e-3)


def test_gravity_is_changed(folder: Path) -> None:
    run = KeyRun(folder, "def onKeypressedEvent(self, event): self.root.gravity = [0, 0, -1000]")
    assert run.steps().gravity is None
    assert run.steps(1, "+").gravity.tolist() == [0.0, 0.0, -1000.0]
    assert run.simulation.state.rigid_velocity[0] == pytest.approx([0.0, 0.0, -10.0])


LAYER = """
    layer = node.addChild("layer")
    node.addObject("BoxROI", name="right", box=[0, -100, -100, 100, 100, 100], strict=False)
    layer.addObject("TetrahedronSetTopologyContainer", position="@../loader.position",
                    tetrahedra="@right.tetrahedraInROI")
    layer.addObject("TetrahedronFEMForceField", name="field", youngModulus=1000, poissonRatio={poisson})
"""
"""The right half of the body made stiffer by a force field of its own."""


def test_a_modulus_counts_from_reinit_on(folder: Path) -> None:
    run = KeyRun(
        folder,
        """
        def onKeypressedEvent(self, event):
            field = self.body.TetrahedronFEMForceField
            if event["key"] == "+":
                field.youngModulus = 600
            else:
                field.reinit()
        """,
    )
    assert not run.steps(1, "+").young_modulus
    assert run.simulation.state.young_modulus.tolist() == [500.0]
    assert run.steps(1, "up").young_modulus == {"body": 600.0}
    assert run.simulation.state.young_modulus.tolist() == [600.0]
    assert not run.steps(1, "up").young_modulus


def test_a_modulus_that_is_updated_in_each_step_needs_no_reinit(folder: Path) -> None:
    run = KeyRun(
        folder,
        """
        def onKeypressedEvent(self, event):
            field = self.body.TetrahedronFEMForceField
            field.updateStiffness = True
            field.youngModulus.value = field.youngModulus.value + 100.0
        """,
    )
    assert run.steps(1, "+").young_modulus == {"body": 600.0}
    assert run.steps(1, "+").young_modulus == {"body": 700.0}


def test_moduli_of_force_fields_add_up_where_they_overlap(folder: Path) -> None:
    run = KeyRun(
        folder,
        """
        def onKeypressedEvent(self, event):
            field = self.body.TetrahedronFEMForceField if event["key"] == "+" else self.body.layer.field
            field.youngModulus = 600
            field.reinit()
        """,
        more=LAYER.format(poisson=0.3),
    )
    names = run.simulation.model.material_names
    assert names == ("body", "body.regions.0")
    before = run.simulation.state.young_modulus
    stiff = names[int(before.argmax())]
    assert sorted(before) == [500.0, 1500.0]
    assert run.steps(1, "+").young_modulus == {name: 1600.0 if name == stiff else 600.0 for name in names}
    assert run.steps(1, "up").young_modulus == {stiff: pytest.approx(1200.0, rel=1e-15)}


@pytest.mark.parametrize(
    ("modulus", "poisson", "message"),
    [
        (600, 0.4, r"'/body/layer/field' .*changes Poisson's ratio where force fields of other ratios overlap"),
        ([1, 2], 0.3, r"'/body/layer/field' .*youngModulus has 2 numbers for \d+ tetrahedra"),
        ("range(1, count + 1)", 0.3, "makes tetrahedra of one stiffness differ"),
    ],
)
def test_moduli_that_no_native_material_can_have_end_the_run(
    folder: Path, modulus: Any, poisson: float, message: str
) -> None:
    run = KeyRun(
        folder,
        f"""
        def onKeypressedEvent(self, event):
            field = self.body.layer.field
            count = len(self.body.layer.TetrahedronSetTopologyContainer.tetrahedra)
            field.youngModulus = list({modulus}) if {not isinstance(modulus, int)} else {modulus}
            field.reinit()
        """,
        more=LAYER.format(poisson=poisson),
    )
    with pytest.raises(TaichisoftError, match=message) as failed:
        run.steps(1, "+")
    assert "\n" not in str(failed.value)


def test_controllers_read_the_present_state(folder: Path) -> None:
    run = KeyRun(
        folder,
        """
        def onAnimateBeginEvent(self, event):
            root, body = self.root, self.body
            air, tendon = body.chamber.air, body.cable.tendon
            self.log.append({
                "position": body.dofs.position.value, "velocity": body.dofs.velocity.value,
                "walls": body.chamber.walls.position.value, "points": body.cable.points.position.value,
                "frame": root.cube.frame.position.value, "time": root.time.value,
                "volume": air.cavityVolume.value, "growth": air.volumeGrowth.value, "pressure": air.pressure.value,
                "length": tendon.cableLength.value, "force": tendon.force.value,
                "displacement": tendon.displacement.value,
            })
        def onKeypressedEvent(self, event):
            self.body.cable.tendon.value = [1]
            self.body.chamber.air.value = [0.1]
            self.root.gravity = [0, 0, -1000]
        """,
    )
    run.steps(5, "+")
    state, observation = run.simulation.state, run.simulation.observe()
    run.steps()
    seen = run.log[-1]
    assert (seen["position"] == state.position).all()
    assert (seen["velocity"] == state.velocity).all()
    model = run.simulation.model
    rest = model.rest_position
    walls = run.controller._tree.root.body.chamber.walls.rest_position.value
    nearest = ((walls[:, None] - rest) ** 2).sum(axis=2).argmin(axis=1)
    assert seen["walls"] == pytest.approx(state.position[nearest], abs=1e-9)
    assert seen["points"].shape == (2, 3)
    length = np.linalg.norm(np.diff(np.vstack([[[-40, 0, 14]], seen["points"]]), axis=0), axis=1).sum()
    assert seen["length"] == pytest.approx(length)
    assert seen["displacement"] == pytest.approx(1.0, abs=1e-3)
    assert seen["force"] == pytest.approx(0.01 * observation.cable_tensions["body.cable"])
    assert abs(seen["force"]) > 0.1
    assert seen["frame"][0, :3] == pytest.approx(state.rigid_position[0])
    assert seen["frame"][0, 2] < 300.0
    assert seen["time"] == pytest.approx(0.05)
    assert seen["volume"] == observation.volumes["body.chamber"]
    assert seen["growth"] == pytest.approx(seen["volume"] - model.initial_state().actuator_value[0])
    assert seen["growth"] > 1.0
    assert seen["pressure"] == pytest.approx(0.1)


def test_values_have_the_shapes_that_they_have_in_sofa(folder: Path) -> None:
    """Young's modulus is a list of one for each element or one for all; the force of a cable is a number."""
    run = KeyRun(
        folder,
        """
        def onAnimateBeginEvent(self, event):
            field = self.body.TetrahedronFEMForceField
            self.log.append((field.youngModulus.value, field.poissonRatio.value, self.body.cable.tendon.force.value))
        """,
    )
    run.steps(2)
    young, poisson, force = run.log[-1]
    assert (young.tolist(), poisson.tolist()) == ([500.0], [0.3])
    assert isinstance(force, float)


def test_reading_force_of_a_state_is_refused(folder: Path) -> None:
    run = KeyRun(folder, "def onAnimateBeginEvent(self, event): self.log.append(self.body.dofs.force.value)")
    with pytest.raises(ControllerFailed, match=r"MechanicalObject '/body/dofs' .*: force is not known in a run"):
        run.steps()


def test_what_has_no_effect_is_said_once(folder: Path) -> None:
    run = KeyRun(folder, "def onKeypressedEvent(self, event): self.body.UniformMass.totalMass = 3")
    run.steps()
    with pytest.warns(
        UserWarning, match=r"UniformMass '/body/UniformMass' .*writes to 'totalMass', which has no effect"
    ):
        run.steps(1, "+")
    import warnings

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run.steps(1, "+")


def test_a_new_run_begins_with_the_scene_as_it_was(folder: Path) -> None:
    run = KeyRun(folder, "def onKeypressedEvent(self, event): self.body.chamber.air.value = [0.05]")
    run.steps(1, "+")
    run.controller.reset(run.simulation.model)
    assert run.steps().pressure == {"body.chamber": pytest.approx(1.0)}


def test_a_controller_that_fails_ends_the_run_with_its_line(folder: Path) -> None:
    run = KeyRun(folder, "def onKeypressedEvent(self, event): return 1 / 0")
    with pytest.raises(ControllerFailed, match=r"scene.py, line \d+: ZeroDivisionError: division by zero"):
        run.steps(1, "+")


def test_keyboard_scene_needs_terminal(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    assert KeyRun(folder, "def onKeypressedEvent(self, event): pass").controller.interactive
    assert not KeyRun(folder, "def onAnimateBeginEvent(self, event): pass").controller.interactive
    monkeypatch.setattr("sys.stdin.isatty", lambda: False, raising=False)
    assert not KeyRun(folder, "def onKeypressedEvent(self, event): pass").controller.interactive


# Points that are held to what a scene moves: the points of another object, and motions given in time.


GUIDED = """
    guide = root.addChild("guide")
    guide.addObject("EulerImplicitSolver", firstOrder=True)
    guide.addObject("CGLinearSolver")
    guide.addObject("MechanicalObject", name="points", position=[[30, 15, 15], [30, -15, 15], [30, 15, -15]])
    node.addObject("BoxROI", name="corner", box=[29, 14, 14, 31, 16, 16])
    node.addObject("RestShapeSpringsForceField", points="@corner.indices", stiffness=1e9,
                   external_rest_shape="@../guide/points", external_points=[{point}])
"""


def test_springs_hold_points_to_those_of_another_object(folder: Path) -> None:
    """What the scene writes to the other's position is where the springs pull: with stiff ones, where the point is.

    SOFA damps these springs, so that the distance shrinks by b / (b + h) in each step; b is 0.1 s here.
    """
    run = KeyRun(
        folder,
        """
        def onAnimateBeginEvent(self, event):
            self.root.guide.points.position = [[30, 15, 20], [0, 0, 0], [1, 1, 1]]
        """,
        more=GUIDED.format(point=0),
    )
    corner = np.flatnonzero((np.abs(run.simulation.state.position - [30, 15, 15]) < 1e-9).all(axis=1))
    run.steps(10)
    expected = 20.0 - 5.0 * (0.1 / 0.11) ** 10
    assert run.simulation.state.position[corner][0] == pytest.approx([30, 15, expected], abs=1e-3)


def test_springs_to_points_that_are_not_there_are_refused(folder: Path) -> None:
    with pytest.raises(Exception, match="external_points has 1 points, of 3 in /guide/points; 1 are needed"):
        KeyRun(folder, "pass", more=GUIDED.format(point=7))


def test_springs_lead_to_a_body_that_moves(folder: Path) -> None:
    """As in SOFA they pull one end only, to where the other is at the start of a step, with their damping.

    x1 = (a + (b / h) x0) / (1 + b / h) for stiff springs, with b = 0.1 s, and a cube at a that moves by 0.2 mm a step.
    """
    moving = """
    tool = root.addChild("tool")
    for kind in ("EulerImplicitSolver", "SparseLDLSolver", "LinearSolverConstraintCorrection"):
        tool.addObject(kind)
    tool.addObject("MechanicalObject", name="frame", template="Rigid3", position=[30, 15, 15, 0, 0, 0, 1],
                   velocity=[0, 0, 20, 0, 0, 0])
    tool.addObject("UniformMass", totalMass=0.01)
    node.addObject("BoxROI", name="corner", box=[29, 14, 14, 31, 16, 16])
    node.addObject("RestShapeSpringsForceField", points="@corner.indices", stiffness=1e9,
                   external_rest_shape="@../tool/frame", external_points=[0])
    """
    run = KeyRun(folder, "pass", more=moving)
    corner = np.flatnonzero((np.abs(run.simulation.state.position - [30, 15, 15]) < 1e-9).all(axis=1))
    height = 15.0
    for step in range(8):
        height = (15.0 + 0.2 * step + 10.0 * height) / 11.0
    run.steps(8)
    assert run.simulation.state.position[corner][0] == pytest.approx([30, 15, height], abs=1e-3)


@pytest.mark.parametrize("relative", [True, False])
def test_a_motion_in_time_is_linear_from_key_to_key(folder: Path, relative: bool) -> None:
    shifts = np.array([[0, 0, 0], [0, 0, 4], [0, 2, 4]]) + (0 if relative else np.array([30, -15, -15]))
    run = KeyRun(
        folder,
        "pass",
        more=f"""
    node.addObject("BoxROI", name="right", box=[29, -16, -16, 31, -14, -14])
    node.addObject("LinearMovementConstraint", indices="@right.indices", keyTimes=[0, 0.04, 0.08],
                   movements={shifts.tolist()}, relativeMovements={relative})
""",
    )
    right = (np.abs(run.simulation.state.position - [30, -15, -15]) < 1e-9).all(axis=1)
    start = run.simulation.state.position[right]
    for count, shift in ((1, [0, 0, 1]), (3, [0, 0, 4]), (2, [0, 1, 4]), (9, [0, 2, 4])):
        run.steps(count)
        assert run.simulation.state.position[right] == pytest.approx(start + shift, abs=1e-6)
