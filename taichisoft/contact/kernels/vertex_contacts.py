"""Narrow phase: vertices and edges of one surface against the triangles and edges of another, and planes.

A contact is a local minimum of the distance. A penetrating contact has a negative distance and keeps its normal.
Contact normals point from the first surface of the pair to the second.

A surface is close to itself everywhere, along the skin and through the thickness of every wall. The rest shape
separates contacts from neighbours: features closer to each other at rest than a limit never touch. The limit is twice
the depth to which penetrations are pushed out, so that a wall would have to be pressed to half of its thickness before
its two sides counted as penetrating. Besides, a vertex touches only what its own outward normal faces.
"""

import math

from taichisoft.contact.kernels.box_trees import find_leaves, meets, meets_beam, squared_distance
from taichisoft.contact.kernels.contacts import (
    DEPTH,
    EDGE_GROUPS,
    NEAR,
    OWN_GROUPS,
    PLANE_GROUPS,
    VERTEX_GROUPS,
    Contacts,
    Search,
    Surfaces,
    append,
    corners,
    ends,
    ivec2,
    ivec3,
    put_in_order,
    set_side,
)
from taichisoft.runtime.language import Scalars, Vectors, func, ti, vec3
from taichisoft.runtime.launch import kernel

# Where the distance from a point or edge to a triangulated surface is a local minimum, and on which side.
#
# The side follows from pseudo-normals (Baerentzen and Aanaes 2005, Signed Distance Computation Using the Angle Weighted
# Pseudonormal), which separate inside from outside at edges and corners too.

# Edges of a deformed flat patch are slightly convex or concave at random: normals may leave an edge's normal cone
# by this much (sine of the angle).
CONE_TOLERANCE = 0.1
CONE_CHORD = 2.0 * math.sin(0.5 * math.asin(CONE_TOLERANCE))  # distance of unit vectors at this angle
COINCIDENT = 1e-9  # [mm]


@func
def closest_on_triangle(p: vec3, a: vec3, b: vec3, c: vec3) -> vec3:
    """Barycentric weights of the point closest to p; exactly 0 for other corners (Ericson 2005, section 5.1.5)."""
    ab, ac = b - a, c - a
    d1, d2 = ab.dot(p - a), ac.dot(p - a)
    d3, d4 = ab.dot(p - b), ac.dot(p - b)
    d5, d6 = ab.dot(p - c), ac.dot(p - c)
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    weights = vec3(0.0)
    if d1 <= 0.0 and d2 <= 0.0:
        weights[0] = 1.0
    elif d3 >= 0.0 and d4 <= d3:
        weights[1] = 1.0
    elif d6 >= 0.0 and d5 <= d6:
        weights[2] = 1.0
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        weights[1] = d1 / (d1 - d3)
        weights[0] = 1.0 - weights[1]
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        weights[2] = d2 / (d2 - d6)
        weights[0] = 1.0 - weights[2]
    elif va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        weights[2] = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        weights[1] = 1.0 - weights[2]
    else:
        weights[1] = vb / (va + vb + vc)
        weights[2] = vc / (va + vb + vc)
        weights[0] = 1.0 - weights[1] - weights[2]
    return weights


@func
def closest_of_corners(p: vec3, vertices: ivec3, position: Vectors) -> vec3:
    """Barycentric weights of the point closest to p of the triangle with these vertices."""
    return closest_on_triangle(p, position[vertices[0]], position[vertices[1]], position[vertices[2]])


@func
def on_triangle(t: ti.i32, weights: vec3, surfaces: Surfaces, position: Vectors) -> vec3:
    """Point of triangle t with barycentric `weights` [mm]."""
    return (
        weights[0] * position[surfaces.triangles[t, 0]]
        + weights[1] * position[surfaces.triangles[t, 1]]
        + weights[2] * position[surfaces.triangles[t, 2]]
    )


