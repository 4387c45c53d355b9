"""Scenes from files: overrides, inheritance, goals, materials, patterns, files named, and the resolved scene."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from taichisoft import Scene, load_scene
from taichisoft.errors import SceneError
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft.scene import data_folder, scene_from_dict, scene_from_toml, scene_to_toml

SHIPPED = sorted(path.stem for path in (data_folder() / "scenes").glob("*.toml"))
BODY = {"mesh": "tutorial-coarse", "mass": 0.04, "young_modulus": 500.0, "poisson_ratio": 0.3}
FINGER = """
[soft_bodies.finger]
mesh = "tutorial-coarse"
mass = 0.04
young_modulus = 500.0
poisson_ratio = 0.3
anchors = [{ group = "base" }]
"""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "scene.toml"
    path.write_text(FINGER)
    return path


def soft(folder: Path | None = None, other: dict[str, Any] | None = None, **body: Any) -> Scene:
    """A finger with these keys, and another one like it."""
    bodies: dict[str, Any] = {"finger": {"mesh": "tutorial-coarse", **body}}
    return scene_from_dict(
        {"soft_bodies": bodies | ({} if other is None else {"other": {"like": "finger", **other}})}, folder=folder
    )


def test_overrides_reach_lists_absent_tables_and_text(path: Path) -> None:
    anchors = "soft_bodies.finger.anchors.0.stiffness=5e3"
    scene = load_scene(path, [anchors, "contact.friction = 0.25", "title=two words", "time.step=0.005"])
    assert scene.soft_bodies["finger"].anchors[0].stiffness == 5e3
    assert (scene.contact.friction, scene.title, scene.time.step) == (0.25, "two words", 0.005)


def test_like_takes_what_a_body_leaves_out(path: Path) -> None:
    path.write_text(FINGER + '[soft_bodies.second]\nlike = "finger"\nyoung_modulus = 300.0\n')
    first, second = load_scene(path, ["soft_bodies.finger.poisson_ratio=0.4"]).soft_bodies.values()
    assert second == first.model_copy(update={"young_modulus": 300.0})
    assert second.poisson_ratio == 0.4


def test_files_beside_the_scene_come_first(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    shipped = data_folder() / "meshes" / "tutorial-coarse.msh"
    places = [folder / "tutorial-coarse.msh" for folder in (tmp_path, elsewhere)]
    for place in places:
        place.touch()
    for place in (*places, shipped):
        assert load_scene(path).soft_bodies["finger"].mesh.file == str(place)
        if place != shipped:
            place.unlink()


@pytest.mark.parametrize("name", SHIPPED)
def test_resolved_scene_reads_back_equal(name: str, tmp_path: Path) -> None:
    scene = load_scene(name)
    resolved = tmp_path / "resolved.toml"
    resolved.write_text(scene_to_toml(scene), encoding="utf-8")
    assert load_scene(resolved) == scene
    text = resolved.read_text(encoding="utf-8")
    for default in ("max_iterations = 1000", "alarm_distance = 5.0", 'corotation = "polar"', "stiffness = 1"):
        assert default in text  # a later version with other defaults must give the same run


def test_defaults_and_inherited_keys_are_written() -> None:
    twin = {"like": "finger", "translation": [0, 100, 0], "anchors": [{"box": [[0, 0, -20], [0, 30, 20]]}]}
    floor = {"plane": {"point": [0, 0, 0], "normal": [0, 0, 1]}, "colour": "#C80000"}
    document = {
        "soft_bodies": {"finger": {**BODY, "cavities": {"air": {"group": "cavity"}}}, "twin": twin},
        "appearance": {"background": "#102030", "frame": False},
        "obstacles": {"floor": floor},
    }
    scene = scene_from_dict(document)
    assert scene.soft_bodies["twin"].young_modulus == 500
    assert scene_from_toml(scene_to_toml(scene), "written") == scene


# Goals from the command line.


@pytest.mark.parametrize(
    ("goal", "overrides", "expected"),
    [
        (None, [], {"kind": "held", "tolerance": 1.0}),
        ("held", ["goal.tolerance=2.0"], {"kind": "held", "tolerance": 2.0}),
        ("lifted", ["goal.height=20.0"], {"kind": "lifted", "height": 20.0}),
        ("placed", ["goal.position=[0.0, 1.0, 2.0]"], {"kind": "placed", "position": (0.0, 1.0, 2.0)}),
        ("pushed", [], {"kind": "pushed", "hold": 2.0}),
    ],
)
def test_another_goal_is_of_the_same_object(goal: str | None, overrides: list[str], expected: dict[str, Any]) -> None:
    scene = load_scene("gripper", overrides, goal=goal)
    assert scene.goal is not None and scene.goal.object == "cube"
    assert {key: getattr(scene.goal, key) for key in expected} == expected


def test_goal_is_switched_off_and_added() -> None:
    assert load_scene("gripper", goal="none").goal is None
    assert load_scene(TINY_GRIPPER).goal is None
    given = load_scene(TINY_GRIPPER, goal="held").goal
    assert given is not None and (given.object, given.kind) == ("cube", "held")


# Elements, laws and materials.

RUBBER = """
name = "My rubber"
law = "yeoh"
coefficients = { c10 = 20.0, c20 = 1.5 }
poisson_ratio = 0.49
density = 1.1e-6
highest_stretch = 2.5
source = "measured by me"
"""
REGION = {"box": [[0, 0, 0], [1, 1, 1]]}


def test_default_element_is_smoothed() -> None:
    keys = {"young_modulus": 1.0, "mass": 1.0, "poisson_ratio": 0.4}
    assert soft(**keys).soft_bodies["finger"].element == "smoothed"
    sofas = soft(**keys, element="linear", corotation="edges").soft_bodies["finger"]
    assert (sofas.element, sofas.corotation) == ("linear", "edges")


def test_modulus_at_rest_follows_from_coefficients() -> None:
    """E = 2 (1 + nu) mu, with mu = 2 (c10 + c01), and half the sum of mu alpha; a region takes the body's ratio."""
    region = {**REGION, "law": "ogden", "coefficients": {"mu1": 20.0, "alpha1": 3.0}}
    law = {"law": "mooney-rivlin", "coefficients": {"c10": 10.0, "c01": 5.0}}
    made = soft(**law, mass=1.0, poisson_ratio=0.4, regions=[region])
    assert made.young_moduli == pytest.approx({"finger": 2 * 1.4 * 30.0, "finger.regions.0": 2 * 1.4 * 30.0})


