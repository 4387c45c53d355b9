"""A run whose script moves the base nearly until the end says at its start that nothing can be seen to be held."""

import contextlib
import warnings
from pathlib import Path

import pytest
from made_up import controller_of, made_up_model, observation

from taichisoft import Output, Simulation, load_scene, make_controller, run
from taichisoft.errors import GoalMissed
from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft_outputs.metrics import MetricsOutput

KEYFRAMES = """
keyframes = [
    { time = 0.1, pressure = 5.0 },
    { time = 0.3, pressure = 9.0, base_translation = [0.0, 0.0, 5.0] },
    { time = 0.6, pressure = 8.0, base_translation = [0.0, 0.0, 5.0] },
]
"""
STEPS = """
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
        (KEYFRAMES, 0.3),
        ("keyframes = [{ time = 0.1, pressure = 5.0 }, { time = 0.3, pressure = 9.0 }]", 0.0),
        ("keyframes = [{ time = 0.1, pressure = 5.0, base_translation = [0.0, 0.0, 5.0] }]", 0.0),
        (STEPS, 0.2 + 0.1 + 0.05 + 0.1),  # as if the condition were true at once; 5 mm at 50 mm/s
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
    script.write_text(KEYFRAMES)
    overrides = [f"controller.settings.script={script}", f'goal={{object="cube", hold=0.2, {goal}}}']
    scene = load_scene(TINY_GRIPPER, overrides)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        with contextlib.suppress(GoalMissed):
            run(Simulation(scene), make_controller(scene), outputs, duration)
    return [str(one.message) for one in caught if "moves the base" in str(one.message)]


def test_a_hold_that_ends_within_its_own_measuring_time_is_said_at_the_start(tmp_path: Path) -> None:
    expected = (
        "the controller moves the base until 0.3 s, and the run ends at 0.4 s: 'cube' counts as held only if it stands "
        "still for the last 0.2 s (goal.hold), so a duration of 0.5 s or more is needed"
    )
    assert said(tmp_path, 0.4, [MetricsOutput(tmp_path)]) == [expected]
    assert said(tmp_path, 0.5, [MetricsOutput(tmp_path)]) == []


def test_it_is_not_said_where_nothing_is_judged(tmp_path: Path) -> None:
    assert said(tmp_path, 0.4, []) == []
    assert said(tmp_path, 0.4, [MetricsOutput(tmp_path)], 'kind="lifted", height=2.0') == []
