"""The keyboard controller: what each key changes, within which limits, and in which directions."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_up import made_up_model

from taichisoft import Control, KeyEvent, Observation, Slider
from taichisoft.errors import SceneError
from taichisoft.scene import key_descriptions
from taichisoft_controllers.keyboard_controller import KeyboardController, KeyboardSettings

CAVITIES = ("finger1.cavity", "finger2.front", "finger2.back", "finger3.cavity")
KEYS = ["+", "=", "-", "up", "down", "left", "right", "a", "q", "0", "1", "2", "3", "4", "x", "enter"]


def press(controller: KeyboardController, *keys: str, ctrl: bool = False) -> Control:
    """What it asks for after the keys; what it sees must not matter."""
    for key in keys:
        controller.key(KeyEvent(key, ctrl))
    control = controller.control(Observation(time=1.0, step=100, base_translation=np.full(3, 7.0)))
    assert control.base_translation is not None and control.base_rotation is not None
    return control


def ready(gravity: tuple[float, float, float] = (-9810.0, 0.0, 0.0), **settings: float) -> KeyboardController:
    controller = KeyboardController(**settings)
    controller.reset(made_up_model(CAVITIES, gravity=gravity))
    return controller


def test_without_keys_it_asks_for_the_state_of_rest() -> None:
    control = press(ready())
    assert control.pressure == dict.fromkeys(CAVITIES, 0.0)
    np.testing.assert_array_equal(control.base_translation, np.zeros(3))
    np.testing.assert_array_equal(control.base_rotation, np.zeros(3))


def test_plus_and_minus_change_all_pressures_by_a_kilopascal() -> None:
    controller = ready()
    assert press(controller, "+", "+", "=").pressure == dict.fromkeys(CAVITIES, 3.0)
    assert press(controller, "-").pressure == dict.fromkeys(CAVITIES, 2.0)


def test_key_pushes_the_object_once() -> None:
    """To the right, which is y where x is up, and turns with the gripper; for 0.1 s of ten steps."""
    controller = ready(push=50.0)
    assert controller.bindings["o"] == "push cube to the right by 50 mN"
    force = press(controller, "o").forces["cube"]
    assert force is not None and force.steps == 10
    np.testing.assert_allclose(force.force, [0.0, 50.0, 0.0])
    assert press(controller).forces == {}
    turned = press(controller, *8 * "a", "o").forces["cube"]
    assert turned is not None
    np.testing.assert_allclose(turned.force, [0.0, 0.0, 50.0], atol=1e-9)


def test_digit_selects_a_finger_and_zero_selects_all() -> None:
    controller = ready()
    assert controller.status == "all fingers selected"
    assert press(controller, "2", "+").pressure == dict(zip(CAVITIES, [0.0, 1.0, 1.0, 0.0], strict=True))
    assert controller.status == "finger2 selected"
    assert press(controller, "9", "+").pressure["finger2.back"] == 2.0, "there is no ninth finger"
    assert press(controller, "0", "+").pressure == dict(zip(CAVITIES, [1.0, 3.0, 3.0, 1.0], strict=True))


@pytest.mark.parametrize(
    ("limits", "lowest", "highest"),
    [
        ({}, 0.0, 150.0),
        ({"highest_pressure": 40.0}, 0.0, 40.0),
        ({"lowest_pressure": -20.0, "highest_pressure": 200.0}, -20.0, 200.0),
        ({"lowest_pressure": 5.0}, 5.0, 150.0),
    ],
)
def test_pressures_stay_within_limits(limits: dict[str, float], lowest: float, highest: float) -> None:
    """At a limit further presses are not saved up: the first press back counts."""
    controller = KeyboardController()
    controller.reset(made_up_model(CAVITIES, limits=limits))
    assert press(controller).pressure["finger1.cavity"] == max(lowest, 0.0)
    assert press(controller, *300 * "+").pressure["finger1.cavity"] == highest
    assert press(controller, "-").pressure["finger1.cavity"] == highest - 1.0
    assert press(controller, *300 * "-").pressure["finger1.cavity"] == lowest
    assert press(controller, "+").pressure["finger1.cavity"] == lowest + 1.0


@pytest.mark.parametrize(
    ("gravity", "up", "right"),
    [
        ((-9810.0, 0.0, 0.0), (1, 0, 0), (0, 1, 0)),
        ((0.0, 0.0, -9810.0), (0, 0, 1), (1, 0, 0)),
        ((0.0, -9810.0, 0.0), (0, 1, 0), (0, 0, 1)),
        ((0.0, 0.0, 0.0), (0, 0, 1), (1, 0, 0)),
        ((0.0, -6000.0, -8000.0), (0, 0.6, 0.8), (1, 0, 0)),
    ],
)
def test_arrows_move_by_3_mm_against_gravity_and_to_the_sides(
    gravity: tuple[float, float, float], up: tuple[float, ...], right: tuple[float, ...]
) -> None:
    controller = ready(gravity)
    np.testing.assert_allclose(press(controller, "up").base_translation, 3.0 * np.array(up), atol=1e-12)
    np.testing.assert_allclose(press(controller, "down", "right").base_translation, 3.0 * np.array(right), atol=1e-12)
    np.testing.assert_allclose(press(controller, "left", "down").base_translation, -3.0 * np.array(up), atol=1e-12)


def test_a_and_q_turn_about_the_upward_axis_by_a_32nd_of_a_turn() -> None:
    controller = ready()
    np.testing.assert_allclose(press(controller, "a", "a").base_rotation, [math.radians(22.5), 0.0, 0.0])
    np.testing.assert_allclose(press(controller, "q", "q", "q").base_rotation, [-math.radians(11.25), 0.0, 0.0])


def test_sideways_turns_with_the_gripper_and_up_does_not() -> None:
    """After a quarter turn by the right-hand rule about x, what pointed along y points along z."""
    controller = ready()
    np.testing.assert_allclose(press(controller, *8 * "a", "right").base_translation, [0.0, 0.0, 3.0], atol=1e-12)
    np.testing.assert_allclose(press(controller, "up").base_translation, [3.0, 0.0, 3.0], atol=1e-12)
    np.testing.assert_allclose(press(controller, *8 * "a", "right").base_translation, [3.0, -3.0, 3.0], atol=1e-12)


@given(st.lists(st.sampled_from(KEYS), max_size=40))
def test_control_depends_on_keys_without_ctrl_and_shift(keys: list[str]) -> None:
    """The same keys give the same bits, also after another session."""
    plain, again = ready(), ready()
    press(again, "+", "3", "up", "a")
    again.reset(made_up_model(CAVITIES))
    expected = press(plain, *keys)
    shifted = [key.upper() if key in ("a", "q") else key for key in keys]
    control = press(again, *shifted, ctrl=True)
    assert control.pressure == expected.pressure
    np.testing.assert_array_equal(control.base_translation, expected.base_translation)
    np.testing.assert_array_equal(control.base_rotation, expected.base_rotation)
    assert again.status == plain.status


@given(st.lists(st.sampled_from(["+", "-"]), max_size=20), st.floats(0.01, 5.0))
def test_pressure_steps_add_up(keys: list[str], step: float) -> None:
    expected = 0.0
    for key in keys:
        expected = max(0.0, expected + (step if key == "+" else -step))
    assert press(ready(pressure_step=step), *keys).pressure["finger1.cavity"] == expected


def test_slider_sets_one_cavity_and_follows_the_keys() -> None:
    """Keys count on from where it stands; beyond the limits, and for a cavity that is not there, nothing happens."""
    controller = KeyboardController(pressure_step=2.0)
    controller.reset(made_up_model(CAVITIES, limits={"highest_pressure": 40.0}))
    controller.key(KeyEvent("finger2.back", value=12.3))
    controller.key(KeyEvent("finger3.cavity", value=99.0))
    controller.key(KeyEvent("finger4.cavity", value=5.0))
    assert press(controller, "+").pressure == dict(zip(CAVITIES, [2.0, 2.0, 14.3, 40.0], strict=True))
    assert list(controller.sliders) == list(CAVITIES)
    assert controller.sliders["finger2.back"] == Slider(14.3, 0.0, 40.0, 2.0, "kPa")


def test_what_was_asked_for_does_not_change_afterwards() -> None:
    """Outputs may keep a control."""
    controller = ready()
    first = press(controller, "+", "up")
    press(controller, "+", "up")
    assert first.pressure["finger1.cavity"] == 1.0
    assert first.base_translation is not None and first.base_translation[0] == 3.0


def test_steps_are_settings() -> None:
    controller = ready(pressure_step=2.5, translation_step=1.0, turn_step=90.0)
    control = press(controller, "+", "right", "a", "right")
    assert control.pressure["finger1.cavity"] == 2.5
    np.testing.assert_allclose(control.base_translation, [0.0, 1.0, 1.0], atol=1e-12)
    assert "2.5 kPa" in controller.bindings["+"]


def test_keys_move_frames_and_turn_hinges_to_their_stops() -> None:
    """f goes on to the next frame; those on a path are left out. A resumed controller goes on where it was."""
    hinge = {"axis": [0.0, 0.0, 1.0], "highest_angle": 20.0}
    path = {"times": [0.0, 1.0], "rotations": [[0.0, 0.0, 0.0], [0.0, 0.0, 9.0]]}
    frames = {"jaw": {"follows": "base"}, "belt": {"path": path}, "lid": {"hinge": hinge}}
    controller = KeyboardController()
    controller.reset(made_up_model(CAVITIES, gravity=[-9810.0, 0.0, 0.0], frames=frames))
    control = press(controller, "f", "up", "a", "right")
    assert controller.status == "all fingers selected, keys move jaw"
    turn = math.radians(11.25)
    np.testing.assert_allclose(control.frame_rotation["jaw"], [turn, 0.0, 0.0])
    expected = [3.0, 3.0 * math.cos(turn), 3.0 * math.sin(turn)]
    np.testing.assert_allclose(control.frame_translation["jaw"], expected, atol=1e-12)
    np.testing.assert_array_equal(control.base_translation, np.zeros(3))
    assert press(controller, "f", "up", "a").frame_angle == {"lid": pytest.approx(turn)}
    assert press(controller, "a", "a").frame_angle == {"lid": pytest.approx(math.radians(20.0))}
    assert controller.sliders["lid"] == Slider(20.0, -180.0, 20.0, 11.25, "degrees")
    other = KeyboardController()
    other.reset(made_up_model(CAVITIES, gravity=[-9810.0, 0.0, 0.0], frames=frames))
    other.restore(controller.save())
    np.testing.assert_array_equal(press(other, "f", "up").base_translation, [3.0, 0.0, 0.0])
    assert press(other).frame_angle == control.frame_angle | {"lid": pytest.approx(math.radians(20.0))}


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf, "3", True])
@pytest.mark.parametrize("name", ["pressure_step", "pull_step", "tension_step", "translation_step", "turn_step"])
def test_a_step_that_is_no_positive_number_is_refused_by_name(name: str, value: Any) -> None:
    with pytest.raises(SceneError, match=rf"^controller\.settings\.{name} = "):
        KeyboardController(**{name: value})


def test_every_setting_has_its_row_in_the_documents() -> None:
    page = (Path(__file__).resolve().parents[2] / "docs" / "controllers.md").read_text(encoding="utf-8")
    meanings, fields = key_descriptions(KeyboardSettings), KeyboardSettings.model_fields
    table = [f"| `{key}` | {fields[key].default} | {meaning} |" for key, meaning in meanings.items()]
    assert "|---|---|---|\n" + "\n".join(table) + "\n\n" in page


def test_a_run_with_it_is_interactive_and_every_key_is_explained() -> None:
    controller = ready()
    assert controller.interactive
    explained = " ".join(controller.bindings)
    for key in ("+", "-", "up", "down", "left", "right", "a", "q", "0", "1"):
        assert key in explained.split()


CABLES: dict[str, dict[str, float]] = {"finger1.tendon": {}, "finger2.tendon": {"lowest_pull": -2.0, "highest_pull": 4}}


def with_cables(cavities: tuple[str, ...] = (), **settings: Any) -> KeyboardController:
    controller = KeyboardController(**settings)
    controller.reset(made_up_model(cavities, cables=CABLES))
    return controller


def test_plus_and_minus_pull_cables_in_and_pay_them_out() -> None:
    """Within the cable's own stops, or a third of its length; a finger that is selected alone."""
    controller = with_cables()
    assert press(controller, "+", "+").cable_pull == {"finger1.tendon": 2.0, "finger2.tendon": 2.0}
    assert press(controller, "1", *40 * "+").cable_pull == {"finger1.tendon": 30.0, "finger2.tendon": 2.0}
    assert press(controller, "0", *40 * "-").cable_pull == {"finger1.tendon": 0.0, "finger2.tendon": -2.0}
    control = press(controller, *40 * "+")
    assert control.cable_pull == {"finger1.tendon": 30.0, "finger2.tendon": 4.0}
    assert not control.pressure and not control.cable_tension
    assert (controller.bindings["+"], controller.bindings["-"]) == (
        "pull the cables in by 1 mm",
        "pay the cables out by 1 mm",
    )


