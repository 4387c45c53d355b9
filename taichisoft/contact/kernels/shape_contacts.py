"""Narrow phase: round shapes against planes and against each other."""

import math

from taichisoft.contact.kernels.contacts import (
    MovedShapes,
    PoseArrays,
    RoundShapes,
    Search,
    append_points,
    ivec2,
    ivec3,
)
from taichisoft.runtime.language import func, ti, vec3
from taichisoft.runtime.launch import kernel

# Round shapes without triangles: spheres, capsules and cylinders.
#
# A capsule is all points closer to a segment than the radius; a sphere is a capsule of length 0. A cylinder has flat
# ends.

# Columns of `RoundShapes.surface_pairs`.
SHAPE, SURFACE, IS_SOFT, SURFACE_PAIR_COLUMNS = range(4)


@kernel
def move_shapes(shapes: RoundShapes, poses: PoseArrays, there: MovedShapes):
    """Move the shapes of rigid bodies to their poses."""
    ti.loop_config(serialize=True)
    for s in range(shapes.owner.shape[0]):
        owner = shapes.owner[s]
        if owner >= 0:
            turn = poses.rigid_rotation[owner]
            there.centre[s] = turn @ shapes.local_centre[s] + poses.rigid_position[owner]
            there.axis[s] = turn @ shapes.local_axis[s]
            there.side[s] = turn @ shapes.local_side[s]
            for end in ti.static(range(2)):
                there.lean[s, end] = there.side[s]


# Exact signed distances from round shapes, and the points of a shape that can touch a plane.
#
# All shapes are convex, and so are their signed distances: along a segment there is one minimum, where the slope
# changes sign.

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
def signed_distance(x: vec3, s: ti.i32, search: Search):
    """Distance of x from shape s [mm], negative inside, its gradient (the outward normal), and SIDE, END or RIM."""
    shapes, there = ti.static(search.shapes, search.there)
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
def lowest_along(a: vec3, b: vec3, s: ti.i32, search: Search) -> ti.f64:
    """Fraction of the segment from a to b at the least signed distance from shape s, found by bisection."""
    low, high = 0.0, 1.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        _distance, out, _where = signed_distance(a + middle * (b - a), s, search)
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
def side_by_side(a: vec3, b: vec3, where: ti.i32, s: ti.i32, search: Search):
    """Part of the segment from a to b beside the axis of s, or beyond its flat end: two fractions of the segment.

    If a segment lies along the side or on an end, the distance has no single minimum: both ends of this part touch.
    """
    shapes, there = ti.static(search.shapes, search.there)
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
def ball_count(normal: vec3, s: ti.i32, search: Search) -> ti.i32:
    """Number of balls that represent shape s against a plane with this normal, see `ball`."""
    shapes, there = ti.static(search.shapes, search.there)
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
def ball(k: ti.i32, count: ti.i32, normal: vec3, s: ti.i32, search: Search):
    """Centre and radius [mm] of the k-th of `count` balls inside shape s that reach as far as s against `normal`.

    For round ends the balls are the ends themselves. For a cylinder they touch the rims at the points farthest against
    the normal, or at several points of an end that faces it.
    """
    shapes, there = ti.static(search.shapes, search.there)
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


# Narrow phase: cylinders against each other.
#
# The nearest points of two cylinders are on their crossing sides, or one of them is on a rim. Along a rim the distance
# from the other cylinder can have several minima.

SAME_PLACE = 1e-6  # [mm]
ROUNDING = 1e-9  # of unit vectors
CROSSING = 2 * (RIM_POINTS + QUARTERS)  # key of the contact of two sides, between the keys of both rims


@func
def cylinder_against_cylinder(pair: ti.i32, group: ti.i32, reach: ti.f64, search: Search):
    """Store the contacts of two cylinders: of their crossing sides, and of each rim at its nearest points."""
    shapes, there = ti.static(search.shapes, search.there)
    for side in range(2):
        mine, other = shapes.shape_pairs[pair, side], shapes.shape_pairs[pair, 1 - side]
        for end in range(2):
            rim_against_cylinder(pair, group, side, end, reach, mine, other, search)
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
                    group,
                    pair,
                    CROSSING,
                    ivec2(shapes.body[one], shapes.body[two]),
                    first + shapes.radius[one] * normal,
                    second - shapes.radius[two] * normal,
                    normal,
                    gap,
                    search,
                )


