"""The lift's profile, and the set point that grows when the object slips, against their definitions."""

import itertools

import numpy as np
import pytest
from conftest import examples
from hypothesis import given
from hypothesis import strategies as st

from taichisoft_controllers.closed_loop import GripSetPoint, LiftProfile
from taichisoft_controllers.grasp_sensing import SensedGrasp


def heights(profile: LiftProfile, period: float, count: int) -> np.ndarray:
    return np.array([profile.advance(period, waits=False) for _ in range(count)])


def test_the_lift_is_the_minimum_jerk_profile() -> None:
    """Half way at half time; fastest there, with 15/8 of the mean speed; no speed and no acceleration at both ends."""
    period = 1e-4
    way = heights(LiftProfile(5.0, 35.0, 2.0, 0.1), period, 25000)
    speed = np.diff(way) / period
    assert way[9999] == pytest.approx(20.0, abs=1e-9)
    assert speed.max() == pytest.approx(15.0 / 8.0 * 30.0 / 2.0, rel=1e-6)
    assert abs(np.argmax(speed) - 10000) <= 10  # the maximum is flat
    assert (way[20000:] == 35.0).all() and (speed >= -1e-9).all()
    for end in (slice(0, 20), slice(19970, 19999)):
        assert abs(speed[end]).max() < 1e-3
        assert abs(np.diff(speed[end]) / period).max() < 1.0  # against 43 mm/s^2 on the way


@given(periods=st.lists(st.floats(1e-3, 0.2), min_size=1, max_size=40))
def test_the_lift_does_not_depend_on_when_it_is_asked(periods: list[float]) -> None:
    asked, once = LiftProfile(0.0, 30.0, 2.0, 0.1), LiftProfile(0.0, 30.0, 2.0, 0.1)
    for period in periods:
        height = asked.advance(period, waits=False)
    assert height == pytest.approx(once.advance(sum(periods), waits=False), abs=1e-9)


def test_a_lift_that_waits_comes_to_rest_and_goes_on_from_there() -> None:
    """It stops within the time constant T of waiting: after v T more, with what is left of v falling by exp(-t/T)."""
    profile, period = LiftProfile(0.0, 30.0, 2.0, 0.1), 1e-3
    way = heights(profile, period, 1000)
    speed = (way[-1] - way[-2]) / period
    stopped = np.array([profile.advance(period, waits=True) for _ in range(2000)])
    assert stopped[-1] - way[-1] == pytest.approx(0.1 * speed, rel=0.02)
    assert stopped[-1] - stopped[1000] < 1e-3
    rest = heights(profile, period, 1500)
    assert not any(later < earlier for earlier, later in itertools.pairwise(rest))
    assert rest[-1] == 30.0 and profile.finished


def grasp(force: float, slip_speed: float) -> SensedGrasp:
    return SensedGrasp(0.0, 50.0, force, (), slip_speed, False, 0.0, 0.0)


def made(force: float) -> GripSetPoint:
    return GripSetPoint(force, margin=1.5, slip_speed=1.0)


def test_the_set_point_stays_while_nothing_slips() -> None:
    set_point = made(500.0)
    assert not any(set_point.watch(grasp(force, 0.9), can_follow=True) for force in (0.0, 500.0, 900.0))
    assert (set_point.force, set_point.raised_count) == (500.0, 0)


@examples(40)
@given(needed=st.floats(10.0, 5000.0), share=st.floats(0.02, 1.0))
def test_an_object_that_slips_below_some_force_is_held_with_the_margin_over_it(needed: float, share: float) -> None:
    """The force follows by a share of the error at each call; the object slips whenever the force is below `needed`.

    The last force at which it slips lies below `needed`, by no more than the force grows from one call to the next.
    """
    set_point, force = made(400.0), 400.0
    for _ in range(1000):
        set_point.watch(grasp(force, 5.0 if force < needed else 0.0), can_follow=True)
        force += share * (set_point.force - force)
    least = 1.5 * needed / (1.0 + 0.5 * share) if needed > 400.0 else 0.0
    assert max(400.0, least * (1.0 - 1e-9)) <= set_point.force <= max(400.0, 1.5 * needed)
    assert set_point.raised_count == (needed > 400.0)  # once, however long it slipped


def test_a_force_that_cannot_follow_leaves_the_set_point_where_it_is() -> None:
    set_point = made(500.0)
    assert set_point.watch(grasp(490.0, 5.0), can_follow=False)
    assert set_point.force == 500.0
