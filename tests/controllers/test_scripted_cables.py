"""Scripts that pull cables: by pull or by tension, for all of them or for some, beside pressures or without any."""

from pathlib import Path
from typing import Any

import pytest
from made_up import CAVITIES, controller_of, made_up_model, observation, refusal

from taichisoft import Control, Controller

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


def test_cables_are_pulled_in_at_their_speed_until_the_tension_is_there(tmp_path: Path) -> None:
    controller = controller_of(tmp_path, STEPS, model=model())
    assert ask(controller, 0.0).cable_pull == {LEFT: 0.0, RIGHT: 0.0}
    control = ask(controller, 0.5)
    assert control.cable_pull == pytest.approx({LEFT: 5.0, RIGHT: 5.0})
    assert not control.pressure and not control.cable_tension
    assert ask(controller, 0.51, tension=501.0).cable_pull == pytest.approx({RIGHT: 5.0})  # what was asked for last


def test_a_cable_that_is_driven_in_another_way_goes_on_from_where_it_is(tmp_path: Path) -> None:
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


def test_where_limits_hold_back_it_stops_at_what_was_reached(tmp_path: Path) -> None:
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
