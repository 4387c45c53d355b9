"""A run is held back to its speed, never hurries afterwards, and says how fast it was."""

import math

import pytest

from taichisoft.running.session import LONGEST_DELAY, Pace


class Clock:
    """Time that passes when it is told to."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def steps(pace: Pace, clock: Clock, count: int, compute: float, time_step: float = 0.01) -> None:
    """Steps that take `compute` seconds each, and the waiting after them."""
    for _ in range(count):
        clock.now += compute
        clock.now += max(pace.seconds_to_wait(time_step), 0.0)


@pytest.mark.parametrize("speed", [0.5, 1.0, 3.0])
def test_fast_steps_are_held_back_to_speed(speed: float) -> None:
    clock = Clock()
    pace = Pace(speed, clock)
    steps(pace, clock, 300, compute=0.001)
    assert clock.now - 100.0 == pytest.approx(3.0 / speed)
    assert pace.real_time_factor == pytest.approx(speed)
    assert pace.mean_real_time_factor == pytest.approx(speed)
    assert pace.keeps_up


def test_without_speed_nothing_waits() -> None:
    clock = Clock()
    pace = Pace(None, clock)
    steps(pace, clock, 200, compute=0.02)
    assert clock.now - 100.0 == pytest.approx(4.0)
    assert pace.real_time_factor == pytest.approx(0.5)
    assert pace.keeps_up


def test_slow_steps_do_not_keep_up() -> None:
    clock = Clock()
    pace = Pace(1.0, clock)
    assert pace.keeps_up and math.isnan(pace.real_time_factor)
    steps(pace, clock, 200, compute=0.025)
    assert pace.real_time_factor == pytest.approx(0.4)
    assert not pace.keeps_up


def test_late_run_does_not_hurry_for_long() -> None:
    """After a step of 5 s at most LONGEST_DELAY seconds are made up for."""
    clock = Clock()
    pace = Pace(1.0, clock)
    steps(pace, clock, 1, compute=5.0)
    start = clock.now
    steps(pace, clock, 100, compute=0.001)
    assert clock.now - start >= 1.0 - LONGEST_DELAY


def test_pause_counts_for_nothing() -> None:
    clock = Clock()
    pace = Pace(1.0, clock)
    steps(pace, clock, 100, compute=0.001)
    clock.now += 60.0
    pace.restart()
    steps(pace, clock, 100, compute=0.001)
    assert pace.real_time_factor == pytest.approx(1.0)
    assert pace.mean_real_time_factor == pytest.approx(1.0)


def test_factor_is_that_of_last_second() -> None:
    clock = Clock()
    pace = Pace(None, clock)
    steps(pace, clock, 100, compute=0.1)
    steps(pace, clock, 300, compute=0.005)
    assert pace.real_time_factor == pytest.approx(2.0)
