"""Bodies in a circle: a pattern gives the bodies that a scene would otherwise list one by one."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from taichisoft import load_scene
from taichisoft.errors import SceneError
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft.scene import scene_from_dict, scene_from_toml, scene_to_toml

FINGER = {"mesh": "tutorial-coarse", "mass": 0.04, "young_modulus": 500.0, "poisson_ratio": 0.3}
CIRCLE = {"count": 3, "axis": "-x", "centre": [0.0, 70.0, 0.0]}


def placed(body: Any, points: np.ndarray) -> np.ndarray:
    return Rotation.from_euler("xyz", body.rotation, degrees=True).apply(points) + np.array(body.translation)


def test_a_pattern_of_three_is_the_shipped_gripper() -> None:
    shipped = load_scene("gripper").soft_bodies
    made = scene_from_dict({"soft_bodies": {"finger": {**FINGER, "pattern": CIRCLE}}}).soft_bodies
    assert list(made) == list(shipped)
    points = np.random.default_rng(0).uniform(-100.0, 100.0, (5, 3))
    for name, body in made.items():
        assert np.allclose(placed(body, points), placed(shipped[name], points), atol=1e-9)
    assert made["finger1"].rotation == made["finger1"].translation == (0.0, 0.0, 0.0)


def test_copies_turn_about_the_axis_with_their_rotation_place_and_velocity() -> None:
    """Turned back by k angle / count about the axis, copy k is the first."""
    pattern = {"count": 4, "axis": "y", "centre": [5.0, 0.0, -3.0], "angle": 120.0}
    ball = {"box": [1.0, 2.0, 3.0], "mass": 1e-5, "position": [40.0, 1.0, 0.0], "rotation": [10.0, 20.0, 30.0]}
    moving = {"velocity": [1.0, 2.0, 3.0], "angular_velocity": [0.1, 0.0, 0.2]}
    bodies = scene_from_dict({"rigid_bodies": {"b": {**ball, **moving, "pattern": pattern}}}).rigid_bodies
    first, centre = bodies["b1"], np.array(pattern["centre"])
    for number, body in enumerate(bodies.values()):
        back = Rotation.from_euler("y", -30.0 * number, degrees=True)
        assert np.allclose(back.apply(np.array(body.position) - centre) + centre, first.position)
        assert np.allclose(back.apply(body.velocity), first.velocity)
        assert np.allclose(back.apply(body.angular_velocity), first.angular_velocity)
        turned = back * Rotation.from_euler("xyz", body.rotation, degrees=True)
        assert (turned * Rotation.from_euler("xyz", first.rotation, degrees=True).inv()).magnitude() < 1e-9


def test_a_body_like_a_pattern_is_one_and_the_written_scene_has_the_copies() -> None:
    table = {**FINGER, "pattern": CIRCLE}
    scene = scene_from_dict({"soft_bodies": {"finger": table, "other": {"like": "finger", "mass": 0.05}}})
    assert list(scene.soft_bodies) == ["finger1", "finger2", "finger3", "other"]
    assert scene_from_toml(scene_to_toml(scene), "again") == scene
    more = load_scene(TINY_GRIPPER, ["rigid_bodies.cube.pattern={count=2, axis='z', centre=[0.0, 50.0, 0.0]}"])
    assert list(more.rigid_bodies) == ["cube1", "cube2"]
    assert more.rigid_bodies["cube2"].position == pytest.approx((0.0, 100.0, 5.2))


@pytest.mark.parametrize(
    ("pattern", "problem"),
    [
        ({"count": 0, "axis": "x"}, "soft_bodies.finger.pattern.count = 0"),
        ({"count": 2.5, "axis": "x"}, "soft_bodies.finger.pattern.count = 2.5"),
        ({"count": 3}, "soft_bodies.finger.pattern.axis: this key is missing"),
        ({"count": 3, "axis": "w"}, "soft_bodies.finger.pattern.axis = 'w'"),
        ({"count": 3, "axis": "x", "center": [0, 0, 0]}, "pattern.center: unknown key; did you mean 'centre'"),
        (5, "soft_bodies.finger.pattern"),
        ({"count": 2, "axis": "x", "centre": [float("nan"), 0.0, 0.0]}, "soft_bodies.finger.pattern.centre"),
    ],
)
def test_a_pattern_that_makes_no_sense_is_refused(pattern: Any, problem: str) -> None:
    with pytest.raises(SceneError, match=problem):
        scene_from_dict({"soft_bodies": {"finger": {**FINGER, "pattern": pattern}}})


def test_mistakes_beside_a_pattern_are_named() -> None:
    bodies = {"finger": {**FINGER, "pattern": CIRCLE}, "finger2": FINGER}
    with pytest.raises(SceneError, match="makes a body called 'finger2', which is there already"):
        scene_from_dict({"soft_bodies": bodies})
    with pytest.raises(SceneError, match=r"soft_bodies.finger1.translation = \[1\]"):
        scene_from_dict({"soft_bodies": {"finger": {**FINGER, "translation": [1], "pattern": CIRCLE}}})
