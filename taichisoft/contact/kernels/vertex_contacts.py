"""Narrow phase: vertices and edges of one surface against the triangles and edges of another, and planes.

A contact is a local minimum of the distance. A penetrating contact has a negative distance and keeps its normal.
Contact normals point from the first surface of the pair to the second.
"""

import math

from taichisoft.contact.kernels.box_trees import find_leaves, meets, meets_beam, squared_distance
from taichisoft.contact.kernels.contacts import (
    NEAR,
    OWN,
    Contacts,
    Search,
    Surfaces,
    append,
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


# Narrow phase: vertices of one surface against the triangles of another, and against planes.

COINCIDENT = 1e-9  # [mm]
# Both features are of one body: the one farther along this direction is the second side, so that neighbouring contacts
# have similar normals, whichever feature is the vertex.
ALONG = (1.0, 0.618, 0.383)


@func
def bodies_of_pair(pair: ti.i32, surfaces: Surfaces) -> ivec2:
    """Numbers of the bodies of a pair of surfaces."""
    return ivec2(surfaces.body[surfaces.pairs[pair, 0]], surfaces.body[surfaces.pairs[pair, 1]])


@func
def vertices_against_triangles(search: Search, depth: ti.f64):
    """Find contacts of the vertices of each surface of a pair with the triangles of the other surface.

    A vertex outside touches at every local minimum within the reach of its bodies [mm]; a vertex inside touches at the
    closest point only, and only down to `depth` [mm].
    """
    reaches, surfaces, trees, moved, space = ti.static(
        search.reaches, search.surfaces, search.trees, search.moved, search.space
    )
    for task in range(2 * surfaces.pairs.shape[0]):
        pair, flipped = task // 2, task % 2
        mine, theirs = surfaces.pairs[pair, flipped], surfaces.pairs[pair, 1 - flipped]
        reach = reaches[surfaces.body[mine], surfaces.body[theirs]]
        far = ti.max(reach, depth)
        if flipped == 0:
            space.deepest[pair] = 0.0
        their_low, their_high = moved.lower[trees.root[theirs]] - far, moved.upper[trees.root[theirs]] + far
        node = ti.select(reach < 0.0, trees.root[mine + 1], trees.root[mine])
        while node < trees.root[mine + 1]:
            if meets(node, their_low, their_high, moved):
                start, end = trees.vertex_start[node], trees.vertex_start[node + 1]
                if start < end:
                    low, high = moved.lower[node] - far, moved.upper[node] + far
                    near_count = find_leaves(theirs, low, high, trees, moved, space.leaf)
                    for i in range(start, ti.select(near_count > 0, end, 0)):
                        touch(task, trees.vertex[i], near_count, reach, depth, search)
                node += 1
            else:
                node = trees.escape[node]


@func
def touch(task: ti.i32, v: ti.i32, near_count: ti.i32, reach: ti.f64, depth: ti.f64, search: Search):
    """Store the contacts of vertex v with the triangles of the leaves nearby."""
    surfaces, moved, space = ti.static(search.surfaces, search.moved, search.space)
    flipped = task % 2
    towards = 2 * flipped - 1  # the normal points from the first surface to the second
    bodies = bodies_of_pair(task // 2, surfaces)
    p = moved.position[v]
    closest, weights, within_reach = find_triangles(p, near_count, reach, depth, search)
    if closest >= 0:
        out = outward_normal(closest, weights, surfaces, moved.position)
        foot = on_triangle(closest, weights, surfaces, moved.position)
        if (p - foot).dot(out) < 0.0:
            beyond_rim = 0
            for k in ti.static(range(3)):
                if weights[k] == 0.0 and surfaces.edge_triangles[surfaces.triangle_edges[closest, k], 1] < 0:
                    beyond_rim = 1
            depth_here = (foot - p).norm()
            if depth_here > COINCIDENT:
                out = (foot - p) / depth_here
            if depth_here <= depth and beyond_rim == 0:
                space.deepest[task // 2] = ti.min(space.deepest[task // 2], -depth_here)
                store_vertex(task, v, closest, bodies, flipped, weights, towards * out, -depth_here, search)
        else:
            for k in range(within_reach):
                t, w = space.triangle[k], space.weights[k]
                there = on_triangle(t, w, surfaces, moved.position)
                away = p - there
                if is_local_minimum(t, w, away, surfaces, moved.position):
                    facing = outward_normal(t, w, surfaces, moved.position)
                    if away.dot(facing) >= 0.0:
                        distance = away.norm()
                        if distance > COINCIDENT:
                            facing = away / distance
                        store_vertex(task, v, t, bodies, flipped, w, towards * facing, distance, search)


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
                a = moved.position[surfaces.triangles[t, 0]]
                b = moved.position[surfaces.triangles[t, 1]]
                c = moved.position[surfaces.triangles[t, 2]]
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
def on_triangle(t: ti.i32, weights: vec3, surfaces: Surfaces, position: Vectors) -> vec3:
    """Point of triangle t with barycentric `weights` [mm]."""
    return (
        weights[0] * position[surfaces.triangles[t, 0]]
        + weights[1] * position[surfaces.triangles[t, 1]]
        + weights[2] * position[surfaces.triangles[t, 2]]
    )


@func
def store_vertex(
    group: ti.i32,
    v: ti.i32,
    t: ti.i32,
    bodies: ivec2,
    side: ti.i32,
    weights: vec3,
    normal: vec3,
    distance: ti.f64,
    search: Search,
):
    """Add a contact of vertex v, which is the `side` of the two, with triangle t."""
    surfaces, position = ti.static(search.surfaces, search.moved.position)
    c = append(group, v, t, bodies[0], bodies[1], normal, distance, search)
    set_side(c, side, ivec3(v), vec3(1.0, 0.0, 0.0), position[v], search)
    corners = ivec3(surfaces.triangles[t, 0], surfaces.triangles[t, 1], surfaces.triangles[t, 2])
    set_side(c, 1 - side, corners, weights, on_triangle(t, weights, surfaces, position), search)


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
                            c = append(
                                3 * surfaces.pairs.shape[0] + plane,
                                v,
                                plane,
                                surfaces.body[s],
                                planes.body[plane],
                                -up,
                                distance,
                                search,
                            )
                            set_side(c, 0, ivec3(v), vec3(1.0, 0.0, 0.0), p, search)
                            set_side(c, 1, ivec3(-1), vec3(0.0), p - distance * up, search)
                    node += 1
                else:
                    node = trees.escape[node]


# Narrow phase: edges of one surface against the edges of another.
#
# Where two edges cross over each other, and the direction between them leaves both surfaces, the distance has a local
# minimum. A penetrating contact has a negative distance and keeps its normal. Contact normals point from the first
# surface of the pair to the second.


@func
def edges_against_edges(search: Search, depth: ti.f64, extent: Scalars):
    """Find crossing edges of two surfaces within their bodies' reach, or penetrating by up to the reach and `depth`.

    They are no deeper than the thinner body: beyond it, edges only look as if they penetrated each other.

    Crossed edges deeper than the deepest vertex inside are excluded. Where a block has sunk a little into the rim of a
    table, its vertical edge and the table's edge also appear to penetrate each other, but sideways and by far more:
    pushing them apart would be wrong.
    """
    reaches, surfaces, trees, moved, space = ti.static(
        search.reaches, search.surfaces, search.trees, search.moved, search.space
    )
    for pair in range(surfaces.pairs.shape[0]):
        mine, theirs = surfaces.pairs[pair, 0], surfaces.pairs[pair, 1]
        bodies = bodies_of_pair(pair, surfaces)
        reach = reaches[bodies[0], bodies[1]]
        their_low, their_high = moved.lower[trees.root[theirs]] - reach, moved.upper[trees.root[theirs]] + reach
        thinnest = ti.min(extent[bodies[0]], extent[bodies[1]])
        least = -ti.min(ti.min(depth, reach), thinnest)
        if space.deepest[pair] < 0.0:
            least = ti.max(least, space.deepest[pair])
        node = ti.select(reach < 0.0, trees.root[mine + 1], trees.root[mine])
        while node < trees.root[mine + 1]:
            if meets(node, their_low, their_high, moved):
                start, end = trees.edge_start[node], trees.edge_start[node + 1]
                if start < end:
                    low, high = moved.lower[node] - reach, moved.upper[node] + reach
                    near_count = find_leaves(theirs, low, high, trees, moved, space.leaf)
                    for i in range(start, ti.select(near_count > 0, end, 0)):
                        e = trees.edge[i]
                        group = 2 * surfaces.pairs.shape[0] + pair
                        find_crossings(group, e, bodies, near_count, reach, least, search)
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
                is_apart = group < OWN or (f > e and start != first and start != last and end != first and end != last)
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
        if is_apart and group >= OWN:  # nested: after `and` Taichi would always call the function
            is_apart = segment_distance(e, f, surfaces, touching.rest) >= touching.limits[NEAR]
        if is_apart:
            normal = along.cross(other).normalized()
            if distance > COINCIDENT:
                normal = gap / distance
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
                side = ti.select(group >= OWN, is_backward(normal), 0)
                k = append(group, e, f, bodies[0], bodies[1], (1 - 2 * side) * normal, distance, search)
                ends = ivec3(surfaces.edges[e, 0], surfaces.edges[e, 1], surfaces.edges[e, 1])
                set_side(k, side, ends, vec3(1.0 - s, s, 0.0), a + s * along, search)
                ends = ivec3(surfaces.edges[f, 0], surfaces.edges[f, 1], surfaces.edges[f, 1])
                set_side(k, 1 - side, ends, vec3(1.0 - q, q, 0.0), c + q * other, search)


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

    Edges penetrate by no more than the smallest `extent` of both bodies [mm], shape (body_count,). If the capacity of
    `found` does not suffice, its count exceeds the capacity, and `contacts` is not filled.
    """
    found = ti.static(search.found)
    ti.loop_config(serialize=True)
    for _ in range(1):
        found.count[0] = 0
        vertices_against_triangles(search, depth)
        edges_against_edges(search, depth, extent)
        vertices_against_planes(search)
        if found.count[0] <= found.distance.shape[0]:
            put_in_order(search, contacts)


@kernel
def order_contacts(search: Search, contacts: Contacts):
    """Write all contacts found to `contacts` in the order of their places, if the capacity suffices."""
    found = ti.static(search.found)
    ti.loop_config(serialize=True)
    for _ in range(1):
        if found.count[0] <= found.distance.shape[0]:
            put_in_order(search, contacts)
