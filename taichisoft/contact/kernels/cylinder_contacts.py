"""Narrow phase: cylinders against each other.

The nearest points of two cylinders are on their crossing sides, or one of them is on a rim. Along a rim the distance
from the other cylinder can have several minima.
"""

import math

from taichisoft.contact.kernels.contacts import Contacts, SearchSpace, append_points, ivec3
from taichisoft.contact.kernels.round_shapes import MovedShapes, RoundShapes
from taichisoft.contact.kernels.shape_distance import FACING, HALVINGS, LEVEL, QUARTERS, RIM_POINTS, signed_distance
from taichisoft.runtime.language import func, ti

SAME_PLACE = 1e-6  # [mm]
ROUNDING = 1e-9  # of unit vectors
CROSSING = 2 * (RIM_POINTS + QUARTERS)  # key of the contact of two sides, between the keys of both rims


@func
def cylinder_against_cylinder(
    pair: ti.i32,
    group: ti.i32,
    reach: ti.f64,
    shapes: RoundShapes,
    there: MovedShapes,
    space: SearchSpace,
    found: Contacts,
):
    """Store the contacts of two cylinders: of their crossing sides, and of each rim at its nearest points."""
    for side in range(2):
        mine, other = shapes.shape_pairs[pair, side], shapes.shape_pairs[pair, 1 - side]
        for end in range(2):
            rim_against_cylinder(pair, group, side, end, reach, mine, other, shapes, there, space, found)
    one, two = shapes.shape_pairs[pair, 0], shapes.shape_pairs[pair, 1]
    along, other_along = there.axis[one], there.axis[two]
    apart = there.centre[two] - there.centre[one]
    cosine = along.dot(other_along)
    crossing = 1.0 - cosine * cosine
    if crossing > 1e-12:
        place = (apart.dot(along) - cosine * apart.dot(other_along)) / crossing
        other_place = (cosine * apart.dot(along) - apart.dot(other_along)) / crossing
        if ti.abs(place) < shapes.half_length[one] and ti.abs(other_place) < shapes.half_length[two]:
            first = there.centre[one] + place * along
            second = there.centre[two] + other_place * other_along
            length = (second - first).norm()
            gap = length - shapes.radius[one] - shapes.radius[two]
            normal = along.cross(other_along).normalized()
            if length > SAME_PLACE:
                normal = (second - first) / length
            if gap < reach:
                append_points(
                    group, pair, CROSSING, shapes.body[one], shapes.body[two], first + shapes.radius[one] * normal,
                    second - shapes.radius[two] * normal, normal, gap, space, found,
                )  # fmt: skip


@func
def rim_point(angle: ti.f64, end: ti.i32, s: ti.i32, shapes: RoundShapes, there: MovedShapes):
    """Point of a rim of cylinder s at an angle [rad] from the direction of `lean`, and its radial unit vector."""
    first = there.lean[s, end]
    outward = ti.cos(angle) * first + ti.sin(angle) * there.axis[s].cross(first)
    middle = there.centre[s] + ti.select(end == 0, -1.0, 1.0) * shapes.half_length[s] * there.axis[s]
    return middle + shapes.radius[s] * outward, outward


@func
def rim_slope(
    angle: ti.f64, end: ti.i32, mine: ti.i32, other: ti.i32, shapes: RoundShapes, there: MovedShapes
) -> ti.f64:
    """Derivative of the signed distance between rim point and other cylinder by the angle, over the radius [-]."""
    x, outward = rim_point(angle, end, mine, shapes, there)
    _distance, out, _where = signed_distance(x, other, shapes, there)
    return out.dot(there.axis[mine].cross(outward))


@func
def rim_against_cylinder(
    pair: ti.i32,
    group: ti.i32,
    side: ti.i32,
    end: ti.i32,
    reach: ti.f64,
    mine: ti.i32,
    other: ti.i32,
    shapes: RoundShapes,
    there: MovedShapes,
    space: SearchSpace,
    found: Contacts,
):
    """Store the contacts of one rim.

    These are the minima of the distance along the rim, and on an end that faces the other cylinder the points a quarter
    of a turn from the least minimum, or all RIM_POINTS of a level end. Minima are bracketed between RIM_POINTS and
    found by bisection.
    """
    sector = 2.0 * math.pi / RIM_POINTS
    facing = ti.abs(there.axis[mine].dot(there.axis[other]))
    level = 2.0 * shapes.radius[mine] * ti.sqrt(ti.max(1.0 - facing * facing, 0.0)) < LEVEL
    least, least_angle = reach, 0.0
    for k in range(RIM_POINTS):
        low, high = k * sector, (k + 1) * sector
        if level:
            touch_rim(pair, group, ivec3(side, end, k), low, 1.0, reach, mine, other, shapes, there, space, found)
        elif (
            rim_slope(low, end, mine, other, shapes, there) < 0.0
            and rim_slope(high, end, mine, other, shapes, there) >= 0.0
        ):
            for _ in range(HALVINGS):
                middle = 0.5 * (low + high)
                if rim_slope(middle, end, mine, other, shapes, there) < 0.0:
                    low = middle
                else:
                    high = middle
            touch_rim(pair, group, ivec3(side, end, k), high, ROUNDING, reach, mine, other, shapes, there, space, found)
            x, _outward = rim_point(high, end, mine, shapes, there)
            distance, _out, _where = signed_distance(x, other, shapes, there)
            if distance < least:
                least, least_angle = distance, high
    if not level and facing > FACING and least < reach:
        for quarter in range(1, QUARTERS):
            angle = least_angle + 2.0 * math.pi * quarter / QUARTERS
            touch_rim(
                pair,
                group,
                ivec3(side, end, RIM_POINTS + quarter),
                angle,
                1.0,
                reach,
                mine,
                other,
                shapes,
                there,
                space,
                found,
            )


@func
def touch_rim(
    pair: ti.i32,
    group: ti.i32,
    where: ivec3,
    angle: ti.f64,
    inward: ti.f64,
    reach: ti.f64,
    mine: ti.i32,
    other: ti.i32,
    shapes: RoundShapes,
    there: MovedShapes,
    space: SearchSpace,
    found: Contacts,
):
    """Store the contact of a rim point, if the direction to the other cylinder leaves the end of the rim.

    At a minimum the direction also leaves the side; at other points of an end it may lead `inward` across the rim
    (cosine). `where` is the side of the pair, the end, and the number of the point on the rim.
    """
    side, end, k = where[0], where[1], where[2]
    x, outward = rim_point(angle, end, mine, shapes, there)
    distance, out, _where = signed_distance(x, other, shapes, there)
    beyond = ti.select(end == 0, -1.0, 1.0) * there.axis[mine]
    if distance < reach and out.dot(outward) <= inward and out.dot(beyond) <= ROUNDING:
        foot = x - distance * out
        number = ti.select(side == 0, 0, CROSSING + 1) + end * (RIM_POINTS + QUARTERS) + k
        if side == 0:
            append_points(
                group, pair, number, shapes.body[mine], shapes.body[other], x, foot, -out, distance, space, found
            )
        else:
            append_points(
                group, pair, number, shapes.body[other], shapes.body[mine], foot, x, out, distance, space, found
            )