@func
def closest_point(p: vec3, t: ti.i32, surfaces: Surfaces, position: Vectors):
    """Barycentric weights of the point of triangle t closest to p, and the point [mm]."""
    weights = closest_of_corners(p, corners(t, surfaces), position)
    return weights, on_triangle(t, weights, surfaces, position)


@func
def is_on_open_edge(t: ti.i32, weights: vec3, surfaces: Surfaces) -> ti.i32:
    """Whether the point of triangle t with these weights is on an edge without a second triangle."""
    is_open = 0
    for k in ti.static(range(3)):
        if weights[k] == 0.0 and surfaces.edge_triangles[surfaces.triangle_edges[t, k], 1] < 0:
            is_open = 1
    return is_open


@func
def direction(away: vec3, normal: vec3) -> vec3:
    """Unit vector along `away`, or `normal` where both points coincide."""
    length, unit = away.norm(), normal
    if length > COINCIDENT:
        unit = away / length
    return unit


@func
def face_normal(t: ti.i32, surfaces: Surfaces, position: Vectors) -> vec3:
    """Unit normal of triangle t."""
    a = position[surfaces.triangles[t, 0]]
    normal = (position[surfaces.triangles[t, 1]] - a).cross(position[surfaces.triangles[t, 2]] - a)
    return normal / ti.max(normal.norm(), 1e-300)


@func
def edge_pseudonormal(e: ti.i32, surfaces: Surfaces, position: Vectors) -> vec3:
    """Sum of the normals of the triangles at an edge."""
    normal = face_normal(surfaces.edge_triangles[e, 0], surfaces, position)
    if surfaces.edge_triangles[e, 1] >= 0:
        normal += face_normal(surfaces.edge_triangles[e, 1], surfaces, position)
    return normal


@func
def vertex_pseudonormal(v: ti.i32, surfaces: Surfaces, position: Vectors) -> vec3:
    """Sum of the normals of the triangles around a vertex, weighted by their angles at the vertex."""
    normal = vec3(0.0)
    for k in range(surfaces.fan_start[v], surfaces.fan_start[v + 1]):
        t = surfaces.fan[k] // 3
        corner = surfaces.fan[k] % 3
        first = position[surfaces.triangles[t, (corner + 1) % 3]] - position[v]
        second = position[surfaces.triangles[t, (corner + 2) % 3]] - position[v]
        normal += ti.atan2(first.cross(second).norm(), first.dot(second)) * face_normal(t, surfaces, position)
    return normal


@func
def outward_normal(t: ti.i32, weights: vec3, surfaces: Surfaces, position: Vectors) -> vec3:
    """Unit pseudo-normal of the corner, edge or face of triangle t on which a point with these weights lies."""
    normal = vec3(0.0)
    zeros = 0
    corner = 0
    opposite = 0
    for k in ti.static(range(3)):
        if weights[k] == 0.0:
            zeros += 1
            opposite = k
        else:
            corner = k
    if zeros == 0:
        normal = face_normal(t, surfaces, position)
    elif zeros == 1:
        normal = edge_pseudonormal(surfaces.triangle_edges[t, opposite], surfaces, position)
    else:
        normal = vertex_pseudonormal(surfaces.triangles[t, corner], surfaces, position)
    return normal / ti.max(normal.norm(), 1e-300)


@func
def inward(t: ti.i32, start: ti.i32, end: ti.i32, surfaces: Surfaces, position: Vectors) -> vec3:
    """Unit direction in the plane of triangle t, across its edge (start, end), into the triangle."""
    third = surfaces.triangles[t, 0] + surfaces.triangles[t, 1] + surfaces.triangles[t, 2] - start - end
    along = (position[end] - position[start]).normalized()
    across = position[third] - position[start]
    across -= across.dot(along) * along
    return across.normalized()


