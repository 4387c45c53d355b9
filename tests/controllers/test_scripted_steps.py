"""Scripts of steps: their ways, what they wait for, and cables that they pull."""

import contextlib
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_up import CAVITIES, controller_of, follow, made_up_model, observation, pressures, refusal

from taichisoft import Control, Controller, Observation, Output, Simulation, load_scene, make_controller, run
from taichisoft.errors import ControllerFailed, GoalMissed, SceneError
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft_controllers.script_targets import Ramp
from taichisoft_gym.baselines import carry
from taichisoft_outputs.metrics import MetricsOutput

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


def test_pressure_rises_at_its_rate_until_the_condition(tmp_path: Path) -> None:
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


def test_reached_target_is_kept_until_the_condition(tmp_path: Path) -> None:
    asked = follow(controller_of(tmp_path, UNTIL.replace("80.0", "10.0")), 1.0, touches_at(0.8))
    assert pressures(asked[0.5]) == pressures(asked[0.9]) == [10.0] * 3
    assert asked[0.89].signals["script_step"] == 0.0


def test_a_condition_that_is_true_from_the_start_changes_nothing(tmp_path: Path) -> None:
    asked = follow(controller_of(tmp_path, UNTIL), 0.2, touches_at(0.0))
    assert pressures(asked[0.2]) == [0.0] * 3
    assert asked[0.11].signals["script_step"] == 1.0


def test_missed_condition_fails_the_run_with_its_value(tmp_path: Path) -> None:
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


def test_timeout_counts_from_the_start_of_its_step(tmp_path: Path) -> None:
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