def test_cables_can_be_driven_by_their_tension() -> None:
    controller = with_cables(cables="tension", tension_step=250.0)
    control = press(controller, "2", "+", "+")
    assert control.cable_tension == {"finger1.tendon": 0.0, "finger2.tendon": 500.0}
    assert not control.cable_pull
    assert controller.sliders["finger1.tendon"] == Slider(0.0, 0.0, 10000.0, 250.0, "mN")


def test_a_rod_can_be_pushed() -> None:
    controller = KeyboardController()
    controller.reset(made_up_model((), cables={"finger1.rod": {"rod": True}}))
    assert press(controller, *40 * "-").cable_pull == {"finger1.rod": -30.0}


def test_fingers_with_both_are_driven_by_both() -> None:
    """One key is one step of each, and sliders have their own units."""
    controller = with_cables(("finger1.cavity", "finger3.cavity"), pull_step=0.5)
    control = press(controller, "1", "+")
    assert control.pressure == {"finger1.cavity": 1.0, "finger3.cavity": 0.0}
    assert control.cable_pull == {"finger1.tendon": 0.5, "finger2.tendon": 0.0}
    controller.key(KeyEvent("finger1.tendon", value=12.5))
    assert press(controller).cable_pull["finger1.tendon"] == 12.5
    assert [slider.unit for slider in controller.sliders.values()] == ["kPa", "kPa", "mm", "mm"]
    assert controller.bindings["-"] == "lower the pressure by 1 kPa, pay the cables out by 0.5 mm"