def test_material_gives_what_the_body_does_not(tmp_path: Path) -> None:
    """At rest E = 2 (1 + nu) 2 c10 = 119.2 kPa; the body's own density or Poisson's ratio wins."""
    (tmp_path / "mine.toml").write_text(RUBBER)
    first = soft(tmp_path, material="mine.toml")
    body = first.soft_bodies["finger"]
    assert body.young_moduli == pytest.approx([119.2])
    assert (body.law, body.coefficients) == ("yeoh", {"c10": 20.0, "c20": 1.5})
    assert (body.poisson_ratio, body.density, body.mass) == (0.49, 1.1e-6, None)
    assert body.material is not None and body.material.coefficients == {"c10": 20.0, "c20": 1.5}
    own = soft(tmp_path, material="mine", poisson_ratio=0.4, mass=0.05).soft_bodies["finger"]
    assert (own.poisson_ratio, own.density, own.mass) == (0.4, None, 0.05)
    (tmp_path / "mine.toml").unlink()  # a recording is continued where the file is not
    assert scene_from_toml(scene_to_toml(first), "recorded") == first
    (tmp_path / "mine.toml").write_text(RUBBER.replace('law = "yeoh"', 'law = "gent"'))
    with pytest.raises(SceneError, match=r"mine\.toml: law: input should be 'hooke', 'neo-hookean'"):
        soft(tmp_path, material="mine.toml")


def test_regions_and_bodies_like_another_have_own_materials() -> None:
    """Or a Young's modulus of their own instead of one."""
    body = soft(material="ecoflex-00-30", regions=[{**REGION, "material": "dragon-skin-30"}]).soft_bodies["finger"]
    assert body.young_moduli[1] > 5.0 * body.young_moduli[0]
    assert body.regions[0].poisson_ratio == 0.499
    bodies = soft(material="ecoflex-00-30", other={"material": "dragon-skin-30"}).soft_bodies
    assert bodies["other"].young_moduli[0] > 5.0 * bodies["finger"].young_moduli[0]
    own = {"young_modulus": 300.0, "poisson_ratio": 0.3, "density": 1e-6}
    by_hand = soft(material="ecoflex-00-30", other=own).soft_bodies["other"]
    assert (by_hand.young_modulus, by_hand.material) == (300.0, None)
    plain = soft(**own, other={"material": "dragon-skin-30"}).soft_bodies["other"]
    assert (plain.poisson_ratio, plain.density) == (0.499, 1.07e-6)


# Bodies in a circle.

CIRCLE = {"count": 3, "axis": "-x", "centre": [0.0, 70.0, 0.0]}


def placed(body: Any, points: np.ndarray) -> np.ndarray:
    return Rotation.from_euler("xyz", body.rotation, degrees=True).apply(points) + np.array(body.translation)


def test_pattern_of_three_is_the_shipped_gripper() -> None:
    shipped = load_scene("gripper").soft_bodies
    made = soft(**{**BODY, "pattern": CIRCLE}).soft_bodies
    assert list(made) == list(shipped)
    points = np.random.default_rng(0).uniform(-100.0, 100.0, (5, 3))
    for name, body in made.items():
        assert np.allclose(placed(body, points), placed(shipped[name], points), atol=1e-9)
    assert made["finger1"].rotation == made["finger1"].translation == (0.0, 0.0, 0.0)


def test_copies_turn_with_rotation_place_and_velocity() -> None:
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


def test_body_like_a_pattern_is_one() -> None:
    """And the resolved scene has the copies."""
    scene = soft(**{**BODY, "pattern": CIRCLE}, other={"mass": 0.05})
    assert list(scene.soft_bodies) == ["finger1", "finger2", "finger3", "other"]
    assert scene_from_toml(scene_to_toml(scene), "again") == scene
    more = load_scene(TINY_GRIPPER, ["rigid_bodies.cube.pattern={count=2, axis='z', centre=[0.0, 50.0, 0.0]}"])
    assert list(more.rigid_bodies) == ["cube1", "cube2"]
    assert more.rigid_bodies["cube2"].position == pytest.approx((0.0, 100.0, 5.2))