@func
def rim_point(angle: ti.f64, end: ti.i32, s: ti.i32, search: Search):
    """Point of a rim of cylinder s at an angle [rad] from the direction of `lean`, and its radial unit vector."""
    shapes, there = ti.static(search.shapes, search.there)
    first = there.lean[s, end]
    outward = ti.cos(angle) * first + ti.sin(angle) * there.axis[s].cross(first)
    middle = there.centre[s] + ti.select(end == 0, -1.0, 1.0) * shapes.half_length[s] * there.axis[s]
    return middle + shapes.radius[s] * outward, outward


@func
def rim_slope(angle: ti.f64, end: ti.i32, mine: ti.i32, other: ti.i32, search: Search) -> ti.f64:
    """Derivative of the signed distance between rim point and other cylinder by the angle, over the radius [-]."""
    there = ti.static(search.there)
    x, outward = rim_point(angle, end, mine, search)
    _distance, out, _where = signed_distance(x, other, search)
    return out.dot(there.axis[mine].cross(outward))


@func
def rim_against_cylinder(
    pair: ti.i32, group: ti.i32, side: ti.i32, end: ti.i32, reach: ti.f64, mine: ti.i32, other: ti.i32, search: Search
):
    """Store the contacts of one rim.

    These are the minima of the distance along the rim, and on an end that faces the other cylinder the points a quarter
    of a turn from the least minimum, or all RIM_POINTS of a level end. Minima are bracketed between RIM_POINTS and
    found by bisection.
    """
    shapes, there = ti.static(search.shapes, search.there)
    sector = 2.0 * math.pi / RIM_POINTS
    facing = ti.abs(there.axis[mine].dot(there.axis[other]))
    level = 2.0 * shapes.radius[mine] * ti.sqrt(ti.max(1.0 - facing * facing, 0.0)) < LEVEL
    least, least_angle = reach, 0.0
    for k in range(RIM_POINTS):
        low, high = k * sector, (k + 1) * sector
        if level:
            touch_rim(pair, group, ivec3(side, end, k), low, 1.0, reach, mine, other, search)
        elif rim_slope(low, end, mine, other, search) < 0.0 and rim_slope(high, end, mine, other, search) >= 0.0:
            for _ in range(HALVINGS):
                middle = 0.5 * (low + high)
                if rim_slope(middle, end, mine, other, search) < 0.0:
                    low = middle
                else:
                    high = middle
            touch_rim(pair, group, ivec3(side, end, k), high, ROUNDING, reach, mine, other, search)
            x, _outward = rim_point(high, end, mine, search)
            distance, _out, _where = signed_distance(x, other, search)
            if distance < least:
                least, least_angle = distance, high
    if not level and facing > FACING and least < reach:
        for quarter in range(1, QUARTERS):
            angle = least_angle + 2.0 * math.pi * quarter / QUARTERS
            touch_rim(pair, group, ivec3(side, end, RIM_POINTS + quarter), angle, 1.0, reach, mine, other, search)


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
    search: Search,
):
    """Store the contact of a rim point, if the direction to the other cylinder leaves the end of the rim.

    At a minimum the direction also leaves the side; at other points of an end it may lead `inward` across the rim
    (cosine). `where` is the side of the pair, the end, and the number of the point on the rim.
    """
    there = ti.static(search.there)
    side, end, k = where[0], where[1], where[2]
    x, outward = rim_point(angle, end, mine, search)
    distance, out, _where = signed_distance(x, other, search)
    beyond = ti.select(end == 0, -1.0, 1.0) * there.axis[mine]
    if distance < reach and out.dot(outward) <= inward and out.dot(beyond) <= ROUNDING:
        foot = x - distance * out
        number = ti.select(side == 0, 0, CROSSING + 1) + end * (RIM_POINTS + QUARTERS) + k
        append_from(group, pair, number, side, x, foot, out, distance, search)


@func
def append_from(
    group: ti.i32,
    pair: ti.i32,
    k: ti.i32,
    side: ti.i32,
    point: vec3,
    foot: vec3,
    out: vec3,
    distance: ti.f64,
    search: Search,
):
    """Add a contact of two shapes; `point` is on the shape on this side of the pair, `out` leads to it from `foot`."""
    shapes = ti.static(search.shapes)
    bodies = ivec2(shapes.body[shapes.shape_pairs[pair, 0]], shapes.body[shapes.shape_pairs[pair, 1]])
    if side == 0:
        append_points(group, pair, k, bodies, point, foot, -out, distance, search)
    else:
        append_points(group, pair, k, bodies, foot, point, out, distance, search)