@func
def is_local_minimum(t: ti.i32, weights: vec3, away: vec3, surfaces: Surfaces, position: Vectors) -> ti.i32:
    """Whether the distance grows in every direction from the closest point on triangle t.

    `away` is the vector from the closest point. At a shared corner or edge, one triangle only has the minimum.
    """
    zeros = 0
    corner = 0
    opposite = 0
    for k in ti.static(range(3)):
        if weights[k] == 0.0:
            zeros += 1
            opposite = k
        else:
            corner = surfaces.triangles[t, k]
    minimum = 1
    if zeros == 1:
        e = surfaces.triangle_edges[t, opposite]
        other = surfaces.edge_triangles[e, 1]
        if surfaces.edge_triangles[e, 0] != t:
            minimum = 0
        if other >= 0:
            across = inward(other, surfaces.edges[e, 0], surfaces.edges[e, 1], surfaces, position)
            if away.dot(across) > 0.0:
                minimum = 0
    elif zeros == 2:
        if surfaces.first_triangle[corner] != t:
            minimum = 0
        for k in range(surfaces.star_start[corner], surfaces.star_start[corner + 1]):
            if away.dot(position[surfaces.star[k]] - position[corner]) > 0.0:
                minimum = 0
    return minimum


@func
def in_normal_cone(e: ti.i32, normal: vec3, surfaces: Surfaces, position: Vectors) -> ti.i32:
    """Whether an outward direction at edge e lies between the normals of its triangles."""
    inside = 1
    for k in ti.static(range(2)):
        t = surfaces.edge_triangles[e, k]
        if t >= 0:  # nested: after `and` Taichi would always call the function
            across = inward(t, surfaces.edges[e, 0], surfaces.edges[e, 1], surfaces, position)
            if normal.dot(across) > CONE_TOLERANCE:
                inside = 0
    return inside


@func
def normal_cone(e: ti.i32, surfaces: Surfaces, position: Vectors):
    """Axis of the normal cone of edge e, and the largest distance of an outward unit vector in it from the axis."""
    first = face_normal(surfaces.edge_triangles[e, 0], surfaces, position)
    axis = first
    spread = 2.0
    if surfaces.edge_triangles[e, 1] >= 0:
        total = first + face_normal(surfaces.edge_triangles[e, 1], surfaces, position)
        length = total.norm()
        if length > 1e-6:
            axis = total / length
            spread = (first - axis).norm() + CONE_CHORD
    return axis, spread


# Narrow phase: vertices of one surface against the triangles of another or of the same, and against planes.

# Both features are of one body: the one farther along this direction is the second side, so that neighbouring contacts
# have similar normals, whichever feature is the vertex.
ALONG = (1.0, 0.618, 0.383)


@func
def vertices_against_surface(
    group: ti.i32, mine: ti.i32, theirs: ti.i32, side: ti.i32, reach: ti.f64, depth: ti.f64, search: Search
) -> ti.f64:
    """Find contacts of the vertices of a surface, which is this `side`, with the triangles of another or of itself.

    A vertex outside touches at every local minimum within `reach` [mm]; a vertex inside touches at the closest point
    only, and only down to `depth` [mm]. Returns the largest penetration [mm].
    """
    surfaces, trees, moved, space = ti.static(search.surfaces, search.trees, search.moved, search.space)
    far, deepest = ti.max(reach, depth), 0.0
    bodies = ivec2(surfaces.body[mine], surfaces.body[theirs])
    if side == 1:
        bodies = ivec2(bodies[1], bodies[0])
    their_low, their_high = moved.lower[trees.root[theirs]] - far, moved.upper[trees.root[theirs]] + far
    node = ti.select(reach < 0.0, trees.root[mine + 1], trees.root[mine])
    while node < trees.root[mine + 1]:
        if meets(node, their_low, their_high, moved):
            start, end = trees.vertex_start[node], trees.vertex_start[node + 1]
            if start < end:
                low, high = moved.lower[node] - far, moved.upper[node] + far
                near_count = find_leaves(theirs, low, high, trees, moved, space.leaf)
                for i in range(start, ti.select(near_count > 0, end, 0)):
                    deepest = ti.max(
                        deepest, touch(group, trees.vertex[i], bodies, side, near_count, reach, depth, search)
                    )
            node += 1
        else:
            node = trees.escape[node]
    return deepest


