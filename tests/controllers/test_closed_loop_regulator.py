"""The force regulator against closed forms: on plants whose answer to a PI regulator can be written down."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from taichisoft_controllers.closed_loop import ForceRegulator, by_pressure
from taichisoft_controllers.grasp_sensing import GraspSettings

GAIN = 40.0  # of the plants: force over pressure [mN/kPa], about that of the fingers
NEVER = 1e9  # [kPa/s] or [kPa]: a limit that is not met


def regulator(proportional: float, integral: float, rate: float = NEVER, highest: float = NEVER) -> ForceRegulator:
    settings = GraspSettings(proportional_gain=proportional, integral_gain=integral, pressure_rate=rate)
    return ForceRegulator(by_pressure(settings, 0.0, highest), settings.tracking_time)


def fingers(made: ForceRegulator, set_point: Callable[[float], float], period: float, duration: float, ceiling=NEVER):
    """Pressures and forces at every call, on a plant that answers within a call and cannot exceed `ceiling` [kPa]."""
    applied, pressures, forces = 0.0, [], []
    for call in range(round(duration / period)):
        force = GAIN * applied
        applied = min(made.command(set_point(call * period) - force, applied, period), ceiling)
        forces.append(force)
        pressures.append(applied)
    return np.array(pressures), np.array(forces)


def test_integral_action_takes_away_the_same_share_of_the_error_at_every_call() -> None:
    """Plant F(n+1) = k p(n), integral action alone: the error shrinks by the factor 1 - k K_i T at every call."""
    period, integral = 0.01, 0.25
    _, forces = fingers(regulator(0.0, integral), lambda time: 100.0, period, 0.5)
    shares = 1.0 - GAIN * integral * period
    np.testing.assert_allclose(100.0 - forces, 100.0 * shares ** np.arange(len(forces)), rtol=1e-9)


def test_the_step_response_is_that_of_the_time_constant_that_was_designed_for() -> None:
    """Plant T dF/dt = k p - F with K_p = T / (k T_c), K_i = 1 / (k T_c): F = S (1 - exp(-t / T_c)), no overshoot.

    The zero of the regulator cancels the plant's pole; sampling every 1 ms leaves an error of the order of 1 ms / T_c.
    """
    plant_time, wanted_time, period, set_point = 0.05, 0.2, 1e-3, 500.0
    made = regulator(plant_time / (GAIN * wanted_time), 1.0 / (GAIN * wanted_time))
    applied, force, largest = 0.0, 0.0, 0.0
    for call in range(2000):
        expected = set_point * (1.0 - math.exp(-call * period / wanted_time))
        largest = max(largest, abs(force - expected))
        applied = made.command(set_point - force, applied, period)
        force += (GAIN * applied - force) * (1.0 - math.exp(-period / plant_time))
    assert largest < 0.01 * set_point
    assert force == pytest.approx(set_point, rel=1e-3)


@pytest.mark.parametrize("of_scene", [False, True])
def test_it_leaves_a_limit_at_once_however_long_it_was_there(of_scene: bool) -> None:
    """Ten seconds at a limit of 50 kPa (2000 mN) with 4000 mN wanted, then 1000 mN: as fast as if nothing had been.

    Without back-calculation the integral would have grown by 0.16 * 2000 * 10 = 3200 kPa, and would need as long again.
    """
    settings = GraspSettings()
    made = regulator(settings.proportional_gain, settings.integral_gain, highest=NEVER if of_scene else 50.0)
    pressures, forces = fingers(made, lambda time: 4000.0 if time < 10.0 else 1000.0, 0.01, 11.5, ceiling=50.0)
    assert pressures[:1000].max() == 50.0 and forces[999] == 2000.0
    after = forces[1000:]
    assert after.min() > 0.9 * 1000.0  # it does not fall far below the set point
    assert (abs(after[80:] - 1000.0) < 20.0).all()  # and is there within 0.8 s, five time constants


def test_it_starts_from_the_pressure_that_it_takes_over() -> None:
    made = regulator(0.005, 0.16)
    made.start(30.0, 250.0)
    assert made.command(250.0, 30.0, 1e-6) == pytest.approx(30.0, abs=1e-4)


@given(
    errors=st.lists(st.floats(-5000.0, 5000.0), min_size=1, max_size=60),
    period=st.floats(0.001, 0.1),
    rate=st.floats(1.0, 500.0),
)
def test_the_pressure_never_leaves_its_range_nor_changes_faster_than_its_rate(
    errors: list[float], period: float, rate: float
) -> None:
    made, applied = regulator(0.005, 0.16, rate=rate, highest=105.0), 0.0
    for error in errors:
        asked = made.command(error, applied, period)
        assert 0.0 <= asked <= 105.0
        assert abs(asked - applied) <= rate * period * (1.0 + 1e-12)
        applied = asked


@pytest.mark.parametrize("period", [0.005, 0.01, 0.02, 0.05])
@pytest.mark.parametrize("gain", [20.0, 40.0, 60.0, 90.0])
def test_the_tuning_settles_for_all_gains_of_the_fingers_and_all_sensible_periods(gain: float, period: float) -> None:
    """20 to 50 mN/kPa with the coarse mesh, to 90 with the medium one; some 80 % of an answer come within a step."""
    settings = GraspSettings()
    made = regulator(settings.proportional_gain, settings.integral_gain, rate=settings.pressure_rate, highest=105.0)
    applied = pressed = highest = 0.0
    for _ in range(round(4.0 / period)):
        force = gain * pressed
        highest = max(highest, force)
        applied = made.command(800.0 - force, applied, period)
        pressed += (applied - pressed) * (1.0 - math.exp(-period / 0.01))
    assert force == pytest.approx(800.0, rel=0.01)
    assert highest < 1.35 * 800.0
