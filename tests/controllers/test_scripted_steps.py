"""Steps of a script: how they move, when they end, what they wait for, and how they fail."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_up import controller_of, follow, made_up_model, observation, pressures

from taichisoft import Observation
from taichisoft.errors import ControllerFailed, SceneError
from taichisoft_controllers.script_targets import Ramp

UNTIL = """
[[steps]]
name = "close"
pressure = 80.0
pressure_rate = 50.0
until = "contact_force > 60"
timeout = 1.0
hold = 0.1

[[steps]]
name = "lift"
base_translation = [0.0, 0.0, 30.0]
duration = 0.5
"""


def touches_at(time: float, force: float = 61.0) -> Callable[[float], float]:
    return lambda now: force if now >= time - 1e-9 else 0.0


def test_the_pressure_rises_at_its_rate_and_stops_where_the_condition_becomes_true(tmp_path: Path) -> None:
    asked = follow(controller_of(tmp_path, UNTIL), 1.0, touches_at(0.4))
    for time in (0.0, 0.1, 0.39):
        assert pressures(asked[time]) == pytest.approx([50.0 * time] * 3, abs=1e-9)
    # At 0.4 s the force is seen: what was asked for last, 50 kPa/s * 0.39 s, stays.
    for time in (0.4, 0.5, 1.0):
        assert pressures(asked[time]) == pytest.approx([19.5] * 3, abs=1e-9)


def test_the_next_step_begins_after_the_hold(tmp_path: Path) -> None:
    asked = follow(controller_of(tmp_path, UNTIL), 1.5, touches_at(0.4))
    height = {time: float(np.asarray(control.base_translation)[2]) for time, control in asked.items()}
    assert height[0.49] == height[0.5] == 0.0  # 0.1 s of hold after 0.4 s
    assert height[0.6] == pytest.approx(6.0)  # 30 mm in 0.5 s
    assert height[1.0] == pytest.approx(30.0, abs=1e-6)
    assert height[1.5] == 30.0
    signal = {time: control.signals["script_step"] for time, control in asked.items()}
    assert [signal[time] for time in (0.0, 0.49, 0.51, 0.99, 1.01, 1.5)] == [0.0, 0.0, 1.0, 1.0, 2.0, 2.0]


def test_a_condition_that_is_true_only_for_a_moment_is_enough(tmp_path: Path) -> None:
    asked = follow(controller_of(tmp_path, UNTIL), 1.5, lambda time: 61.0 if abs(time - 0.4) < 1e-6 else 0.0)
    assert asked[1.5].signals["script_step"] == 2.0


def test_a_target_that_is_reached_is_kept_until_the_condition_is_true(tmp_path: Path) -> None:
    asked = follow(controller_of(tmp_path, UNTIL.replace("80.0", "10.0")), 1.0, touches_at(0.8))
    assert pressures(asked[0.5]) == pressures(asked[0.9]) == [10.0] * 3
    assert asked[0.89].signals["script_step"] == 0.0


def test_a_condition_that_is_true_from_the_start_changes_nothing(tmp_path: Path) -> None:
    asked = follow(controller_of(tmp_path, UNTIL), 0.2, touches_at(0.0))
    assert pressures(asked[0.2]) == [0.0] * 3
    assert asked[0.11].signals["script_step"] == 1.0


def test_a_condition_that_does_not_come_fails_the_run_with_its_value(tmp_path: Path) -> None:
    controller = controller_of(tmp_path, UNTIL)
    with pytest.raises(ControllerFailed) as failed:
        follow(controller, 3.0, lambda time: 12.25)
    assert str(failed.value) == (
        f"{tmp_path / 'script.toml'}: steps.0 'close': until = 'contact_force > 60' was not true within 1 s; "
        "at 1 s: contact_force = 12.25 mN"
    )


def test_the_condition_may_become_true_at_the_last_moment(tmp_path: Path) -> None:
    asked = follow(controller_of(tmp_path, UNTIL), 1.2, touches_at(1.0))
    assert asked[1.2].signals["script_step"] == 1.0


def test_the_time_of_a_timeout_counts_from_the_beginning_of_its_step(tmp_path: Path) -> None:
    script = '[[steps]]\nhold = 5.0\n[[steps]]\nuntil = "elapsed > 1.5"\ntimeout = 1.0'
    with pytest.raises(ControllerFailed, match=r"steps\.1: .* within 1 s; at 6 s: elapsed = 1 s$"):
        follow(controller_of(tmp_path, script), 10.0)


def test_a_division_by_zero_fails_the_run(tmp_path: Path) -> None:
    script = '[[steps]]\nuntil = "friction_force / contact_force < 0.5"\ntimeout = 1.0'
    with pytest.raises(ControllerFailed, match=r"divides by zero at 0 s: friction_force = 0 mN, contact_force = 0 mN"):
        follow(controller_of(tmp_path, script), 1.0)


def test_what_a_step_does_not_name_stays(tmp_path: Path) -> None:
    script = """
    [[steps]]
    pressure = { left = 20.0, "right.base" = 5.0 }
    base_translation = [1.0, 2.0, 3.0]
    base_rotation = [90.0, 0.0, 0.0]
    duration = 0.1
    [[steps]]
    pressure.left.tip = 40.0
    duration = 0.1
    """
    control = follow(controller_of(tmp_path, script), 0.3)[0.3]
    assert pressures(control) == [20.0, 40.0, 5.0]
    np.testing.assert_array_equal(control.base_translation, [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(control.base_rotation, [np.pi / 2, 0.0, 0.0])


def test_each_pressure_goes_at_the_rate_until_it_is_there(tmp_path: Path) -> None:
    script = "[[steps]]\npressure = { left = 20.0, right = 5.0 }\npressure_rate = 50.0\n"
    script += "[[steps]]\npressure = { right = 0.0 }\npressure_rate = 10.0\n"
    asked = follow(controller_of(tmp_path, script), 1.0)
    assert pressures(asked[0.1]) == pytest.approx([5.0, 5.0, 5.0])
    assert pressures(asked[0.2]) == pytest.approx([10.0, 10.0, 5.0])
    assert pressures(asked[0.4]) == pytest.approx([20.0, 20.0, 5.0])
    assert pressures(asked[0.6]) == pytest.approx([20.0, 20.0, 3.0])
    assert pressures(asked[1.0]) == [20.0, 20.0, 0.0]


def test_the_base_goes_straight_at_its_speeds(tmp_path: Path) -> None:
    """30 mm and 40 mm to the sides are 50 mm, at 100 mm/s; 90 degrees at 45 degrees/s take 2 s."""
    script = "interpolation = 'smooth'\n[[steps]]\nbase_translation = [30.0, 40.0, 0.0]\nbase_speed = 100.0\n"
    script += "base_rotation = [0.0, 0.0, 90.0]\nbase_turning_speed = 45.0\n"
    asked = follow(controller_of(tmp_path, script), 2.5)
    np.testing.assert_allclose(np.asarray(asked[0.25].base_translation), [15.0, 20.0, 0.0], rtol=1e-12)
    np.testing.assert_allclose(np.asarray(asked[0.5].base_translation), [30.0, 40.0, 0.0], rtol=1e-12)
    np.testing.assert_allclose(np.asarray(asked[0.5].base_rotation), [0.0, 0.0, np.pi / 8], rtol=1e-12)
    np.testing.assert_array_equal(asked[2.5].base_rotation, [0.0, 0.0, np.pi / 2])


def test_a_smooth_duration_follows_its_cubic(tmp_path: Path) -> None:
    script = "interpolation = 'smooth'\n[[steps]]\npressure = 40.0\nduration = 1.0"
    asked = follow(controller_of(tmp_path, script), 1.0)
    for share in (0.1, 0.25, 0.5, 0.9):
        assert pressures(asked[share])[0] == pytest.approx(40.0 * (3 * share**2 - 2 * share**3), rel=1e-6)


def test_steps_do_not_drift_with_the_time_step(tmp_path: Path) -> None:
    """Each of 30 steps of 0.025 s ends between two time steps of 0.01 s: together they take 0.75 s all the same."""
    script = "[[steps]]\nhold = 0.025\n" * 30
    asked = follow(controller_of(tmp_path, script), 0.8)
    assert asked[0.74].signals["script_step"] == 29.0
    assert asked[0.75].signals["script_step"] == 30.0


@pytest.mark.parametrize("count", range(1, 101))
def test_a_step_ends_with_the_time_step_that_ends_with_it(tmp_path: Path, count: int) -> None:
    """Although times are sums of 0.01 s, such as 0.8900000000000006 s or 0.07999999999999999 s."""
    asked = follow(controller_of(tmp_path, f"[[steps]]\nhold = {count * 0.01:.2f}"), 1.0)
    assert asked[round(0.01 * (count - 1), 6)].signals["script_step"] == 0.0
    assert asked[round(0.01 * count, 6)].signals["script_step"] == 1.0


def test_it_goes_on_from_where_it_is(tmp_path: Path) -> None:
    controller = controller_of(tmp_path, "[[steps]]\npressure = { left = 20.0 }\nduration = 0.1")
    reached = {"left.base": 4.0, "left.tip": 5.0, "right.base": 6.0}
    first = controller.control(observation(7.0, pressures=reached, base_translation=np.array([1.0, 2.0, 3.0])))
    assert pressures(first) == pytest.approx([4.0, 5.0, 6.0], abs=1e-6)
    last = controller.control(observation(7.2, pressures=reached))
    assert pressures(last) == [20.0, 20.0, 6.0]
    np.testing.assert_array_equal(last.base_translation, [1.0, 2.0, 3.0])


def test_where_limits_hold_back_it_stops_at_what_was_reached(tmp_path: Path) -> None:
    """The script ran ahead of a slower scene: to stop at what it asked for would be to go on."""
    controller = controller_of(tmp_path, UNTIL)
    controller.control(observation(0.0))
    controller.control(observation(0.3))
    held_back = {"left.base": 4.0, "left.tip": 15.0, "right.base": 15.0}
    stopped = controller.control(observation(0.31, force=61.0, pressures=held_back, clipped=("left.base",)))
    assert pressures(stopped) == pytest.approx([4.0, 15.0, 15.0])


def test_a_pressure_scales_targets_and_rates(tmp_path: Path) -> None:
    asked = follow(controller_of(tmp_path, UNTIL, pressure=160.0), 0.5, touches_at(0.4))
    assert pressures(asked[0.1]) == pytest.approx([10.0] * 3)
    assert pressures(asked[0.5]) == pytest.approx([39.0] * 3)
    asked = follow(controller_of(tmp_path, "[[steps]]\npressure = 20.0\nduration = 0.1", pressure=30.0), 0.2)
    assert pressures(asked[0.2]) == pytest.approx([30.0] * 3)


def test_a_reset_begins_anew(tmp_path: Path) -> None:
    controller = controller_of(tmp_path, UNTIL)
    before = follow(controller, 1.2, touches_at(0.4))
    controller.reset(made_up_model())
    after = follow(controller, 1.2, touches_at(0.4))
    assert [pressures(control) for control in after.values()] == [pressures(control) for control in before.values()]


def test_the_closing_table_says_when_each_step_was_made(tmp_path: Path) -> None:
    controller = controller_of(tmp_path, UNTIL + "[[steps]]\nhold = 1.0")
    follow(controller, 0.8, touches_at(0.4))
    assert controller.summary() == {
        "steps.0 'close'": "0.00 to 0.50 s",
        "steps.1 'lift'": "from 0.50 s, not done",
        "steps.2": "not begun",
    }


PLACE = st.floats(-100.0, 100.0, allow_subnormal=False)  # which Taichi flushes to zero


@given(
    st.lists(st.tuples(PLACE, PLACE, st.floats(0.0, 5.0, allow_subnormal=False)), min_size=1, max_size=5),
    st.booleans(),
    st.floats(0, 6, allow_subnormal=False),
)
def test_a_way_begins_at_its_start_stays_between_and_ends_at_its_target(
    ways: list[tuple[float, float, float]], smooth: bool, elapsed: float
) -> None:
    start, target, durations = (np.array(column) for column in zip(*ways, strict=True))
    way = Ramp(start, target, durations, smooth)
    assert way.at(way.length).tolist() == target.tolist()
    assert np.where(durations > 0.0, way.at(0.0), start).tolist() == start.tolist()
    values = way.at(elapsed)
    assert (values >= np.minimum(start, target) - 1e-12).all() and (values <= np.maximum(start, target) + 1e-12).all()


FRAMES = {
    "jaw": {"follows": "base"},
    "lid": {"hinge": {"axis": [0.0, 2.0, 0.0]}},
    "belt": {"path": {"times": [0.0, 1.0], "rotations": [[0.0, 0.0, 0.0], [0.0, 0.0, 9.0]]}},
}


def seen_at(time: float, **changes: Any) -> Observation:
    """What is seen of FRAMES at rest."""
    rest = dict.fromkeys(FRAMES, np.zeros(3))
    return observation(time, frame_translations=rest, frame_rotations=rest, **changes)


def test_frames_go_to_their_targets_at_their_speeds(tmp_path: Path) -> None:
    """5 mm at 10 mm/s, and 180 degrees of a hinge at 90 degrees/s; a later step moves one, the other stays."""
    script = """
    [[steps]]
    frames.jaw = { translation = [3.0, 4.0, 0.0], speed = 10.0 }
    frames.lid = { angle = 180.0, turning_speed = 90.0 }
    [[steps]]
    frames.jaw.rotation = [0.0, 0.0, 90.0]
    duration = 1.0
    """
    controller = controller_of(tmp_path, script, model=made_up_model(frames=FRAMES))
    asked = {time: controller.control(seen_at(time)) for time in (0.0, 0.25, 1.0, 2.0, 2.5, 4.0)}
    np.testing.assert_allclose(asked[0.25].frame_translation["jaw"], [1.5, 2.0, 0.0])
    assert asked[1.0].frame_angle == {"lid": pytest.approx(np.pi / 2)}
    np.testing.assert_allclose(asked[2.5].frame_rotation["jaw"], [0.0, 0.0, np.pi / 4])
    np.testing.assert_allclose(asked[4.0].frame_translation["jaw"], [3.0, 4.0, 0.0])
    assert asked[4.0].frame_angle == {"lid": pytest.approx(np.pi)}


@pytest.mark.parametrize(
    ("frames", "message"),
    [
        ("jow = { translation = [1.0, 0.0, 0.0] }", "frames: no frame that scripts can move is called 'jow'"),
        ("belt = { translation = [1.0, 0.0, 0.0] }", "frames: no frame that scripts can move is called 'belt'"),
        ("jaw = { angle = 1.0 }", "frames: 'jaw' has no hinge; give translation or rotation"),
        ("lid = { rotation = [1.0, 0.0, 0.0] }", "frames: 'lid' has a hinge; give angle"),
    ],
)
def test_frames_that_cannot_move_so_are_refused(tmp_path: Path, frames: str, message: str) -> None:
    for script in ("steps = [{{ duration = 1.0, {} }}]", "keyframes = [{{ time = 1, pressure = 1.0, {} }}]"):
        with pytest.raises(SceneError, match=message):
            controller_of(tmp_path, script.format(f"frames = {{ {frames} }}"), model=made_up_model(frames=FRAMES))