@func
def touch(
    group: ti.i32,
    v: ti.i32,
    bodies: ivec2,
    side: ti.i32,
    near_count: ti.i32,
    reach: ti.f64,
    depth: ti.f64,
    search: Search,
) -> ti.f64:
    """Store the contacts of vertex v with the triangles of the leaves nearby; returns its penetration [mm].

    The triangle closest to a vertex shows whether it is inside another surface. On its own surface that is always a
    neighbour: there the closest of the minima behind which it lies takes its place.
    """
    surfaces, moved, space, touching = ti.static(search.surfaces, search.moved, search.space, search.touching)
    p, is_own, facing = moved.position[v], group >= OWN_GROUPS, vec3(0.0)
    behind, weights, within_reach = find_triangles(p, near_count, reach, depth, search)
    nearest = depth
    if is_own:
        behind = -1
        facing = vertex_pseudonormal(v, surfaces, moved.position)
    elif behind >= 0:
        away = p - on_triangle(behind, weights, surfaces, moved.position)
        if away.dot(outward_normal(behind, weights, surfaces, moved.position)) < 0.0:
            within_reach = 0
            if away.norm() > depth or is_on_open_edge(behind, weights, surfaces):
                behind = -1
        else:
            behind = -1
    for k in range(within_reach):
        t, w = space.triangle[k], space.weights[k]
        away = p - on_triangle(t, w, surfaces, moved.position)
        distance = away.norm()
        is_minimum = is_local_minimum(t, w, away, surfaces, moved.position)
        if is_own and is_minimum:  # nested: after `and` Taichi would always call the function
            _weights, rest = closest_point(touching.rest[v], t, surfaces, touching.rest)
            is_minimum = (touching.rest[v] - rest).norm() >= touching.limits[NEAR]
        if is_minimum:
            out = outward_normal(t, w, surfaces, moved.position)
            if away.dot(out) >= 0.0:
                if not is_own or away.dot(facing) <= 0.0:
                    store_vertex(group, v, t, bodies, side, w, direction(away, out), distance, search)
            elif is_own and distance < nearest and out.dot(facing) < 0.0:
                behind, weights, nearest = t, w, distance
    slipped = 0.0
    if behind >= 0:
        away = on_triangle(behind, weights, surfaces, moved.position) - p
        slipped = away.norm()
        out = direction(away, outward_normal(behind, weights, surfaces, moved.position))
        store_vertex(group, v, behind, bodies, side, weights, out, -slipped, search)
    return slipped


@func
def find_triangles(p: vec3, near_count: ti.i32, reach: ti.f64, depth: ti.f64, search: Search):
    """Triangle closest to p or -1, weights of its closest point, and number of triangles in `space` within reach."""
    surfaces, trees, moved, space = ti.static(search.surfaces, search.trees, search.moved, search.space)
    best = ti.max(reach, depth) ** 2
    closest = -1
    closest_weights = vec3(0.0)
    within_reach = 0
    for k in range(near_count):
        leaf = space.leaf[k]
        if squared_distance(leaf, p, moved) <= ti.max(reach * reach, best):
            for i in range(trees.triangle_start[leaf], trees.triangle_start[leaf + 1]):
                t = trees.triangle[i]
                v = corners(t, surfaces)
                a, b, c = moved.position[v[0]], moved.position[v[1]], moved.position[v[2]]
                w = closest_on_triangle(p, a, b, c)
                d = (p - w[0] * a - w[1] * b - w[2] * c).norm_sqr()
                if d < best or (d == best and t < closest):
                    best, closest, closest_weights = d, t, w
                if d < reach * reach:
                    space.triangle[within_reach] = t
                    space.weights[within_reach] = w
                    within_reach += 1
    return closest, closest_weights, within_reach


