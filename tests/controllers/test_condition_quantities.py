"""What conditions can ask about: each quantity from a made-up observation, and all of them from the real gripper."""

from typing import Any

import numpy as np
import pytest
from made_up import made_up_model

from taichisoft import Observation, Simulation, load_scene
from taichisoft.errors import SceneError
from taichisoft_controllers.model_names import pairs_called
from taichisoft_controllers.step_in_progress import QUANTITIES, Quantity, bind_quantity

OBSERVATION = Observation(
    time=1.5,
    step=150,
    pressures={"left.base": 10.0, "left.tip": 20.0, "right.base": 60.0},
    volumes={"left.base": 100.0, "left.tip": 200.0, "right.base": 600.0},
    flows={"left.base": -1.0, "left.tip": 2.0, "right.base": 6.0},
    cable_pulls={"left.tendon": 3.0, "right.tendon": 5.0},
    cable_tensions={"left.tendon": 300.0, "right.tendon": 500.0},
    cable_lengths={"left.tendon": 87.0, "right.tendon": 85.0},
    tip_velocities={"left": np.array([3.0, 4.0, 0.0]), "right": np.array([0.0, 0.0, -2.0])},
    bending_angles={"left": np.pi / 6, "right": np.pi / 2},
    base_translation=np.array([2.0, -3.0, 6.0]),
    base_rotation=np.array([0.0, -np.pi / 4, 0.0]),
    frame_translations={"jaw": np.zeros(3), "lid": np.array([3.0, 0.0, 4.0])},
    frame_forces={"jaw": np.array([3.0, 0.0, 4.0]), "lid": np.zeros(3)},
    frame_angles={"lid": -np.pi / 2},
    frame_moments={"lid": -7.0},
    object_positions={"cube": np.array([12.0, 1.0, 1.0]), "ball": np.array([7.0, 0.0, 0.0])},
    object_velocities={"cube": np.array([0.0, 6.0, 8.0]), "ball": np.zeros(3)},
    contact_counts={("left", "cube"): 3, ("mat", "cube"): 1, ("right", "ball"): 5, ("cube", "floor"): 7},
    normal_forces={
        ("left", "cube"): 30.0,
        ("mat", "cube"): 5.0,
        ("right", "ball"): 70.0,
        ("cube", "floor"): 900.0,
        ("left", "floor"): 800.0,
    },
    friction_forces={("left", "cube"): 3.0, ("mat", "cube"): 0.5, ("right", "ball"): 7.0, ("cube", "floor"): 90.0},
    slip_speeds={("left", "cube"): 0.3, ("mat", "cube"): 0.4, ("right", "ball"): 0.7, ("cube", "floor"): 9.0},
)


def measure(name: str, key: str | None = None, cubes: tuple[str, ...] = ("cube", "ball"), goal: bool = True) -> float:
    cables: dict[str, dict[str, Any]] = {"left.tendon": {}, "right.tendon": {}}
    frames = {"jaw": {}, "lid": {"hinge": {"axis": [1.0, 0.0, 0.0]}}}
    model = made_up_model(cubes=cubes, cables=cables, frames=frames, goal={"object": "cube"} if goal else None)
    return bind_quantity(Quantity(name, key), model)(OBSERVATION, 0.25)


@pytest.mark.parametrize(
    ("name", "key", "expected"),
    [
        ("time", None, 1.5),
        ("elapsed", None, 0.25),
        ("contact_force", None, 35.0),  # of the soft bodies on the goal's object: neither the floor nor the ball
        ("contact_force", "left|cube", 30.0),
        ("contact_force", "cube|left", 30.0),  # whichever way round
        ("contact_force", "cube|floor", 900.0),
        ("contact_force", "right|cube", 0.0),  # too far apart to be observed
        ("normal_force", "left|floor", 800.0),
        ("normal_force", None, 35.0),
        ("friction_force", None, 3.5),
        ("friction_force", "right|ball", 7.0),
        ("slip_speed", None, 0.4),
        ("slip_speed", "left|cube", 0.3),
        ("contact_count", None, 4.0),
        ("contact_count", "cube|floor", 7.0),
        ("pressure", None, 30.0),
        ("pressure", "left", 15.0),
        ("pressure", "left.tip", 20.0),
        ("volume", None, 900.0),
        ("volume", "left", 300.0),
        ("flow", None, 7.0),
        ("flow", "left.base", -1.0),
        ("pull", None, 4.0),
        ("pull", "left", 3.0),
        ("tension", None, 400.0),
        ("tension", "right.tendon", 500.0),
        ("cable_length", None, 86.0),
        ("cable_length", "left", 87.0),
        ("bending_angle", None, 60.0),  # in degrees
        ("bending_angle", "left", 30.0),
        ("tip_speed", None, 5.0),
        ("tip_speed", "right", 2.0),
        ("height", None, 12.0),
        ("height", "ball", 7.0),
        ("lift", None, 7.0),
        ("lift", "ball", 2.0),
        ("speed", None, 10.0),
        ("speed", "ball", 0.0),
        ("base_translation", None, 7.0),
        ("base_translation", "y", -3.0),
        ("base_rotation", None, 45.0),
        ("base_rotation", "y", -45.0),
        ("frame_force", None, 5.0),
        ("frame_translation", "jaw", 0.0),
        ("frame_angle", None, -90.0),
        ("frame_moment", "lid", -7.0),
    ],
)
def test_a_quantity_is_what_the_observation_says(name: str, key: str | None, expected: float) -> None:
    assert measure(name, key) == pytest.approx(expected, rel=1e-12)