@func
def shapes_against_planes(search: Search, first_group: ti.i32):
    """Find points of the moving shapes closer to a plane than their reach; everything below the plane is inside."""
    reaches, planes, shapes = ti.static(search.reaches, search.planes, search.shapes)
    for plane in range(planes.point.shape[0]):
        up = planes.normal[plane]
        for i in range(shapes.moving.shape[0]):
            s = shapes.moving[i]
            reach = reaches[shapes.body[s], planes.body[plane]]
            count = ball_count(up, s, search)
            for k in range(ti.select(reach < 0.0, 0, count)):
                centre, radius = ball(k, count, up, s, search)
                height = (centre - planes.point[plane]).dot(up)
                if height - radius < reach:
                    append_points(
                        first_group + plane,
                        s,
                        k,
                        ivec2(shapes.body[s], planes.body[plane]),
                        centre - radius * up,
                        centre - height * up,
                        -up,
                        height - radius,
                        search,
                    )


@func
def shapes_against_shapes(search: Search, first_group: ti.i32):
    """Find contacts of two shapes closer than the reach of their bodies."""
    reaches, shapes, there = ti.static(search.reaches, search.shapes, search.there)
    for pair in range(shapes.shape_pairs.shape[0]):
        # The axis of the shape with round ends is measured from the other shape, from the longer one of two.
        seen, s = shapes.shape_pairs[pair, 0], shapes.shape_pairs[pair, 1]
        if shapes.flat[seen] or (shapes.flat[s] == 0 and shapes.half_length[seen] > shapes.half_length[s]):
            seen, s = s, seen
        reach = reaches[shapes.body[seen], shapes.body[s]]
        extent = shapes.half_length[seen] + shapes.radius[seen] + shapes.half_length[s] + shapes.radius[s] + reach
        if reach >= 0.0 and (there.centre[seen] - there.centre[s]).norm_sqr() < extent * extent:
            if shapes.flat[seen]:
                cylinder_against_cylinder(pair, first_group + pair, reach, search)
            else:
                axis_against_shape(pair, first_group + pair, reach, seen, s, search)


@func
def axis_against_shape(pair: ti.i32, group: ti.i32, reach: ti.f64, seen: ti.i32, s: ti.i32, search: Search):
    """Store the contacts of a sphere or capsule `seen` with shape s.

    They are at the nearest point of its axis, or, if the shapes lie side by side, at both ends of the common part.
    """
    shapes, there = ti.static(search.shapes, search.there)
    half = shapes.half_length[seen] * there.axis[seen]
    a, b = there.centre[seen] - half, there.centre[seen] + half
    share = 0.0
    if shapes.half_length[seen] > 0.0:
        share = lowest_along(a, b, s, search)
    lowest, _out, where = signed_distance(a + share * (b - a), s, search)
    first, last = share, share
    if shapes.half_length[seen] > 0.0 and (where == SIDE or (where == END and shapes.flat[s])):
        first, last = side_by_side(a, b, where, s, search)
    for k in range(3):
        place = share
        if k == 1:
            place = first
        if k == 2:
            place = last
        distance, out, _there = signed_distance(a + place * (b - a), s, search)
        is_new = ti.i32(first < last)
        if k == 0:
            is_new = 1
            if first < last:
                one, _one_out, _one_where = signed_distance(a + first * (b - a), s, search)
                other, _other_out, _other_where = signed_distance(a + last * (b - a), s, search)
                nearest_end = ti.min(share - first, last - share) * (b - a).norm()
                if nearest_end < SAME_PLACE or ti.max(one, other) - lowest < SAME_PLACE:
                    is_new = 0
        if is_new and distance - shapes.radius[seen] < reach:
            x = a + place * (b - a)
            point, foot = x - shapes.radius[seen] * out, x - distance * out
            gap = distance - shapes.radius[seen]
            append_from(group, pair, k, ti.i32(seen != shapes.shape_pairs[pair, 0]), point, foot, out, gap, search)
