"""The limits of a scene stand between what a controller asks for and what happens, and it is told so."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from taichisoft import Control, Simulation
from taichisoft.base.rotations import turn_towards
from taichisoft.errors import ControlError, SceneError
from taichisoft.scene import scene_from_dict

STEP = 0.01


@pytest.fixture
def limited(block: Callable[..., str]) -> Callable[..., Simulation]:
    """Makes a simulation of a hollow block held at one end, with limits."""

    def make(**limits: Any) -> Simulation:
        body = {
            "mesh": block((3, 3, 3), (20.0, 20.0, 20.0), hollow=True),
            "mass": 0.01,
            "young_modulus": 500,
            "poisson_ratio": 0.3,
            "anchors": [{"box": [[-10, -10, -10], [-10, 10, 10]]}],
            "cavities": {"air": {"group": "cavity"}},
        }
        scene = {"gravity": [0, 0, 0], "time": {"step": STEP}, "soft_bodies": {"block": body}, "limits": limits}
        return Simulation(scene_from_dict(scene))

    return make


def pressures(simulation: Simulation, requests: list[float | None]) -> list[float]:
    """What comes of a pressure asked for in each step, None for nothing asked for."""
    found = []
    for request in requests:
        control = Control() if request is None else Control(pressure={"block.air": request})
        found.append(simulation.step(control).observation.pressures["block.air"])
    return found


def test_pressures_stay_in_their_range(limited: Callable[..., Simulation]) -> None:
    simulation = limited(lowest_pressure=-1.0, highest_pressure=3.0)
    assert pressures(simulation, [2.0, 5.0, 3.0, -7.0]) == pytest.approx([2.0, 3.0, 3.0, -1.0], rel=1e-12)


def test_a_request_is_reached_at_the_rate_also_when_it_is_not_repeated(limited: Callable[..., Simulation]) -> None:
    simulation = limited(pressure_rate=100.0)
    assert pressures(simulation, [2.5, None, None, None]) == pytest.approx([1.0, 2.0, 2.5, 2.5], rel=1e-12)
    assert pressures(simulation, [0.0, None, None, None]) == pytest.approx([1.5, 0.5, 0.0, 0.0], abs=1e-12)


def test_after_a_volume_the_pressure_goes_on_from_where_it_is(limited: Callable[..., Simulation]) -> None:
    simulation = limited(pressure_rate=10.0)
    for _ in range(30):
        report = simulation.step(Control(volume_growth={"block.air": 20.0}))
    reached = report.observation.pressures["block.air"]
    assert reached > 0.2
    assert pressures(simulation, [0.0]) == pytest.approx([reached - 0.1], rel=1e-9)


def test_a_growth_of_volume_is_not_held_to_the_range_of_pressures(limited: Callable[..., Simulation]) -> None:
    simulation = limited(highest_pressure=1e-3)
    report = simulation.step(Control(volume_growth={"block.air": 20.0}))
    assert report.observation.clipped == ()


def test_the_base_moves_straight_at_its_speed(limited: Callable[..., Simulation]) -> None:
    simulation = limited(base_speed=100.0)
    goal = np.array([3.0, 4.0, 0.0])
    simulation.step(Control(base_translation=goal))
    np.testing.assert_allclose(simulation.state.base_translation, 0.2 * goal, rtol=1e-12)
    for _ in range(4):
        simulation.step()
    np.testing.assert_array_equal(simulation.state.base_translation, goal)


def test_a_velocity_goes_on_until_something_else_is_asked_for(limited: Callable[..., Simulation]) -> None:
    simulation = limited()
    simulation.step(Control(base_velocity=np.array([10.0, 0, 0]), base_angular_velocity=np.array([0, 0, 2.0])))
    simulation.step()
    np.testing.assert_allclose(simulation.state.base_translation, [0.2, 0, 0], rtol=1e-12)
    np.testing.assert_allclose(simulation.state.base_rotation, [0, 0, 0.04], rtol=1e-12)
    simulation.step(Control(base_velocity=np.zeros(3)))
    simulation.step(Control(base_rotation=np.zeros(3)))
    np.testing.assert_allclose(simulation.state.base_translation, [0.2, 0, 0], rtol=1e-12)
    np.testing.assert_array_equal(simulation.state.base_rotation, np.zeros(3))


def test_a_velocity_beyond_the_limit_does_not_run_ahead(limited: Callable[..., Simulation]) -> None:
    """The way that was not allowed is not made up for later."""
    simulation = limited(base_speed=5.0)
    for _ in range(10):
        simulation.step(Control(base_velocity=np.array([100.0, 0, 0])))
    assert simulation.state.base_translation[0] == pytest.approx(0.5, rel=1e-12)
    assert simulation.observe().clipped == ("base_translation",)
    simulation.step(Control(base_velocity=np.zeros(3)))
    assert simulation.state.base_translation[0] == pytest.approx(0.5, rel=1e-12)
    assert simulation.observe().clipped == ()


def test_the_base_turns_the_shortest_way_at_its_speed(limited: Callable[..., Simulation]) -> None:
    simulation = limited(base_turning_speed=500.0)
    simulation.step(Control(base_rotation=np.array([0, 0, np.radians(20.0)])))
    np.testing.assert_allclose(simulation.state.base_rotation, [0, 0, np.radians(5.0)], rtol=1e-12)
    assert simulation.report is not None and simulation.report.observation.clipped == ("base_rotation",)


def test_what_is_clipped_is_observed(limited: Callable[..., Simulation]) -> None:
    simulation = limited(highest_pressure=3.0, base_speed=1.0)
    simulation.step(Control(pressure={"block.air": 3.0}))
    assert simulation.observe().clipped == ()
    simulation.step(Control(pressure={"block.air": 4.0}, base_translation=np.ones(3)))
    assert simulation.observe().clipped == ("block.air", "base_translation")
    simulation.step(Control(pressure={"block.air": 1.0}))
    assert simulation.observe().clipped == ("base_translation",)


@pytest.mark.parametrize("pose", ["translation", "rotation"])
def test_a_pose_and_its_velocity_exclude_each_other(limited: Callable[..., Simulation], pose: str) -> None:
    velocity = {"translation": "base_velocity", "rotation": "base_angular_velocity"}[pose]
    control: dict[str, Any] = {f"base_{pose}": np.zeros(3), velocity: np.zeros(3)}
    with pytest.raises(ControlError, match=rf"^control: base_{pose} and {velocity} are both given"):
        limited().step(Control(**control))


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        ({"lowest_pressure": 5.0, "highest_pressure": 2.0}, r"lowest_pressure \(5\) must not exceed highest_pressure"),
        ({"pressure_rate": 0.0}, r"limits\.pressure_rate = 0"),
        ({"base_sped": 1.0}, r"limits\.base_sped: unknown key; did you mean 'base_speed'"),
    ],
)
def test_wrong_limits_are_refused(limited: Callable[..., Simulation], limits: dict[str, float], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        limited(**limits)


vectors = st.tuples(*[st.floats(-3.0, 3.0)] * 3).map(np.array)


@given(start=vectors, end=vectors, furthest=st.floats(1e-3, 2.0))
def test_a_turn_is_as_far_as_allowed_and_ends_where_it_should(
    start: np.ndarray, end: np.ndarray, furthest: float
) -> None:
    reached = turn_towards(start, end, furthest)
    whole = (Rotation.from_rotvec(end) * Rotation.from_rotvec(start).inv()).magnitude()
    made = (Rotation.from_rotvec(reached) * Rotation.from_rotvec(start).inv()).magnitude()
    left = (Rotation.from_rotvec(end) * Rotation.from_rotvec(reached).inv()).magnitude()
    assert made == pytest.approx(min(furthest, whole), abs=1e-9)
    assert left == pytest.approx(max(whole - furthest, 0.0), abs=1e-7)