@func
def store_vertex(
    group: ti.i32,
    v: ti.i32,
    t: ti.i32,
    bodies: ivec2,
    side: ti.i32,
    weights: vec3,
    out: vec3,
    distance: ti.f64,
    search: Search,
):
    """Add a contact of vertex v, this `side` of two surfaces, with triangle t, out of which `out` leads."""
    surfaces, position = ti.static(search.surfaces, search.moved.position)
    mine = side
    if group >= OWN_GROUPS:
        mine = is_backward(-out)
    c = append(group, v, t, bodies, (2 * mine - 1) * out, distance, search)
    set_side(c, mine, ivec3(v), vec3(1.0, 0.0, 0.0), position[v], search)
    set_side(c, 1 - mine, corners(t, surfaces), weights, on_triangle(t, weights, surfaces, position), search)


@func
def vertices_against_planes(search: Search):
    """Find vertices of moving surfaces within their bodies' reach of a plane; everything below it is inside."""
    reaches, surfaces, trees, planes, moved = ti.static(
        search.reaches, search.surfaces, search.trees, search.planes, search.moved
    )
    for plane in range(planes.point.shape[0]):
        up = planes.normal[plane]
        for k in range(surfaces.moving.shape[0]):
            s = surfaces.moving[k]
            reach = reaches[surfaces.body[s], planes.body[plane]]
            node = ti.select(reach < 0.0, trees.root[s + 1], trees.root[s])
            while node < trees.root[s + 1]:
                lowest = 0.0  # height of the box's lowest corner above the plane
                for axis in ti.static(range(3)):
                    corner = ti.select(up[axis] > 0.0, moved.lower[node][axis], moved.upper[node][axis])
                    lowest += up[axis] * (corner - planes.point[plane][axis])
                if lowest < reach:
                    for i in range(trees.vertex_start[node], trees.vertex_start[node + 1]):
                        v = trees.vertex[i]
                        p = moved.position[v]
                        distance = (p - planes.point[plane]).dot(up)
                        if distance < reach:
                            bodies = ivec2(surfaces.body[s], planes.body[plane])
                            c = append(PLANE_GROUPS + plane, v, plane, bodies, -up, distance, search)
                            set_side(c, 0, ivec3(v), vec3(1.0, 0.0, 0.0), p, search)
                            set_side(c, 1, ivec3(-1), vec3(0.0), p - distance * up, search)
                    node += 1
                else:
                    node = trees.escape[node]


# Narrow phase: edges of one surface against the edges of another or of the same.
#
# Where two edges cross over each other, and the direction between them leaves both surfaces, the distance has a local
# minimum. A penetrating contact has a negative distance and keeps its normal. Contact normals point from the first
# surface of the pair to the second.


@func
def edges_against_surface(group: ti.i32, mine: ti.i32, theirs: ti.i32, reach: ti.f64, least: ti.f64, search: Search):
    """Find crossing edges of two surfaces, or of a surface and itself, at distances from `least` to `reach` [mm]."""
    surfaces, trees, moved, space = ti.static(search.surfaces, search.trees, search.moved, search.space)
    bodies = ivec2(surfaces.body[mine], surfaces.body[theirs])
    their_low, their_high = moved.lower[trees.root[theirs]] - reach, moved.upper[trees.root[theirs]] + reach
    node = ti.select(reach < 0.0, trees.root[mine + 1], trees.root[mine])
    while node < trees.root[mine + 1]:
        if meets(node, their_low, their_high, moved):
            start, end = trees.edge_start[node], trees.edge_start[node + 1]
            if start < end:
                low, high = moved.lower[node] - reach, moved.upper[node] + reach
                near_count = find_leaves(theirs, low, high, trees, moved, space.leaf)
                for i in range(start, ti.select(near_count > 0, end, 0)):
                    find_crossings(group, trees.edge[i], bodies, near_count, reach, least, search)
            node += 1
        else:
            node = trees.escape[node]


