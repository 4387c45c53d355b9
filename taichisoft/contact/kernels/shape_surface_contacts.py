"""Narrow phase: round shapes against the triangles, edges and vertices of surfaces.

A contact is a local minimum of the distance between a shape and a surface. If the minimum is not unique, as under a
cylinder that lies on a face, the ends of the line or area of least distance are contacts, and so is every vertex of a
soft surface within reach. A penetrating contact keeps its normal and has a negative distance.
"""

from taichisoft.contact.kernels.box_trees import find_leaves
from taichisoft.contact.kernels.contacts import (
    SHAPES_ON_PLANES,
    SHAPES_ON_SHAPES,
    SHAPES_ON_SURFACES,
    RoundShapes,
    Search,
    Surfaces,
    append,
    corners,
    ends,
    ivec2,
    ivec3,
    set_side,
)
from taichisoft.contact.kernels.shape_contacts import (
    END,
    IS_SOFT,
    RIM,
    SHAPE,
    SIDE,
    SURFACE,
    ball,
    ball_count,
    lowest_along,
    shapes_against_planes,
    shapes_against_shapes,
    side_by_side,
    signed_distance,
)
from taichisoft.contact.kernels.vertex_contacts import (
    closest_point,
    direction,
    edge_pseudonormal,
    face_normal,
    find_triangles,
    in_normal_cone,
    is_local_minimum,
    is_on_open_edge,
    on_triangle,
    outward_normal,
)
from taichisoft.runtime.language import func, ti, vec3
from taichisoft.runtime.launch import kernel

vec2 = ti.types.vector(2, ti.f64)
vec4 = ti.types.vector(4, ti.f64)

FACES, EDGES, VERTICES, FEATURES = range(4)

SAME_PLACE = 1e-6  # [mm]
# On a rigid surface a vertex beside the axis touches unless the distance falls along an edge by more than this sine;
# so both ends of an edge that lies along a cylinder touch.
ALONG = 0.01


@func
def shapes_against_surfaces(search: Search, depth: ti.f64, first_group: ti.i32):
    """Find contacts of shapes with surfaces within their reach, or penetrating by up to thickness and `depth`."""
    reaches, surfaces, trees, moved, shapes, there, space = ti.static(
        search.reaches, search.surfaces, search.trees, search.moved, search.shapes, search.there, search.space
    )
    for pair in range(shapes.surface_pairs.shape[0]):
        s, surface = shapes.surface_pairs[pair, SHAPE], shapes.surface_pairs[pair, SURFACE]
        group = first_group + FEATURES * pair
        reach = reaches[shapes.body[s], surfaces.body[surface]]
        extent = shapes.half_length[s] * ti.abs(there.axis[s]) + shapes.radius[s] + ti.max(reach, depth)
        low, high = there.centre[s] - extent, there.centre[s] + extent
        near_count = 0
        if reach >= 0.0:
            near_count = find_leaves(surface, low, high, trees, moved, space.leaf)
        if near_count > 0 and shapes.flat[s] == 0:
            normal = vec3(0.0)
            count = ball_count(normal, s, search)
            for k in range(count):
                centre, radius = ball(k, count, normal, s, search)
                touch_ball(
                    pair,
                    group,
                    k,
                    vec4(centre[0], centre[1], centre[2], radius),
                    near_count,
                    vec2(reach, depth),
                    search,
                )
        for i in range(near_count):
            leaf = space.leaf[i]
            if shapes.flat[s]:
                for j in range(trees.triangle_start[leaf], trees.triangle_start[leaf + 1]):
                    touch_face(pair, group, trees.triangle[j], near_count, vec2(reach, depth), search)
            if shapes.half_length[s] > 0.0:
                for j in range(trees.edge_start[leaf], trees.edge_start[leaf + 1]):
                    touch_edge(pair, group, trees.edge[j], near_count, vec2(reach, depth), search)
            for j in range(trees.vertex_start[leaf], trees.vertex_start[leaf + 1]):
                touch_vertex(pair, group, trees.vertex[j], reach, search)


