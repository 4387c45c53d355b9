"""Narrow phase: round shapes against planes and against each other."""

from taichisoft.contact.kernels.contacts import Contacts, SearchSpace, append_points
from taichisoft.contact.kernels.cylinder_contacts import cylinder_against_cylinder
from taichisoft.contact.kernels.round_shapes import MovedShapes, RoundShapes
from taichisoft.contact.kernels.shape_distance import (
    END,
    SIDE,
    ball,
    ball_count,
    lowest_along,
    side_by_side,
    signed_distance,
)
from taichisoft.contact.kernels.surface_vertices import Planes
from taichisoft.runtime.language import ScalarTable, func, ti

SAME_PLACE = 1e-6  # [mm]


@func
def shapes_against_planes(
    reaches: ScalarTable,
    first_group: ti.i32,
    planes: Planes,
    shapes: RoundShapes,
    there: MovedShapes,
    space: SearchSpace,
    found: Contacts,
):
    """Find points of the moving shapes closer to a plane than their reach; everything below the plane is inside."""
    for plane in range(planes.point.shape[0]):
        up = planes.normal[plane]
        for i in range(shapes.moving.shape[0]):
            s = shapes.moving[i]
            reach = reaches[shapes.body[s], planes.body[plane]]
            count = ball_count(up, s, shapes, there)
            for k in range(ti.select(reach < 0.0, 0, count)):
                centre, radius = ball(k, count, up, s, shapes, there)
                height = (centre - planes.point[plane]).dot(up)
                if height - radius < reach:
                    append_points(
                        first_group + plane, s, k, shapes.body[s], planes.body[plane], centre - radius * up,
                        centre - height * up, -up, height - radius, space, found,
                    )  # fmt: skip


@func
def shapes_against_shapes(
    reaches: ScalarTable,
    first_group: ti.i32,
    shapes: RoundShapes,
    there: MovedShapes,
    space: SearchSpace,
    found: Contacts,
):
    """Find contacts of two shapes closer than the reach of their bodies."""
    for pair in range(shapes.shape_pairs.shape[0]):
        # The axis of the shape with round ends is measured from the other shape, from the longer one of two.
        seen, s = shapes.shape_pairs[pair, 0], shapes.shape_pairs[pair, 1]
        if shapes.flat[seen] or (shapes.flat[s] == 0 and shapes.half_length[seen] > shapes.half_length[s]):
            seen, s = s, seen
        reach = reaches[shapes.body[seen], shapes.body[s]]
        extent = shapes.half_length[seen] + shapes.radius[seen] + shapes.half_length[s] + shapes.radius[s] + reach
        if reach >= 0.0 and (there.centre[seen] - there.centre[s]).norm_sqr() < extent * extent:
            if shapes.flat[seen]:
                cylinder_against_cylinder(pair, first_group + pair, reach, shapes, there, space, found)
            else:
                axis_against_shape(pair, first_group + pair, reach, seen, s, shapes, there, space, found)


@func
def axis_against_shape(
    pair: ti.i32,
    group: ti.i32,
    reach: ti.f64,
    seen: ti.i32,
    s: ti.i32,
    shapes: RoundShapes,
    there: MovedShapes,
    space: SearchSpace,
    found: Contacts,
):
    """Store the contacts of a sphere or capsule `seen` with shape s.

    They are at the nearest point of its axis, or, if the shapes lie side by side, at both ends of the common part.
    """
    half = shapes.half_length[seen] * there.axis[seen]
    a, b = there.centre[seen] - half, there.centre[seen] + half
    share = 0.0
    if shapes.half_length[seen] > 0.0:
        share = lowest_along(a, b, s, shapes, there)
    lowest, _out, where = signed_distance(a + share * (b - a), s, shapes, there)
    first, last = share, share
    if shapes.half_length[seen] > 0.0 and (where == SIDE or (where == END and shapes.flat[s])):
        first, last = side_by_side(a, b, where, s, shapes, there)
    for k in range(3):
        place = share
        if k == 1:
            place = first
        if k == 2:
            place = last
        distance, out, _there = signed_distance(a + place * (b - a), s, shapes, there)
        is_new = ti.i32(first < last)
        if k == 0:
            is_new = 1
            if first < last:
                one, _one_out, _one_where = signed_distance(a + first * (b - a), s, shapes, there)
                other, _other_out, _other_where = signed_distance(a + last * (b - a), s, shapes, there)
                nearest_end = ti.min(share - first, last - share) * (b - a).norm()
                if nearest_end < SAME_PLACE or ti.max(one, other) - lowest < SAME_PLACE:
                    is_new = 0
        if is_new and distance - shapes.radius[seen] < reach:
            x = a + place * (b - a)
            point, foot = x - shapes.radius[seen] * out, x - distance * out
            gap = distance - shapes.radius[seen]
            if seen == shapes.shape_pairs[pair, 0]:
                append_points(group, pair, k, shapes.body[seen], shapes.body[s], point, foot, -out, gap, space, found)
            else:
                append_points(group, pair, k, shapes.body[s], shapes.body[seen], foot, point, out, gap, space, found)
