"""Files of scripts: pressures by finger, and what is refused, with file, key, value and what would be valid."""

from pathlib import Path

import pytest
from made_up import controller_of, follow, pressures, refusal, write

from taichisoft.errors import SceneError
from taichisoft_controllers.scripted_controller import scripted_controller


def keyframe(pressure: str) -> str:
    return f"keyframes = [{{ time = 0.0, pressure = {pressure} }}]"


@pytest.mark.parametrize(
    ("pressure", "expected"),
    [
        ("7", [7.0, 7.0, 7.0]),
        ("{ left = 1.0, right = 2.0 }", [1.0, 1.0, 2.0]),
        ('{ right = 2, "left.tip" = 3, "left.base" = 1 }', [1.0, 3.0, 2.0]),
        ("{ right.base = 2.0, left.tip = 3.0, left.base = 1.0 }", [1.0, 3.0, 2.0]),  # tables in tables, to TOML
    ],
)
def test_a_pressure_is_for_all_cavities_or_by_finger_or_by_cavity(
    tmp_path: Path, pressure: str, expected: list[float]
) -> None:
    assert pressures(follow(controller_of(tmp_path, keyframe(pressure)), 0.0)[0.0]) == expected


def test_each_cavity_is_interpolated_between_its_own_keyframes(tmp_path: Path) -> None:
    script = (
        "[[keyframes]]\ntime = 0\npressure = { left = 0.0, right = 30.0 }\n[[keyframes]]\ntime = 1\npressure = 10.0"
    )
    asked = follow(controller_of(tmp_path, script), 0.5)
    assert pressures(asked[0.5]) == pytest.approx([5.0, 5.0, 20.0])


def test_the_largest_of_all_cavities_is_scaled(tmp_path: Path) -> None:
    controller = controller_of(tmp_path, keyframe("{ left = 10.0, right = 40.0 }"), pressure=80.0)
    assert pressures(follow(controller, 0.0)[0.0]) == [20.0, 20.0, 80.0]


def test_a_setting_replaces_the_interpolation(tmp_path: Path) -> None:
    script = "keyframes = [{ time = 0.0, pressure = 0.0 }, { time = 1.0, pressure = 8.0 }]"
    linear = follow(controller_of(tmp_path, script), 0.25)[0.25]
    smooth = follow(controller_of(tmp_path, script, interpolation="smooth"), 0.25)[0.25]
    assert (pressures(linear)[0], pressures(smooth)[0]) == pytest.approx((2.0, 1.25))


@pytest.mark.parametrize("value", ["cubic", 3, ""])
def test_a_wrong_interpolation_is_named_as_a_setting(tmp_path: Path, value: str) -> None:
    with pytest.raises(SceneError, match=r"^controller\.settings\.interpolation = .*: input should be 'linear' or"):
        scripted_controller(write(tmp_path, keyframe("1.0")), interpolation=value)


@pytest.mark.parametrize(
    ("pressure", "message"),
    [
        ("{}", "keyframes.0.pressure: names no finger or cavity"),
        ("{ left = '1' }", "keyframes.0.pressure: left = '1' must be a finite number [kPa]"),
        ("{ left = inf }", "keyframes.0.pressure: left = inf must be a finite number [kPa]"),
        ("{ left = { tip = true } }", "keyframes.0.pressure: left.tip = True must be a finite number [kPa]"),
        ("[1.0]", "keyframes.0.pressure = [1.0]: input should be a valid number"),
        ("true", "keyframes.0.pressure = True: input should be a valid number"),
    ],
)
def test_a_wrong_pressure_is_refused_when_the_file_is_read(tmp_path: Path, pressure: str, message: str) -> None:
    assert refusal(write(tmp_path, keyframe(pressure))) == message


STEP = "[[steps]]\npressure = {}\nduration = 1.0"


