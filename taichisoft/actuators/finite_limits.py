"""Ranges of actuators as pairs of finite numbers, also where a scene gives no limit."""

# Larger than any effort [kPa, mN] or coordinate [mm^3, mm]; kernels must not get infinities.
UNLIMITED = 1e30


def limits(low: float | None, high: float | None, unless_given: float = -UNLIMITED) -> tuple[float, float]:
    """A range; `unless_given` is the lower limit where there is none."""
    return unless_given if low is None else low, UNLIMITED if high is None else high
