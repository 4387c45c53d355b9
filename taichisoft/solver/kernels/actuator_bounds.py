"""Bounds of actuator rows in the constraint problem: imposed coordinates, stops and cable friction.

With v the rate of the coordinate after the step less a target rate, and l the impulse of its effort (pressure or
tension times the time step), a row has three conditions, each overruled by the next:

- l is the preferred impulse;
- v lies between two ends, both 0 for an imposed coordinate;
- l stays within its own range: a cable does not push, a motor has a largest force.

A row of friction belongs to an inner point of a cable. Its l is the tension lost at the point, times the time step,
and its v the rate at which the length beyond the point grows. Euler's and Eytelwein's law for a rope around a post
bounds the ratio of the tensions on both sides by exp(mu theta), theta being the angle by which the cable turns: with T
the tension on the pulled side and g = exp(mu theta) - 1, -T g <= l <= T g / (1 + g), and l opposes the sliding.
"""

from taichisoft.runtime.language import Scalars, ScalarTable, func, ti

# Columns of the table of bounds. GRIP is g for a row of friction, which uses no other column, and -1 for other rows.
PREFERRED, LOWER_END, UPPER_END, LOWEST, HIGHEST, GRIP = range(6)
BOUND_COLUMNS = 6
# End at which a coordinate is held.
NOT_HELD, AT_LOWER_END, AT_UPPER_END = range(3)


@func
def tension_before(bounds: ScalarTable, a: ti.i32, first_row: ti.i32, impulse: Scalars) -> ti.f64:
    """Tension on the pulled side of the inner point of actuator row a, times the time step; 0 for other rows.

    The impulses of the actuators begin at `first_row`. The row of the cable itself and the rows of the inner points
    before this one directly precede row a.
    """
    tension = 0.0
    if bounds[a, GRIP] >= 0.0:
        above = a - 1
        while bounds[above, GRIP] >= 0.0:
            tension -= impulse[first_row + above]
            above -= 1
        tension += impulse[first_row + above]
    return tension


@func
def best_impulse(
    bounds: ScalarTable, a: ti.i32, impulse: ti.f64, velocity: ti.f64, compliance: ti.f64, tension: ti.f64
) -> ti.f64:
    """Impulse of row a that obeys its bounds with all others fixed; `velocity` belongs to the present `impulse`.

    `tension` is the result of `tension_before`.
    """
    best = impulse + (bounds[a, LOWER_END] - velocity) / compliance
    lowest, highest = bounds[a, LOWEST], bounds[a, HIGHEST]
    if bounds[a, GRIP] >= 0.0:
        size = ti.abs(tension)
        lowest = -size * bounds[a, GRIP]
        highest = size * bounds[a, GRIP] / (1.0 + bounds[a, GRIP])
    else:
        at_upper_end = impulse + (bounds[a, UPPER_END] - velocity) / compliance
        best = ti.max(best, ti.min(bounds[a, PREFERRED], at_upper_end))
    return ti.max(lowest, ti.min(best, highest))


@func
def held_end(bounds: ScalarTable, a: ti.i32, impulse: ti.f64, velocity: ti.f64, compliance: ti.f64) -> ti.i32:
    """Whether v determines l of row a: AT_LOWER_END or AT_UPPER_END; not for rows of friction.

    NOT_HELD: the impulse is a bound or the preferred impulse.
    """
    at_lower_end = impulse + (bounds[a, LOWER_END] - velocity) / compliance
    at_upper_end = impulse + (bounds[a, UPPER_END] - velocity) / compliance
    lowest, highest, preferred = bounds[a, LOWEST], bounds[a, HIGHEST], bounds[a, PREFERRED]
    where = NOT_HELD
    if preferred <= at_lower_end:
        if lowest < at_lower_end and at_lower_end < highest:
            where = AT_LOWER_END
    elif preferred >= at_upper_end and lowest < at_upper_end and at_upper_end < highest:
        where = AT_UPPER_END
    return where


@func
def sliding_share(
    bounds: ScalarTable, a: ti.i32, impulse: ti.f64, velocity: ti.f64, compliance: ti.f64, tension: ti.f64
) -> ti.f64:
    """Share of the tension that is lost at the point of friction row a while the cable slides; 0 while it sticks.

    Negative while the cable is paid out. The arguments are as for `best_impulse`.
    """
    sticking = impulse - velocity / compliance
    share = 0.0
    if sticking >= ti.abs(tension) * bounds[a, GRIP] / (1.0 + bounds[a, GRIP]):
        share = bounds[a, GRIP] / (1.0 + bounds[a, GRIP])
    elif sticking <= -ti.abs(tension) * bounds[a, GRIP]:
        share = -bounds[a, GRIP]
    if tension < 0.0:
        share = -share
    return share