@func
def zeros_of(weights: vec3) -> ti.i32:
    """Number of corners without a part in a point: 1 on an edge, 2 at a corner."""
    zeros = 0
    for corner in ti.static(range(3)):
        if weights[corner] == 0.0:
            zeros += 1
    return zeros


@func
def touch_ball(pair: ti.i32, group: ti.i32, k: ti.i32, sphere: vec4, near_count: ti.i32, limits: vec2, search: Search):
    """Store the contacts of ball k of a shape; the vertices of soft surfaces are left to `touch_vertex`.

    `sphere` is the centre and radius of the ball, `limits` are reach and depth [mm].
    """
    surfaces, moved, shapes, space = ti.static(search.surfaces, search.moved, search.shapes, search.space)
    centre, radius = vec3(sphere[0], sphere[1], sphere[2]), sphere[3]
    reach, depth = limits[0], limits[1]
    closest, weights, within_reach = find_triangles(centre, near_count, reach + radius, depth, search)
    if closest >= 0:
        away = centre - on_triangle(closest, weights, surfaces, moved.position)
        if away.dot(outward_normal(closest, weights, surfaces, moved.position)) < 0.0:
            push_out(pair, group, k, closest, weights, sphere, depth, search)
        else:
            for i in range(within_reach):
                t, w = space.triangle[i], space.weights[i]
                there = on_triangle(t, w, surfaces, moved.position)
                away = centre - there
                is_left_to_vertices = zeros_of(w) == 2 and shapes.surface_pairs[pair, IS_SOFT] == 1
                if is_local_minimum(t, w, away, surfaces, moved.position) and not is_left_to_vertices:
                    facing = outward_normal(t, w, surfaces, moved.position)
                    if away.dot(facing) >= 0.0:
                        out = direction(away, facing)
                        store_face(pair, group, k, t, w, there, out, away.norm() - radius, search)


@func
def push_out(
    pair: ti.i32, group: ti.i32, k: ti.i32, closest: ti.i32, weights: vec3, sphere: vec4, depth: ti.f64, search: Search
):
    """Store the contact of a ball whose centre is inside a surface, down to `depth` [mm] from the closest triangle."""
    surfaces, moved = ti.static(search.surfaces, search.moved)
    centre = vec3(sphere[0], sphere[1], sphere[2])
    foot = on_triangle(closest, weights, surfaces, moved.position)
    depth_here = (foot - centre).norm()
    if depth_here <= depth and not is_on_open_edge(closest, weights, surfaces):
        out = direction(foot - centre, outward_normal(closest, weights, surfaces, moved.position))
        store_face(pair, group, k, closest, weights, foot, out, -depth_here - sphere[3], search)


@func
def touch_face(pair: ti.i32, group: ti.i32, t: ti.i32, near_count: ti.i32, limits: vec2, search: Search):
    """Store the contacts of a cylinder with the inside of triangle t; `limits` are reach and depth."""
    surfaces, moved, shapes = ti.static(search.surfaces, search.moved, search.shapes)
    reach, depth = limits[0], limits[1]
    s = shapes.surface_pairs[pair, SHAPE]
    normal = face_normal(t, surfaces, moved.position)
    count = ball_count(normal, s, search)
    for k in range(count):
        centre, radius = ball(k, count, normal, s, search)
        height = (centre - moved.position[surfaces.triangles[t, 0]]).dot(normal)
        if height < reach + radius and height > -depth:
            w, foot = closest_point(centre, t, surfaces, moved.position)
            zeros = zeros_of(w)
            inside = ti.i32(zeros == 0)
            # Both of two coplanar triangles may have the foot on their common edge, which is not a feature.
            is_on_edge = zeros == 1 and (centre - height * normal - foot).norm() < SAME_PLACE
            if is_on_edge and shapes.surface_pairs[pair, IS_SOFT] == 0:
                inside = is_local_minimum(t, w, normal, surfaces, moved.position)
            if inside == 1 and height < 0.0:
                closest, _weights, _within_reach = find_triangles(centre, near_count, 0.0, depth, search)
                inside = ti.i32(closest == t)
            if inside == 1:
                store_face(pair, group, k, t, w, foot, normal, height - radius, search)


