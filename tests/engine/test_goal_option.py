"""Goals of scenes, and another one from the command line."""

from typing import Any

import pytest

from taichisoft import load_scene
from taichisoft.errors import SceneError
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft.scene import scene_from_dict


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
def test_another_goal_is_of_same_object(goal: str | None, overrides: list[str], expected: dict[str, Any]) -> None:
    scene = load_scene("gripper", overrides, goal=goal)
    assert scene.goal is not None and scene.goal.object == "cube"
    assert {key: getattr(scene.goal, key) for key in expected} == expected


def test_goal_can_be_switched_off_and_given_to_scene_without_one() -> None:
    assert load_scene("gripper", goal="none").goal is None
    assert load_scene(TINY_GRIPPER).goal is None
    given = load_scene(TINY_GRIPPER, goal="held").goal
    assert given is not None and (given.object, given.kind) == ("cube", "held")


def test_goal_that_is_none_is_refused_with_those_that_are() -> None:
    with pytest.raises(SceneError, match=r"goal.kind = 'thrown': input should be 'held', 'placed', 'push"):
        load_scene("gripper", goal="thrown")


@pytest.mark.parametrize(
    ("keys", "problem"),
    [
        ({"kind": "placed"}, 'kind = "placed" needs position'),
        ({"kind": "lifted"}, 'kind = "lifted" needs height'),
        ({"height": 3.0}, 'height has no effect unless kind = "lifted"'),
    ],
)
def test_each_kind_has_its_key(keys: dict[str, Any], problem: str) -> None:
    scene = {"rigid_bodies": {"cube": {"box": [1.0] * 3, "mass": 1e-6}}, "goal": {"object": "cube"} | keys}
    with pytest.raises(SceneError, match=problem):
        scene_from_dict(scene)