@func
def find_crossings(
    group: ti.i32,
    e: ti.i32,
    bodies: ivec2,
    near_count: ti.i32,
    reach: ti.f64,
    least: ti.f64,
    search: Search,
):
    """Store the contacts of edge e with the edges of the leaves nearby, at distances from `least` to `reach`.

    An edge crosses only edges of higher numbers of its own body, and none at its ends.
    """
    surfaces, trees, moved, space = ti.static(search.surfaces, search.trees, search.moved, search.space)
    start, end = surfaces.edges[e, 0], surfaces.edges[e, 1]
    a, b = moved.position[start], moved.position[end]
    low, high = ti.min(a, b) - reach, ti.max(a, b) + reach
    axis, spread = normal_cone(e, surfaces, moved.position)
    middle = 0.5 * (a + b)
    slack = 0.5 * (b - a).norm() + reach * spread
    for k in range(near_count):
        leaf = space.leaf[k]
        if meets(leaf, low, high, moved) and meets_beam(leaf, middle, axis, slack, moved):
            for i in range(trees.edge_start[leaf], trees.edge_start[leaf + 1]):
                f = trees.edge[i]
                first, last = surfaces.edges[f, 0], surfaces.edges[f, 1]
                c, d = moved.position[first], moved.position[last]
                is_apart = group < OWN_GROUPS or (
                    f > e and start != first and start != last and end != first and end != last
                )
                if is_apart and (ti.min(c, d) <= high).all() and (ti.max(c, d) >= low).all():
                    cross_over(group, e, f, bodies, reach, least, search)


@func
def cross_over(group: ti.i32, e: ti.i32, f: ti.i32, bodies: ivec2, reach: ti.f64, least: ti.f64, search: Search):
    """Store the contact of edges e and f, if they cross over each other at a distance from `least` to `reach`."""
    surfaces, position, touching = ti.static(search.surfaces, search.moved.position, search.touching)
    a, c = position[surfaces.edges[e, 0]], position[surfaces.edges[f, 0]]
    along, other = position[surfaces.edges[e, 1]] - a, position[surfaces.edges[f, 1]] - c
    lengths = along.norm_sqr() * other.norm_sqr()
    cosine = along.dot(other)
    crossing = lengths - cosine * cosine
    r = a - c
    s = (cosine * other.dot(r) - along.dot(r) * other.norm_sqr()) / crossing
    q = (along.norm_sqr() * other.dot(r) - cosine * along.dot(r)) / crossing
    if crossing > 1e-8 * lengths and s > 0.0 and s < 1.0 and q > 0.0 and q < 1.0:
        gap = c + q * other - a - s * along
        distance = gap.norm()
        is_apart = distance < reach
        if is_apart and group >= OWN_GROUPS:  # nested: after `and` Taichi would always call the function
            is_apart = segment_distance(e, f, surfaces, touching.rest) >= touching.limits[NEAR]
        if is_apart:
            normal = direction(gap, along.cross(other).normalized())
            leaving = normal.dot(edge_pseudonormal(e, surfaces, position))
            meeting = -normal.dot(edge_pseudonormal(f, surfaces, position))
            if leaving < 0.0 and meeting < 0.0:
                normal, distance = -normal, -distance
                leaving, meeting = -leaving, -meeting
            if (
                leaving > 0.0
                and meeting > 0.0
                and distance >= least
                and in_normal_cone(e, normal, surfaces, position)
                and in_normal_cone(f, -normal, surfaces, position)
            ):
                side = ti.select(group >= OWN_GROUPS, is_backward(normal), 0)
                k = append(group, e, f, bodies, (1 - 2 * side) * normal, distance, search)
                set_side(k, side, ends(e, surfaces), vec3(1.0 - s, s, 0.0), a + s * along, search)
                set_side(k, 1 - side, ends(f, surfaces), vec3(1.0 - q, q, 0.0), c + q * other, search)


@func
def is_backward(normal: vec3) -> ti.i32:
    """Whether a normal points against ALONG."""
    return ti.cast(normal.dot(vec3(ALONG[0], ALONG[1], ALONG[2])) < 0.0, ti.i32)


