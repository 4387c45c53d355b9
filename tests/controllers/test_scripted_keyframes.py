"""The scripted controller: what it asks for between, at and beyond its keyframes, and what it refuses."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_up import CAVITIES, made_up_model, refusal, write

from taichisoft import Control, Controller, Observation
from taichisoft.errors import SceneError
from taichisoft_controllers.scripted_controller import scripted_controller

SCRIPT = """
interpolation = "{interpolation}"
[[keyframes]]
time = 0.5
pressure = 0.0
[[keyframes]]
time = 1.5
pressure = 40.0
base_translation = [3.0, 6.0, -9.0]
base_rotation = [90.0, 0.0, 0.0]
[[keyframes]]
time = 3.5
pressure = 10.0
"""


def script(folder: Path, interpolation: str = "linear", content: str = SCRIPT) -> Path:
    return write(folder, content.replace("{interpolation}", interpolation))


def ask(controller: Controller, time: float) -> Control:
    controller.reset(made_up_model())
    return controller.control(Observation(time, 0))


def pressure(controller: Controller, time: float) -> float:
    pressures = ask(controller, time).pressure
    (value,) = {pressures[name] for name in CAVITIES}
    assert len(pressures) == len(CAVITIES)
    return value


@pytest.mark.parametrize("interpolation", ["linear", "smooth"])
def test_keyframes_are_hit_exactly(tmp_path: Path, interpolation: str) -> None:
    controller = scripted_controller(script(tmp_path, interpolation))
    assert [pressure(controller, time) for time in (0.5, 1.5, 3.5)] == [0.0, 40.0, 10.0]
    control = ask(controller, 1.5)
    assert control.base_translation is not None and control.base_rotation is not None
    assert control.base_translation.tolist() == [3.0, 6.0, -9.0]
    assert control.base_rotation.tolist() == [np.pi / 2, 0.0, 0.0]  # degrees in the file, radians to the engine


@pytest.mark.parametrize("interpolation", ["linear", "smooth"])
def test_before_the_first_and_after_the_last_keyframe_it_holds(tmp_path: Path, interpolation: str) -> None:
    controller = scripted_controller(script(tmp_path, interpolation))
    assert [pressure(controller, time) for time in (0.0, 0.49, 3.51, 1e6)] == [0.0, 0.0, 10.0, 10.0]


def test_linear_means_in_proportion_to_time(tmp_path: Path) -> None:
    controller = scripted_controller(script(tmp_path, "linear"))
    assert pressure(controller, 0.75) == pytest.approx(10.0, rel=1e-12)
    assert pressure(controller, 3.0) == pytest.approx(17.5, rel=1e-12)
    translation = ask(controller, 1.0).base_translation
    np.testing.assert_allclose(translation, [1.5, 3.0, -4.5], rtol=1e-12)


def test_smooth_follows_its_cubic(tmp_path: Path) -> None:
    """A share s of the way in time is 3 s^2 - 2 s^3 of the way in value."""
    controller = scripted_controller(script(tmp_path, "smooth"))
    for share in (0.1, 0.25, 0.5, 0.9):
        assert pressure(controller, 0.5 + share) == pytest.approx(40.0 * (3 * share**2 - 2 * share**3), rel=1e-12)


def test_smooth_starts_and_ends_at_rest_and_linear_does_not(tmp_path: Path) -> None:
    """One-sided slopes at a keyframe: of order dt for the cubic (3 dt / T^2 times the range), 40 kPa/s for the line."""
    dt = 1e-6
    for interpolation, largest, least in (("smooth", 40.0 * 3 * dt * 1.01, 0.0), ("linear", 40.1, 14.9)):
        controller = scripted_controller(script(tmp_path, interpolation))
        for time in (0.5 + dt, 1.5 - dt, 1.5 + dt, 3.5 - dt):
            nearest_keyframe = min((0.5, 1.5, 3.5), key=lambda keyframe: abs(keyframe - time))
            slope = abs(pressure(controller, time) - pressure(controller, nearest_keyframe)) / dt
            assert least <= slope <= largest


def test_a_pressure_scales_the_script_to_its_largest(tmp_path: Path) -> None:
    controller = scripted_controller(script(tmp_path), pressure=80.0)
    assert [pressure(controller, time) for time in (0.5, 1.5, 3.5)] == pytest.approx([0.0, 80.0, 20.0])
    translation = ask(controller, 1.5).base_translation
    assert translation is not None and translation.tolist() == [3.0, 6.0, -9.0]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (
            "[[keyframes]]\ntime=1\npressure=1\n[[keyframes]]\ntime=0.5\npressure=1",
            "must increase; they are [1.0, 0.5]",
        ),
        ("[[keyframes]]\ntime=1\npressure=1\n[[keyframes]]\ntime=1\npressure=1", "must increase; they are [1.0, 1.0]"),
        ("[[keyframes]]\ntime=1\npresure=1", "keyframes.0.presure: unknown key; did you mean 'pressure'?"),
        ("interpolatin='linear'\nkeyframes=[{time=1,pressure=1}]", "unknown key; did you mean 'interpolation'?"),
        ("interpolation='cubic'\nkeyframes=[{time=1,pressure=1}]", "interpolation = 'cubic': input should be 'linear'"),
        ("keyframes=[{time=-1,pressure=1}]", "keyframes.0.time = -1: input should be greater than or equal to 0"),
        ("keyframes=[{time=1,pressure=nan}]", "keyframes.0.pressure = nan: input should be a finite number"),
        ("keyframes=[{time=1,pressure='1'}]", "keyframes.0.pressure = '1': input should be a valid number"),
        ("keyframes=[{time=1,pressure=1,base_translation=[1,2]}]", "= [1, 2]: has 2 values; 3 are needed"),
        ("keyframes=[]", "keyframes = []: at least 1 is needed"),
        ("", "exactly one of keyframes, steps is needed; given: none"),
        ("keyframes=[", "not readable as TOML: "),
    ],
)
def test_a_wrong_script_is_refused_in_one_line(tmp_path: Path, content: str, message: str) -> None:
    assert message in refusal(script(tmp_path, content=content))


@pytest.mark.parametrize("value", [0.0, np.nan, np.inf, "high", True])
def test_a_wrong_pressure_is_named_as_a_setting(tmp_path: Path, value: Any) -> None:
    with pytest.raises(SceneError, match=r"^controller\.settings\.pressure = "):
        scripted_controller(script(tmp_path), pressure=value)


def test_suction_turns_the_pressures_of_keyframes_but_not_steps_with_rates(tmp_path: Path) -> None:
    turned = scripted_controller(script(tmp_path), pressure=-20.0)
    assert [pressure(turned, time) for time in (0.5, 1.5, 3.5)] == [0.0, -20.0, -5.0]
    with pytest.raises(SceneError, match=r"^controller\.settings\.pressure = -20: .* has steps with rates"):
        scripted_controller("grasp-until-contact", pressure=-20.0)


def test_a_script_without_pressure_cannot_be_scaled() -> None:
    with pytest.raises(SceneError, match=r"rest\.toml: has no pressure above 0"):
        scripted_controller("rest", pressure=50.0)