@func
def touch_edge(pair: ti.i32, group: ti.i32, e: ti.i32, near_count: ti.i32, limits: vec2, search: Search):
    """Store the contacts of the inner part of a capsule or cylinder with the inside of edge e.

    The edge may have gone past a capsule's axis, whose place there is then inside the surface, and is pushed out.
    """
    surfaces, moved, shapes = ti.static(search.surfaces, search.moved, search.shapes)
    reach, depth = limits[0], limits[1]
    s = shapes.surface_pairs[pair, SHAPE]
    a, b = moved.position[surfaces.edges[e, 0]], moved.position[surfaces.edges[e, 1]]
    nearest, _out, _where = signed_distance(0.5 * (a + b), s, search)
    if nearest - 0.5 * (b - a).norm() < reach:
        share = lowest_along(a, b, s, search)
        _distance, _normal, where = signed_distance(a + share * (b - a), s, search)
        if share > 0.0 and share < 1.0 and (shapes.flat[s] or where == SIDE):
            first, last = share, share
            if shapes.flat[s] and where != RIM:
                first, last = side_by_side(a, b, where, s, search)
            for k in range(3):
                place = share
                if k == 1:
                    place = first
                if k == 2:
                    place = last
                x = a + place * (b - a)
                distance, out, _there = signed_distance(x, s, search)
                is_new = ti.i32(k == 0)
                if k == 0 and first < last:
                    # Between two ends at the same height the lowest point adds nothing.
                    lowest = ti.min(share - first, last - share) * (b - a).norm()
                    if lowest < SAME_PLACE or is_level(a, b, first, last, distance, s, search):
                        is_new = 0
                if k > 0 and first < last and place > 0.0 and place < 1.0:
                    is_new = 1
                beyond = 0.0
                if shapes.flat[s] == 0:
                    beyond = out.dot(edge_pseudonormal(e, surfaces, moved.position))
                if is_new and beyond > 0.0:
                    is_new = 0
                    axis = x - (distance + shapes.radius[s]) * out
                    closest, weights, _within_reach = find_triangles(axis, near_count, 0.0, depth, search)
                    if closest >= 0:
                        away = axis - on_triangle(closest, weights, surfaces, moved.position)
                        if away.dot(outward_normal(closest, weights, surfaces, moved.position)) < 0.0:
                            place_there = vec4(axis[0], axis[1], axis[2], shapes.radius[s])
                            push_out(pair, group, k, closest, weights, place_there, depth, search)
                if is_new and distance < reach and in_normal_cone(e, -out, surfaces, moved.position):
                    c = store_shape(pair, group + EDGES, e, k, x, out, distance, search)
                    weights_there = vec3(1.0 - place, place, 0.0)
                    set_side(c, mesh_side(pair, surfaces, shapes), ends(e, surfaces), weights_there, x, search)


@func
def is_level(a: vec3, b: vec3, first: ti.f64, last: ti.f64, lowest: ti.f64, s: ti.i32, search: Search) -> ti.i32:
    """Whether both ends of a part of the segment from a to b are as close to shape s as its nearest point."""
    one, _out, _where = signed_distance(a + first * (b - a), s, search)
    other, _other_out, _other_where = signed_distance(a + last * (b - a), s, search)
    return ti.max(one, other) - lowest < SAME_PLACE