def test_a_step_ends_with_the_time_step_that_ends_with_it(tmp_path: Path) -> None:
    """Although times are sums of 0.01 s, such as 0.8900000000000006 s or 0.07999999999999999 s."""
    for count in range(1, 101):
        asked = follow(controller_of(tmp_path, f"[[steps]]\nhold = {count * 0.01:.2f}"), 1.0)
        assert asked[round(0.01 * (count - 1), 6)].signals["script_step"] == 0.0, count
        assert asked[round(0.01 * count, 6)].signals["script_step"] == 1.0, count


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
def test_ramp_stays_between_its_start_and_target(
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


# Scripts that pull cables: by pull or by tension, for all of them or for some, beside pressures or without any.

LEFT, RIGHT = CABLES = ("left.tendon", "right.tendon")
STEPS = """
[[steps]]
name = "close"
pull = 20.0
pull_speed = 10.0
until = "tension > 500"
timeout = 3.0

[[steps]]
name = "hold"
tension = { left = 800.0 }
tension_rate = 1000.0
"""


def model(cavities: tuple[str, ...] = ()) -> Any:
    return made_up_model(cavities, cables={name: {} for name in CABLES})


def ask(
    controller: Controller, time: float, tension: float = 0.0, pull: float = 0.0, clipped: tuple[str, ...] = ()
) -> Control:
    """What it asks for where all cables have a tension [mN] and a pull [mm]."""
    seen = {"cable_tensions": dict.fromkeys(CABLES, tension), "cable_pulls": dict.fromkeys(CABLES, pull)}
    return controller.control(observation(time, clipped=clipped, **seen))


def test_cables_are_pulled_at_their_speed_to_the_tension(tmp_path: Path) -> None:
    controller = controller_of(tmp_path, STEPS, model=model())
    assert ask(controller, 0.0).cable_pull == {LEFT: 0.0, RIGHT: 0.0}
    control = ask(controller, 0.5)
    assert control.cable_pull == pytest.approx({LEFT: 5.0, RIGHT: 5.0})
    assert not control.pressure and not control.cable_tension
    assert ask(controller, 0.51, tension=501.0).cable_pull == pytest.approx({RIGHT: 5.0})  # what was asked for last


def test_cable_with_another_drive_continues_from_its_value(tmp_path: Path) -> None:
    """The tension rises from 501 mN that were there, not from 0; the other cable stays as it was."""
    controller = controller_of(tmp_path, STEPS, model=model())
    ask(controller, 0.0)
    ask(controller, 0.5)
    begun = ask(controller, 0.51, tension=501.0)
    assert begun.cable_tension == pytest.approx({LEFT: 501.0}, abs=1e-5)
    later = ask(controller, 0.61, tension=501.0)
    assert later.cable_tension == pytest.approx({LEFT: 601.0})
    assert later.cable_pull == pytest.approx({RIGHT: 5.0})


def test_before_a_step_names_it_nothing_is_asked_of_a_cable(tmp_path: Path) -> None:
    """So a run goes on from a state in which its cables were driven in whatever way."""
    script = "[[steps]]\nhold = 0.5\n[[steps]]\npull = { right.tendon = 2.0 }\npull_speed = 10.0"
    controller = controller_of(tmp_path, script, model=model(CAVITIES))
    first = ask(controller, 0.0, pull=7.0)
    assert not first.cable_pull and not first.cable_tension and set(first.pressure) == set(CAVITIES)
    assert ask(controller, 0.5, pull=7.0).cable_pull == {RIGHT: 7.0}
    assert ask(controller, 0.6, pull=7.0).cable_pull == pytest.approx({RIGHT: 6.0})


def test_cables_stop_where_limits_hold_them_back(tmp_path: Path) -> None:
    controller = controller_of(tmp_path, STEPS.partition('[[steps]]\nname = "hold"')[0], model=model())
    ask(controller, 0.0)
    ask(controller, 1.0)
    stopped = ask(controller, 1.01, tension=501.0, pull=4.0, clipped=(LEFT,))
    assert stopped.cable_pull == pytest.approx({LEFT: 4.0, RIGHT: 10.0})


def test_settings_scale_targets_and_rates(tmp_path: Path) -> None:
    controller = controller_of(tmp_path, STEPS, model=model(), pull=40.0)
    ask(controller, 0.0)
    assert ask(controller, 0.5).cable_pull == pytest.approx({LEFT: 10.0, RIGHT: 10.0})


KEYFRAMES = """
[[keyframes]]
time = 0.0
pressure = 0.0
pull = { left = 0.0 }
tension = { right = 100.0 }
[[keyframes]]
time = 1.0
pressure = 10.0
pull = { left = 8.0 }
tension = { right = 300.0 }
"""
CSV = """\
time [s], pressure [kPa], pull left [mm], tension right.tendon [mN]
0,        0,              0,              100
1,        10,             8,              300
"""


@pytest.mark.parametrize(("content", "name"), [(KEYFRAMES, "script.toml"), (CSV, "script.csv")])
def test_keyframes_have_pulls_and_tensions(tmp_path: Path, content: str, name: str) -> None:
    control = ask(controller_of(tmp_path, content, name, model=model(CAVITIES)), 0.25)
    assert control.pressure == dict.fromkeys(CAVITIES, 2.5)
    assert (control.cable_pull, control.cable_tension) == ({LEFT: 2.0}, {RIGHT: 150.0})


def test_cables_that_no_keyframe_names_are_left_alone(tmp_path: Path) -> None:
    control = ask(controller_of(tmp_path, "time,pressure\n0,0", "script.csv", model=model()), 0.0)
    assert not control.cable_pull and not control.cable_tension and not control.pressure


def frames(*contents: str) -> str:
    return "keyframes = [" + ", ".join(f"{{ time = {n}, {content} }}" for n, content in enumerate(contents)) + "]"


@pytest.mark.parametrize(
    ("script", "message"),
    [
        (frames("pull = {}"), "keyframes.0.pull: names no finger or cable"),
        (frames("pull = { left = '1' }"), "keyframes.0.pull: left = '1' must be a finite number [mm]"),
        (frames("tension = { left.tendon = inf }"), "left.tendon = inf must be a finite number [mN]"),
        (frames("pull = { leg = 1.0 }"), "keyframes.0.pull: no finger or cable is called 'leg'"),
        (
            frames("pull = 1.0", "pull = { left = 2.0 }"),
            "keyframes.1.pull: does not name 'right.tendon'; a keyframe has the pull of every cable that another one",
        ),
        (frames("pull = 1.0", "tension = 2.0"), "'left.tendon' is given a pull and a tension; keyframes have one of"),
        (
            frames("base_translation = [1.0, 0.0, 0.0]"),
            "keyframes.0: needs at least one of pressure, valve, pull, tension",
        ),
        (frames("pressure = 5.0"), "keyframes.0.pressure: the scene has no finger or cavity"),
        ("steps = [{ pull = 1.0 }]", "steps.0: pull needs a duration [s] or a pull_speed [mm/s]"),
        ("steps = [{ tension = 1.0 }]", "steps.0: tension needs a duration [s] or a tension_rate [mN/s]"),
        (
            "steps = [{ pull = 1.0, tension = { left = 2.0 }, duration = 1.0 }]",
            "steps.0: 'left.tendon' is given a pull and a tension; give one of them",
        ),
    ],
)
def test_what_is_wrong_is_refused_in_one_line(tmp_path: Path, script: str, message: str) -> None:
    assert message in refusal(tmp_path / "script.toml", lambda _: controller_of(tmp_path, script, model=model()))


def test_a_pull_in_a_scene_without_cables_is_refused(tmp_path: Path) -> None:
    script = "steps = [{ pull = 1.0, duration = 1.0 }]"
    said = refusal(tmp_path / "script.toml", lambda _: controller_of(tmp_path, script))
    assert said == "steps.0.pull: the scene has no finger or cable"


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("time,pull [kPa]\n0,1", "column 'pull [kPa]': its unit is mm, not kPa"),
        ("time,pull,pull left\n0,1,1", "the columns 'pull' and 'pull left' exclude each other"),
    ],
)
def test_a_wrong_table_is_refused(tmp_path: Path, table: str, message: str) -> None:
    said = refusal(tmp_path / "script.csv", lambda _: controller_of(tmp_path, table, "script.csv", model=model()))
    assert said == message


# A run whose script moves the base nearly until the end says at its start that nothing can be seen to be held.

