"""Conditions of scripts: their language, and the quantities that they name.

They are evaluated as all expressions are, which tests/engine/test_expression_language.py compares with Python.
"""

import math
import warnings
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from made_up import made_up_model

from taichisoft import Observation, Simulation, load_scene
from taichisoft.base.expressions import DEEPEST_NESTING, LONGEST_TEXT
from taichisoft.errors import SceneError
from taichisoft_controllers.model_names import pairs_called
from taichisoft_controllers.step_in_progress import QUANTITIES, Quantity, bind_quantity, read_condition

NAMES = ["force", "lift", "time"]
VALUES = {Quantity("force"): 60.0, Quantity("lift"): -2.5, Quantity("force", "a|b"): 7.0, Quantity("time"): 0.0}


def holds(text: str) -> bool:
    return read_condition(text, NAMES).holds(VALUES)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("force > 60", False),
        ("force >= 60", True),
        ("force < 60.5", True),
        ("force <= 59", False),
        ("force == 60 and lift != 60", True),
        ("59 < force < 61", True),
        ("59 < force < 60", False),
        ("not lift > 0", True),
        ("lift > 0 or force > 0 and time > 1", False),  # "and" binds before "or"
        ("(lift > 0 or force > 0) and time < 1", True),
        ("abs(lift) == 2.5", True),
        ("min(force, lift, 1) == -2.5", True),
        ("max(force, lift) == 60", True),
        ("force / 2 - 3 * 4 + -lift == 20.5", True),
        ("+force > 0", True),
        ('force["a|b"] == 7', True),
        ("force['a|b'] == 7", True),
        ("1.5e1 < force", True),
        ("  force\n > 1  ", True),
        ("time == 0 or 1 / time > 1", True),  # what is decided is not looked at
    ],
)
def test_what_a_condition_means(text: str, expected: bool) -> None:
    assert holds(text) is expected


