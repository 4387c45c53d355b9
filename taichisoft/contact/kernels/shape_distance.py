"""Exact signed distances from round shapes, and the points of a shape that can touch a plane.

All shapes are convex, and so are their signed distances: along a segment there is one minimum, where the slope changes
sign.
"""

import math

from taichisoft.contact.kernels.round_shapes import MovedShapes, RoundShapes
from taichisoft.runtime.language import func, ti, vec3

# Position of a point: beside the axis, beyond an end of the axis, or (flat ends only) beyond both side and end.
SIDE, END, RIM = range(3)

TINY = 1e-12  # [mm]
HALVINGS = 60  # bisections of a segment, to the last bit

# An end whose rim is level with a plane to LEVEL [mm] stands on RIM_POINTS points, counted from the direction in which
# the load leans: without a lowest point a choice of few points would depend on round-off, and a standing cylinder rock.
LEVEL = 5e-4
RIM_POINTS = 16
# An end that faces a plane at more than 60 degrees to the axis stands on its lowest point and three others at quarter
# turns.
FACING = 0.5 * math.sqrt(3.0)
QUARTERS = 4


@func
def signed_distance(x: vec3, s: ti.i32, shapes: RoundShapes, there: MovedShapes):
    """Distance of x from shape s [mm], negative inside, its gradient (the outward normal), and SIDE, END or RIM."""
    axis, radius, half = there.axis[s], shapes.radius[s], shapes.half_length[s]
    away = x - there.centre[s]
    along = away.dot(axis)
    across = away - along * axis
    out = there.side[s]
    distance = 0.0
    where = SIDE
    if shapes.flat[s]:
        beside = across.norm()
        if beside > TINY:
            out = across / beside
        end = ti.select(along < 0.0, -1.0, 1.0) * axis
        side_gap, end_gap = beside - radius, ti.abs(along) - half
        if side_gap > 0.0 and end_gap > 0.0:
            where = RIM
            distance = ti.sqrt(side_gap * side_gap + end_gap * end_gap)
            out = (side_gap * out + end_gap * end) / distance
        elif end_gap > side_gap:
            where = END
            distance = end_gap
            out = end
        else:
            distance = side_gap
    else:
        if ti.abs(along) >= half:
            where = END
            across = away - ti.select(along < 0.0, -half, half) * axis
        length = across.norm()
        if length > TINY:
            out = across / length
        distance = length - radius
    return distance, out, where


@func
def lowest_along(a: vec3, b: vec3, s: ti.i32, shapes: RoundShapes, there: MovedShapes) -> ti.f64:
    """Fraction of the segment from a to b at the least signed distance from shape s, found by bisection."""
    low, high = 0.0, 1.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        _distance, out, _where = signed_distance(a + middle * (b - a), s, shapes, there)
        if out.dot(b - a) > 0.0:
            high = middle
        else:
            low = middle
    # The ends are exact.
    share = 0.5 * (low + high)
    if low == 0.0:
        share = 0.0
    if high == 1.0:
        share = 1.0
    return share


@func
def side_by_side(a: vec3, b: vec3, where: ti.i32, s: ti.i32, shapes: RoundShapes, there: MovedShapes):
    """Part of the segment from a to b beside the axis of s, or beyond its flat end: two fractions of the segment.

    If a segment lies along the side or on an end, the distance has no single minimum: both ends of this part touch.
    """
    axis, half, radius = there.axis[s], shapes.half_length[s], shapes.radius[s]
    start, way = a - there.centre[s], b - a
    first, last = 0.0, 1.0
    if where == SIDE:
        rise = way.dot(axis)
        if ti.abs(rise) > TINY:
            one, other = (-half - start.dot(axis)) / rise, (half - start.dot(axis)) / rise
            first, last = ti.max(0.0, ti.min(one, other)), ti.min(1.0, ti.max(one, other))
    else:
        start -= start.dot(axis) * axis
        way -= way.dot(axis) * axis
        if way.norm() > TINY:
            middle = -start.dot(way) / way.norm_sqr()
            left = radius * radius - (start + middle * way).norm_sqr()
            spread = ti.sqrt(ti.max(left, 0.0)) / way.norm()
            first, last = ti.max(0.0, middle - spread), ti.min(1.0, middle + spread)
    return first, last


@func
def ball_count(normal: vec3, s: ti.i32, shapes: RoundShapes, there: MovedShapes) -> ti.i32:
    """Number of balls that represent shape s against a plane with this normal, see `ball`."""
    count = 1
    if shapes.half_length[s] > 0.0:
        count = 2
    if shapes.flat[s]:
        rise = ti.abs(normal.dot(there.axis[s]))
        if rise > FACING:
            count = QUARTERS
            tilt = (normal - normal.dot(there.axis[s]) * there.axis[s]).norm()
            if 2.0 * shapes.radius[s] * tilt < LEVEL:
                count = RIM_POINTS
    return count


@func
def ball(k: ti.i32, count: ti.i32, normal: vec3, s: ti.i32, shapes: RoundShapes, there: MovedShapes):
    """Centre and radius [mm] of the k-th of `count` balls inside shape s that reach as far as s against `normal`.

    For round ends the balls are the ends themselves. For a cylinder they touch the rims at the points farthest against
    the normal, or at several points of an end that faces it.
    """
    axis, radius, half = there.axis[s], shapes.radius[s], shapes.half_length[s]
    centre = there.centre[s]
    ball_radius = radius
    if shapes.flat[s]:
        ball_radius = ti.min(radius, half)
        rise = normal.dot(axis)
        down = rise * axis - normal
        tilt = down.norm()
        direction = there.side[s]
        if tilt > TINY:
            direction = down / tilt
        end = ti.select(rise > 0.0, -half, half)
        if count == 2:
            if k == 1:
                end = -end
        else:
            if count == RIM_POINTS:
                direction = there.lean[s, ti.i32(rise < 0.0)]
            angle = 2.0 * math.pi * k / count
            direction = ti.cos(angle) * direction + ti.sin(angle) * axis.cross(direction)
        centre += end * axis + radius * direction + ball_radius * normal
    elif count == 2:
        centre += ti.select(k == 0, -half, half) * axis
    return centre, ball_radius
