"""`taichisoft new gripper` writes a scene that is valid as it stands."""

from pathlib import Path
from typing import Any

import pytest

from taichisoft import load_scene
from taichisoft.errors import MeshError
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
        (3, "tendon", 70.0, "--finger tendon: kind = 'tendon_finger': must be pneunet_finger"),
        (3, "tutoral", 70.0, "did you mean 'tutorial'"),
    ],
)
def test_a_gripper_that_makes_no_sense_is_refused(count: int, finger: str, opening: float, problem: str) -> None:
    with pytest.raises(MeshError, match=problem):
        scene_text(count, finger, opening, FingerElements.LINEAR)