def test_python_has_nothing_to_say_about_it() -> None:
    """Python warns of "1or", which it reads all the same; that is no business of somebody who writes a script."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert holds("force > 1or lift > 1")


def test_each_quantity_is_listed_once() -> None:
    condition = read_condition('force > 1 and force["a|b"] > lift and lift > force', NAMES)
    assert condition.quantities == (Quantity("force"), Quantity("force", "a|b"), Quantity("lift"))
    assert [str(quantity) for quantity in condition.quantities] == ["force", 'force["a|b"]', "lift"]


def test_a_division_by_zero_is_no_infinite_number() -> None:
    with pytest.raises(ZeroDivisionError):
        holds("force / time > 1")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("forse > 60", "no quantity is called 'forse'; did you mean 'force'?"),
        ("x > 60", "no quantity is called 'x'; there are: force, lift, time"),
        ("force", "'force' is a number; compare it with something"),
        ("force + 1", "'force + 1' is a number; compare it"),
        ("-force", "'-force' is a number; compare it"),
        ("forse", "no quantity is called 'forse'"),
        ("1", "'1' is a number; compare it"),
        ("force > 1 and lift", "'lift' is a number; compare it"),
        ("not force", "'force' is a number; compare it"),
        ("True", "'True' never changes"),
        ("force > 1 or False", "'False' never changes"),
        ("1 > 2", "names no quantity"),
        ("(force > 1) > 0", "'force > 1' is true or false; a number is needed here"),
        ("abs(force > 1) > 0", "'force > 1' is true or false; a number is needed here"),
        ("force > True", "'True' has no place in a condition"),
        ("force > 'a'", "\"'a'\" has no place in a condition"),
        ("force = 60", "not understood at"),
        ("force > ", "not understood at"),
        ("(force > 60", "'(' was never closed"),
        ("force > 60 60", "not understood"),
        ("force > 60; lift > 1", "not understood"),
        ("force ** 2 > 1", "'force ** 2': calculate with + - * and /"),
        ("force % 2 > 1", "'force % 2': calculate with + - * and /"),
        ("force in lift", "'force in lift': compare with < <= > >= == or !="),
        ("force is lift", "'force is lift': compare with"),
        ("force > 1e999", "'1e999': a number must be finite"),
        ("force > 1" + "0" * 400, "a number must be finite"),
        ("force > 1j", "'1j' has no place in a condition"),
        ("abs > 1", "abs is a function: abs(...)"),
        ("abs(force, lift) > 1", "'abs(force, lift)': abs takes one number"),
        ("min(force) > 1", "'min(force)': min takes two numbers or more"),
        ("maxi(force, 1) > 1", "no function is called 'maxi'; did you mean 'max'?"),
        ("sqrt(force) > 1", "no function is called 'sqrt'; there are: abs, min, max"),
        ("max(force, 1, key=abs) > 1", "has no place in a condition"),
        ("max(1, *force) > 1", "'*force' has no place in a condition"),
        ("force[0] > 1", 'what stands in brackets is a name in quotes: force["..."]'),
        ("force[lift] > 1", "what stands in brackets is a name in quotes"),
        ("force.real > 1", "'force.real' has no place in a condition"),
        ("lambda: 0", "'lambda: 0' has no place in a condition"),
        ("[force > 1]", "has no place in a condition"),
        ("force > 1 if lift > 1 else lift > 2", "has no place in a condition"),
        ("(x := 1) > 0", "has no place in a condition"),
        ("f'{force}' > 0", "has no place in a condition"),
        ("__import__('os').getpid() > force", "has no place in a condition"),
        ("force > 0 \0", "not understood"),
        ("force > \ud800", "not understood"),
        ("force > 0 and " * 100 + "lift > 0", "characters; 1000 are the most"),
        ("1 + " * (DEEPEST_NESTING + 10) + "force > 0", "nested too deeply"),
        ("not " * 240 + "force > 0", "nested too deeply"),
        ("(" * 400 + "force > 0" + ")" * 400, "too many nested parentheses"),
        ("-" * (LONGEST_TEXT - 9) + "force > 0", ""),
    ],
)
def test_what_is_no_condition_is_refused_in_one_line(text: str, message: str) -> None:
    with pytest.raises(SceneError) as refused:
        read_condition(text, NAMES)
    assert message in str(refused.value)
    assert len(str(refused.value).splitlines()) == 1


SIGNS = [*"()[]<>=!+-*/.,:;'\"\\#@{}%&|^~0123456789ej\n\t\0"]
WORDS = [" and ", " or ", " not ", " if ", " else ", " is ", "lambda ", "__import__", "eval", "exec", "open"]
WORDS += ["__class__", "min", "max", "abs", "True", "None", "f'", "1e999"]
PIECES = st.sampled_from(NAMES + SIGNS + WORDS)


@given(st.text() | st.lists(PIECES, max_size=30).map("".join))
@example("\x0c force > 1")
@example("force > 0x1for x")
@example("force > '\\d'")
@example("0_0 > 1")
def test_whatever_is_written_only_a_scene_error_comes_out(text: str) -> None:
    try:
        condition = read_condition(text, NAMES)
    except SceneError as error:
        assert len(str(error).splitlines()) == 1
        return
    values = {quantity: 1.0 for quantity in condition.quantities}
    try:
        assert isinstance(condition.holds(values), bool)
    except ZeroDivisionError:
        assert "/" in text


def test_not_a_number_is_not_true() -> None:
    condition = read_condition("force > 1", NAMES)
    assert condition.holds({Quantity("force"): math.nan}) is False


# What conditions can ask about: each quantity from a made-up observation, and all of them from the real gripper.

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


def test_folded_body_presses_on_itself() -> None:
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
        "body or frame": ["cube", "finger1", "base"],
    }
    for name, kind in QUANTITIES.items():
        if kind.key not in keys:  # cables and air networks, of which there are none
            continue
        for key in (None, *keys[kind.key]):
            value = bind_quantity(Quantity(name, key), simulation.model)(seen, 0.0)
            assert np.isfinite(value), (name, key)
            assert float(value) == value