@func
def touch_vertex(pair: ti.i32, group: ti.i32, v: ti.i32, reach: ti.f64, search: Search):
    """Store the contact of vertex v: on soft surfaces always, on others at a minimum not found by a ball."""
    surfaces, moved, shapes = ti.static(search.surfaces, search.moved, search.shapes)
    s = shapes.surface_pairs[pair, SHAPE]
    x = moved.position[v]
    distance, out, where = signed_distance(x, s, search)
    if distance < reach:
        touches = shapes.surface_pairs[pair, IS_SOFT]
        if touches == 0 and shapes.flat[s] == 1 and where == END:
            touches = 1
        elif touches == 0 and (shapes.flat[s] == 1 or where == SIDE):
            touches = 1
            least = ti.select(where == SIDE, -ALONG, 0.0)
            for k in range(surfaces.star_start[v], surfaces.star_start[v + 1]):
                edge = moved.position[surfaces.star[k]] - x
                if out.dot(edge) < least * edge.norm():
                    touches = 0
        if touches:
            c = store_shape(pair, group + VERTICES, v, 0, x, out, distance, search)
            set_side(c, mesh_side(pair, surfaces, shapes), ivec3(v), vec3(1.0, 0.0, 0.0), x, search)


@func
def mesh_side(pair: ti.i32, surfaces: Surfaces, shapes: RoundShapes) -> ti.i32:
    """Side of the surface in a contact: the lower body number is first."""
    body = shapes.body[shapes.surface_pairs[pair, SHAPE]]
    return ti.i32(surfaces.body[shapes.surface_pairs[pair, SURFACE]] > body)


@func
def store_shape(
    pair: ti.i32, group: ti.i32, feature: ti.i32, k: ti.i32, x: vec3, out: vec3, distance: ti.f64, search: Search
) -> ti.i32:
    """Add a contact of a shape with point x on the surface, `distance` along `out` from the shape; its index."""
    surfaces, shapes = ti.static(search.surfaces, search.shapes)
    body = shapes.body[shapes.surface_pairs[pair, SHAPE]]
    other = surfaces.body[shapes.surface_pairs[pair, SURFACE]]
    mine = 1 - mesh_side(pair, surfaces, shapes)
    bodies = ivec2(ti.min(body, other), ti.max(body, other))
    c = append(group, feature, k, bodies, ti.select(mine == 0, out, -out), distance, search)
    set_side(c, mine, ivec3(-1), vec3(0.0), x - distance * out, search)
    return c


@func
def store_face(
    pair: ti.i32,
    group: ti.i32,
    k: ti.i32,
    t: ti.i32,
    weights: vec3,
    foot: vec3,
    out: vec3,
    distance: ti.f64,
    search: Search,
):
    """Add a contact of ball k of a shape with triangle t at `foot`; `out` is the outward direction of the surface."""
    surfaces, shapes = ti.static(search.surfaces, search.shapes)
    c = store_shape(pair, group + FACES, t, k, foot, -out, distance, search)
    set_side(c, mesh_side(pair, surfaces, shapes), corners(t, surfaces), weights, foot, search)


# Search for contacts of round shapes, in kernels that only scenes with such shapes compile and launch.


@kernel
def find_on_surfaces(search: Search, depth: ti.f64):
    """Add the contacts of shapes with surfaces, see `shapes_against_surfaces`; the count may exceed the capacity."""
    ti.loop_config(serialize=True)
    for _ in range(1):
        shapes_against_surfaces(search, depth, SHAPES_ON_SURFACES)


@kernel
def find_on_planes(search: Search):
    """Add the contacts of shapes with planes within their reach [mm]; the count may exceed the capacity."""
    ti.loop_config(serialize=True)
    for _ in range(1):
        shapes_against_planes(search, SHAPES_ON_PLANES)


@kernel
def find_on_shapes(search: Search):
    """Add the contacts of two shapes within their reach [mm]; the count may exceed the capacity."""
    ti.loop_config(serialize=True)
    for _ in range(1):
        shapes_against_shapes(search, SHAPES_ON_SHAPES)