def test_without_a_goal_the_force_is_that_on_all_rigid_bodies() -> None:
    assert measure("contact_force", goal=False) == 105.0


def test_without_a_goal_the_only_rigid_body_is_the_object() -> None:
    assert measure("lift", goal=False, cubes=("cube",)) == 7.0


def test_a_body_with_several_collision_surfaces_presses_on_itself() -> None:
    folded = {"mesh": "m", "mass": 1.0, "young_modulus": 500.0, "poisson_ratio": 0.3}
    folded["collision_surface"] = [{"file": "lower.stl"}, {"file": "upper.stl"}]
    model = made_up_model(soft_bodies={"mat": folded})
    assert pairs_called("mat|mat", model) == [("mat", "mat")]
    with pytest.raises(SceneError, match=r"no pair of bodies is called 'mat\|mat'"):
        pairs_called("mat|mat", made_up_model())


@pytest.mark.parametrize(
    ("name", "key", "message"),
    [
        ("pressure", "lift", "pressure[\"lift\"]: no finger or cavity is called 'lift'; did you mean 'left'?"),
        ("tension", "left.tip", "no finger or cable is called 'left.tip'; did you mean 'left'?"),
        ("pressure", "left.tap", "did you mean 'left.tip'?"),
        ("bending_angle", "mat", "no finger is called 'mat'; there are: left, right"),  # nothing holds it
        ("contact_force", "left|cub", "no pair of bodies is called 'left|cub'; did you mean 'left|cube'?"),
        ("contact_force", "floor|wall", "no pair of bodies is called 'floor|wall'"),  # neither can move
        ("contact_force", "cube", "no pair of bodies is called 'cube'"),
        ("lift", "cubes", "no rigid body is called 'cubes'; did you mean 'cube'?"),
        ("base_translation", "X", "no axis is called 'X'"),
        ("time", "x", 'time["x"]: nothing can stand in brackets behind time'),
    ],
)
def test_a_key_that_the_model_does_not_have_is_refused(name: str, key: str, message: str) -> None:
    with pytest.raises(SceneError) as refused:
        measure(name, key)
    assert message in str(refused.value)


@pytest.mark.parametrize(
    ("name", "changes", "message"),
    [
        ("lift", {"goal": False}, 'lift: which one? put its name in brackets: ["cube"]'),
        ("lift", {"goal": False, "cubes": ()}, "lift: the scene has no rigid body"),
        ("contact_force", {"goal": False, "cubes": ()}, "the scene has no rigid body"),
    ],
)
def test_a_quantity_that_a_scene_does_not_have_is_refused(name: str, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError) as refused:
        measure(name, **changes)
    assert message in str(refused.value)


def test_every_quantity_can_be_read_while_the_gripper_runs() -> None:
    """Names of attributes and keys of a real observation are those that the readings ask for."""
    simulation = Simulation(load_scene("gripper", ["frames={lid={hinge={axis=[1.0,0.0,0.0]}}}"]))
    simulation.step()
    seen = simulation.observe()
    keys = {
        "": [],
        "finger or cavity": ["finger2", "finger2.cavity"],
        "finger": ["finger2"],
        "rigid body": ["cube"],
        "pair of bodies": ["finger1|cube", "floor|cube"],
        "x, y or z": ["z"],
        "frame": ["lid"],
    }
    for name, kind in QUANTITIES.items():
        if kind.key == "finger or cable":  # there are none
            continue
        for key in (None, *keys[kind.key]):
            value = bind_quantity(Quantity(name, key), simulation.model)(seen, 0.0)
            assert np.isfinite(value), (name, key)
            assert float(value) == value