LATE_KEYFRAMES = """
keyframes = [
    { time = 0.1, pressure = 5.0 },
    { time = 0.3, pressure = 9.0, base_translation = [0.0, 0.0, 5.0] },
    { time = 0.6, pressure = 8.0, base_translation = [0.0, 0.0, 5.0] },
]
"""
LATE_STEPS = """
steps = [
    { pressure = 9.0, duration = 0.2, hold = 0.1 },
    { until = "contact_force > 1", timeout = 3.0, hold = 0.05 },
    { base_translation = [0.0, 0.0, 5.0], base_speed = 50.0, pressure = 9.5, pressure_rate = 1.0 },
    { base_translation = [0.0, 0.0, 5.0], duration = 4.0 },
    { pressure = 9.0, duration = 0.2 },
]
"""


@pytest.mark.parametrize(
    ("script", "stops"),
    [
        (LATE_KEYFRAMES, 0.3),
        ("keyframes = [{ time = 0.1, pressure = 5.0 }, { time = 0.3, pressure = 9.0 }]", 0.0),
        ("keyframes = [{ time = 0.1, pressure = 5.0, base_translation = [0.0, 0.0, 5.0] }]", 0.0),
        (LATE_STEPS, 0.2 + 0.1 + 0.05 + 0.1),  # as if the condition were true at once; 5 mm at 50 mm/s
        ("steps = [{ hold = 1.0 }]", 0.0),
    ],
)
def test_a_script_knows_when_the_base_stops(tmp_path: Path, script: str, stops: float) -> None:
    controller = controller_of(tmp_path, script)
    controller.reset(made_up_model())
    assert controller.base_stops_at(observation(0.0)) == pytest.approx(stops)
    assert controller.base_stops_at(observation(7.0)) >= 7.0  # a run that goes on


def said(folder: Path, duration: float, outputs: list[Output], goal: str = 'kind="held"') -> list[str]:
    """What a run warns of."""
    script = folder / "script.toml"
    script.write_text(LATE_KEYFRAMES)
    overrides = [f"controller.settings.script={script}", f'goal={{object="cube", hold=0.2, {goal}}}']
    scene = load_scene(TINY_GRIPPER, overrides)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        with contextlib.suppress(GoalMissed):
            run(Simulation(scene), make_controller(scene), outputs, duration)
    return [str(one.message) for one in caught if "moves the base" in str(one.message)]


def test_hold_shorter_than_its_measurement_warns_at_start(tmp_path: Path) -> None:
    expected = (
        "the controller moves the base until 0.3 s, and the run ends at 0.4 s: 'cube' counts as held only if it stands "
        "still for the last 0.2 s (goal.hold), so a duration of 0.5 s or more is needed"
    )
    assert said(tmp_path, 0.4, [MetricsOutput(tmp_path)]) == [expected]
    assert said(tmp_path, 0.5, [MetricsOutput(tmp_path)]) == []


def test_it_is_not_said_where_nothing_is_judged(tmp_path: Path) -> None:
    assert said(tmp_path, 0.4, []) == []
    assert said(tmp_path, 0.4, [MetricsOutput(tmp_path)], 'kind="lifted", height=2.0') == []


# Carry-v0 can be solved: the scripted baseline closes, rises, crosses, sinks and lets go.

PHASES = (8, 6, 20, 10, 14)
"""Control periods of closing, rising, crossing, sinking and letting go."""


def test_a_scripted_policy_carries_the_cube_by_40_mm_and_lets_go() -> None:
    env = gymnasium.make("taichisoft_gym:taichisoft/Carry-v0")
    env.reset(seed=1, options={"target": (40.0, 0.0)})
    actions, ends = carry(env.unwrapped), []
    for periods in PHASES:
        for _ in range(periods):
            _, reward, terminated, _, told = env.step(next(actions).astype(np.float32))
            assert not terminated
        ends.append((reward, told))
        progress = np.clip(1.0 - told["distance"] / 40.0, -1.0, 1.0)
        arrived = told["distance"] < 5.0
        grip = 1.0 - told["touching"] if arrived else told["touching"]
        assert reward == pytest.approx(0.2 * grip + 0.8 * progress + told["is_success"])  # as documented
    closed, lifted, crossed, sunk, let_go = (told for _, told in ends)
    assert closed["touching"] == 1.0
    assert lifted["lift"] > 8.0
    assert crossed["lift"] > 8.0 and crossed["distance"] < 6.0
    assert sunk["lift"] < 1.0 and not sunk["is_success"]  # still held
    assert let_go["touching"] == 0.0 and let_go["is_success"]
    assert let_go["distance"] < 2.0
    rewards = [reward for reward, _ in ends]
    # A base that stops at once leaves the cube swinging: its place is as good before it sinks as after, to 1 mm of 40.
    assert rewards[:2] == sorted(rewards[:2]) and rewards[1] < min(rewards[2:4]) and max(rewards[2:4]) < rewards[4]
    assert rewards[2] == pytest.approx(rewards[3], abs=0.8 / 40.0)