@func
def segment_distance(e: ti.i32, f: ti.i32, surfaces: Surfaces, position: Vectors) -> ti.f64:
    """Distance of edges e and f [mm] (Ericson 2005, Real-Time Collision Detection, section 5.1.9)."""
    a, c = position[surfaces.edges[e, 0]], position[surfaces.edges[f, 0]]
    along, other = position[surfaces.edges[e, 1]] - a, position[surfaces.edges[f, 1]] - c
    r = a - c
    first, second, cosine = along.norm_sqr(), other.norm_sqr(), along.dot(other)
    crossing = first * second - cosine * cosine
    s = 0.0
    if crossing > 1e-12 * first * second:
        s = ti.min(ti.max((cosine * other.dot(r) - along.dot(r) * second) / crossing, 0.0), 1.0)
    q = (cosine * s + other.dot(r)) / second
    if q < 0.0:
        q = 0.0
        s = ti.min(ti.max(-along.dot(r) / first, 0.0), 1.0)
    elif q > 1.0:
        q = 1.0
        s = ti.min(ti.max((cosine - along.dot(r)) / first, 0.0), 1.0)
    return (r + s * along - q * other).norm()


# The search for contacts: pairs of close points on two surfaces, each a local minimum of the distance.


@kernel
def find_contacts(search: Search, depth: ti.f64, extent: Scalars, contacts: Contacts):
    """Find all contacts closer than the `reaches` of their two bodies or penetrating by up to `depth` [mm].

    Edges penetrate by no more than the reach and the smallest `extent` of both bodies [mm], shape (body_count,): beyond
    it, edges only look as if they penetrated each other. Crossed edges deeper than the deepest vertex inside are
    excluded too. Where a block has sunk a little into the rim of a table, its vertical edge and the table's edge also
    appear to penetrate each other, but sideways and by far more: pushing them apart would be wrong.

    If the capacity of `found` does not suffice, its count exceeds the capacity, and `contacts` is not filled.
    """
    reaches, surfaces, found = ti.static(search.reaches, search.surfaces, search.found)
    ti.loop_config(serialize=True)
    for _ in range(1):
        found.count[0] = 0
        for pair in range(surfaces.pairs.shape[0]):
            first, second = surfaces.pairs[pair, 0], surfaces.pairs[pair, 1]
            a, b, group = surfaces.body[first], surfaces.body[second], VERTEX_GROUPS + 2 * pair
            reach = reaches[a, b]
            deepest = vertices_against_surface(group, first, second, 0, reach, depth, search)
            deepest = ti.max(deepest, vertices_against_surface(group + 1, second, first, 1, reach, depth, search))
            most = ti.min(ti.min(depth, reach), ti.min(extent[a], extent[b]))
            if deepest > 0.0:
                most = ti.min(most, deepest)
            edges_against_surface(EDGE_GROUPS + pair, first, second, reach, -most, search)
        vertices_against_planes(search)
        if found.count[0] <= found.distance.shape[0]:
            put_in_order(search, contacts)


@kernel
def find_self_contacts(search: Search):
    """Add the self-contacts closer than the reach of their body [mm] to `found`.

    A body with a negative entry on the diagonal of `reaches` is skipped.
    """
    reaches, surfaces, touching = ti.static(search.reaches, search.surfaces, search.touching)
    ti.loop_config(serialize=True)
    for k in range(touching.surface.shape[0]):
        s, group, depth = touching.surface[k], OWN_GROUPS + 2 * k, touching.limits[DEPTH]
        reach = reaches[surfaces.body[s], surfaces.body[s]]
        deepest = vertices_against_surface(group, s, s, 0, reach, depth, search)
        edges_against_surface(group + 1, s, s, reach, ti.select(deepest > 0.0, -deepest, -depth), search)


@kernel
def order_contacts(search: Search, contacts: Contacts):
    """Write all contacts found to `contacts` in the order of their places, if the capacity suffices."""
    found = ti.static(search.found)
    ti.loop_config(serialize=True)
    for _ in range(1):
        if found.count[0] <= found.distance.shape[0]:
            put_in_order(search, contacts)
