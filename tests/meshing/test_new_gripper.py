"""`taichisoft new gripper` writes a scene that is valid as it stands."""

from pathlib import Path
from typing import Any

import pytest
import solid_shapes

from taichisoft import Control, Simulation, load_scene, write_volume_mesh
from taichisoft.errors import MeshError
from taichisoft.scene import data_folder
from taichisoft_meshing.mesh_job import mesh_for_scene
from taichisoft_meshing.new_gripper import FingerElements, gripper, scene_text


def test_a_scene_with_so_many_fingers_around_a_cube_on_the_floor(tmp_path: Path) -> None:
    path = tmp_path / "four.toml"
    gripper(4, "tutorial", 70.0, output=path)
    scene = load_scene(path)
    assert list(scene.soft_bodies) == ["finger1", "finger2", "finger3", "finger4"]
    cube, floor = scene.rigid_bodies["cube"], scene.obstacles["floor"]
    assert floor.plane is not None and cube.box is not None
    assert cube.position[0] - cube.box[0] / 2.0 - floor.plane.point[0] == pytest.approx(scene.contact.contact_distance)
    assert all(body.regions for body in scene.soft_bodies.values())
    with pytest.raises(MeshError, match="exists already"):
        gripper(output=path)


@pytest.mark.parametrize("elements", list(FingerElements))
def test_elements_are_chosen_with_what_they_cost(tmp_path: Path, elements: FingerElements, capsys: Any) -> None:
    path = tmp_path / "three.toml"
    gripper(elements=elements, output=path)
    assert {body.element for body in load_scene(path).soft_bodies.values()} == {elements}
    assert f"{elements} elements: " in capsys.readouterr().out


@pytest.mark.parametrize(
    ("count", "finger", "opening", "problem"),
    [
        (0, "tutorial", 70.0, "--fingers 0: must be from 1 to 100"),
        (30, "tutorial", 70.0, "--opening 70: must be more than 96.1 mm for 30 fingers"),
        (3, "tutorial", 20.0, "--opening 20: must be more than"),
        (3, "tutorial", float("nan"), "--opening nan"),
        (3, "tendon", 70.0, "--finger tendon: has no chamber that pressure could fill"),
        (3, "own.stl", 70.0, "--finger own.stl: is a surface; first `taichisoft mesh --surfaces own.stl"),
        (3, "tutoral", 70.0, "did you mean 'tutorial'"),
    ],
)
def test_a_gripper_that_makes_no_sense_is_refused(count: int, finger: str, opening: float, problem: str) -> None:
    with pytest.raises(MeshError, match=problem):
        scene_text(count, finger, opening, FingerElements.LINEAR)


def draw(occ: Any) -> None:
    """A bar of 20 x 60 x 16 mm that ends at y = 100, with a chamber 4 mm below its upper side, z = 16."""
    bar, air = occ.addBox(0, 40, 0, 20, 60, 16), occ.addBox(4, 44, 8, 12, 50, 4)
    occ.cut([(3, bar)], [(3, air)])


def test_any_body_becomes_a_finger_that_bends_to_the_object(tmp_path: Path) -> None:
    """The bar hangs by its end at y = 100, and its thick side, z = 0, faces the axis: its tip goes there."""
    step = solid_shapes.write_step(tmp_path / "bar.step", draw)
    path = tmp_path / "scenes" / "gripper.toml"
    gripper(3, str(step), None, base="y=100", output=path)
    scene = load_scene(path)
    finger = scene.soft_bodies["finger1"]
    assert Path(finger.mesh.file).name == "bar.step"
    simulation = Simulation(scene)
    before = simulation.observe()
    (cavity,) = (name for name in before.volumes if name.startswith("finger1"))
    assert -60.0 <= before.tip_positions["finger1"][0] < -59.0
    report = simulation.step(Control(pressure={cavity: 5.0}))
    for _ in range(10):
        report = simulation.step(Control(pressure={cavity: 5.0}))
    axis = scene.rigid_bodies["cube"].position[1]
    assert before.tip_positions["finger1"][1] < report.observation.tip_positions["finger1"][1] < axis


@pytest.mark.parametrize(
    ("base", "problem"),
    [
        ("q=0", "--base q=0: must be an axis"),
        ("y=70", "has no flat face in y=70; its flat ends: x=0, x=20, y=40, y=100"),
    ],
)
def test_a_base_that_is_none_is_refused(base: str, problem: str, tmp_path: Path) -> None:
    step = solid_shapes.write_step(tmp_path / "bar.step", draw)
    with pytest.raises(MeshError, match=problem):
        scene_text(3, str(step), None, FingerElements.LINEAR, base, tmp_path)


def test_a_mesh_of_a_pneunet_finger_is_placed_as_the_finger_is(tmp_path: Path) -> None:
    mesh = mesh_for_scene(data_folder() / "fingers" / "tutorial.toml", preset="coarse")
    write_volume_mesh(mesh, tmp_path / "own.msh")
    gripper(3, str(tmp_path / "own.msh"), 70.0, output=tmp_path / "gripper.toml")
    finger = load_scene(tmp_path / "gripper.toml").soft_bodies["finger1"]
    assert finger.rotation == (0.0, 0.0, 0.0)
    assert finger.translation == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)
