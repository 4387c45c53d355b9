"""Collision spheres of rigid bodies, points, soft bodies and what stands still."""

from pathlib import Path

import numpy as np
import pytest
from scenes_of_sofa import BODY, loaded, written
from test_translation import folder as folder

from taichisoft import Simulation, load_scene, make_controller
from taichisoft.mesh import read_surface
from taichisoft_sofa.translation.parts import Translation
from taichisoft_sofa.translation.translate import translate


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


def test_a_point_with_a_sphere_is_a_ball_that_comes_to_rest_on_another(
    folder: Path, monkeypatch: pytest.MonkeyPatch, sofa: None
) -> None:
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
def test_a_goal_without_mass_is_left_out_whatever_the_dynamics_of_its_solver(folder: Path, template: str) -> None:
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