@pytest.mark.parametrize(
    ("script", "message"),
    [
        (
            keyframe("{ lift = 1.0 }"),
            "keyframes.0.pressure: no finger or cavity is called 'lift'; did you mean 'left'?",
        ),
        (keyframe("{ left.tap = 1.0 }"), "no finger or cavity is called 'left.tap'; did you mean 'left.tip'?"),
        (
            keyframe("{ left = 1.0 }"),
            "keyframes.0.pressure: does not name 'right.base'; a keyframe has the pressure of",
        ),
        (keyframe("{ left = 1.0, right = 1.0, 'left.tip' = 2.0 }"), "'left.tip' is given twice, the second time as"),
        (STEP.format("{ lift = 1.0 }"), "steps.0.pressure: no finger or cavity is called 'lift'; did you mean 'left'?"),
        (
            "[[steps]]\nname = 'wait'\nuntil = 'contact_force[\"left|cub\"] > 1'\ntimeout = 1.0",
            "steps.0 'wait': until = 'contact_force[\"left|cub\"] > 1': contact_force[\"left|cub\"]: "
            "no pair of bodies is called 'left|cub'; did you mean 'left|cube'?",
        ),
    ],
)
def test_a_name_that_the_model_does_not_have_is_refused_before_the_run(
    tmp_path: Path, script: str, message: str
) -> None:
    assert message in refusal(tmp_path / "script.toml", lambda _: controller_of(tmp_path, script))


@pytest.mark.parametrize(
    ("script", "message"),
    [
        (
            "steps = [{ hold = 1.0 }]\nkeyframes = [{ time = 0.0, pressure = 1.0 }]",
            "exactly one of keyframes, steps is needed; given: keyframes, steps",
        ),
        ("step = [{ hold = 1.0 }]", "step: unknown key; did you mean 'steps'?"),
        ("steps = []", "steps = []: at least 1 is needed"),
        ("steps = [{}]", "steps.0: does nothing; it needs at least one of pressure, valve, pull, tension,"),
        ("steps = [{ name = 'a' }]", "steps.0: does nothing"),
        ("steps = [{ time = 1.0, pressure = 1.0 }]", "steps.0.time: unknown key; "),
        ("keyframes = [{ time = 1.0, pressure = 1.0, until = 'time > 1' }]", "keyframes.0.until: unknown key; "),
        ("steps = [{ untill = 'time > 1', timeout = 1.0 }]", "steps.0.untill: unknown key; did you mean 'until'?"),
        ("steps = [{ until = 'time > 1' }]", "steps.0: until needs a timeout [s], after which the run fails"),
        ("steps = [{ hold = 1.0, timeout = 1.0 }]", "steps.0: timeout without until has no effect"),
        ("steps = [{ until = 'time > 1', timeout = 0.0 }]", "steps.0.timeout = 0.0: input should be greater than 0"),
        ("steps = [{ until = true, timeout = 1.0 }]", "steps.0.until = True: input should be a valid string"),
        ("steps = [{ pressure = 1.0 }]", "steps.0: pressure needs a duration [s] or a pressure_rate [kPa/s]"),
        (
            "steps = [{ base_translation = [1.0, 0.0, 0.0], pressure = 1.0, pressure_rate = 1.0 }]",
            "steps.0: base_translation needs a duration [s] or a base_speed [mm/s]",
        ),
        ("steps = [{ base_rotation = [1.0, 0.0, 0.0] }]", "or a base_turning_speed [degrees/s]"),
        (
            "steps = [{ pressure = 1.0, pressure_rate = 1.0, duration = 1.0 }]",
            "steps.0: duration and pressure_rate are both given; give one of them",
        ),
        ("steps = [{ hold = 1.0, base_speed = 1.0 }]", "steps.0: base_speed without base_translation has no effect"),
        ("steps = [{ duration = 1.0 }]", "steps.0: duration without anything that moves; to wait, give hold [s]"),
        ("steps = [{ hold = -1.0 }]", "steps.0.hold = -1.0: input should be greater than 0"),
        ("steps = [{ pressure = nan, duration = 1.0 }]", "steps.0.pressure = nan: input should be a finite number"),
        (
            "steps = [{ hold = 1.0 }, { name = 'close', until = 'contact_forse > 60', timeout = 1.0 }]",
            "steps.1 'close': until = 'contact_forse > 60': no quantity is called 'contact_forse'; "
            "did you mean 'contact_force'?",
        ),
        (
            "steps = [{ until = 'contact_force', timeout = 1.0 }]",
            "steps.0: until = 'contact_force': 'contact_force' is a number; compare it with something",
        ),
    ],
)
def test_a_wrong_file_of_steps_is_refused_in_one_line(tmp_path: Path, script: str, message: str) -> None:
    assert message in refusal(write(tmp_path, script))


def test_steps_without_pressure_cannot_be_scaled(tmp_path: Path) -> None:
    path = write(tmp_path, "steps = [{ hold = 1.0 }]")
    with pytest.raises(SceneError, match="has no pressure above 0"):
        scripted_controller(path, pressure=50.0)
