"""Narrow phase: vertices and edges of a surface against the rest of the same surface.

A surface is close to itself everywhere, along the skin and through the thickness of every wall. The rest shape
separates contacts from neighbours: features closer to each other at rest than a limit never touch. The limit is twice
the depth to which penetrations are pushed out, so that a wall would have to be pressed to half of its thickness before
its two sides counted as penetrating.

Inside and outside follow as for two surfaces; besides, a vertex touches only what its own outward normal faces.
"""

from typing import NamedTuple

from taichisoft.contact.kernels.box_trees import Trees, find_leaves, meets, meets_beam, squared_distance
from taichisoft.contact.kernels.contacts import Contacts, MovedSurfaces, SearchSpace, Surfaces, append, ivec3, set_side
from taichisoft.contact.kernels.vertex_contacts import (
    COINCIDENT,
    closest_on_triangle,
    edge_pseudonormal,
    in_normal_cone,
    is_local_minimum,
    normal_cone,
    on_triangle,
    outward_normal,
    vertex_pseudonormal,
)
from taichisoft.runtime.language import Integers, Scalars, ScalarTable, Vectors, func, ti, vec3
from taichisoft.runtime.launch import kernel

FIRST_GROUP = 1 << 22  # after the groups of contacts between different surfaces

# Both features are of one body: the one farther along this direction is the second side, so that neighbouring contacts
# have similar normals, whichever feature is the vertex.
ALONG = (1.0, 0.618, 0.383)


# Entries of SelfTouching.limits.
NEAR, DEPTH = range(2)


class SelfTouching(NamedTuple):
    """The surfaces that touch themselves.

    Attributes:
        surface: numbers of the surfaces, shape (count,).
        rest: rest positions of the vertices of all surfaces [mm], shape (vertex_count, 3).
        limits: NEAR, the distance at rest below which features never touch, and DEPTH, the largest penetration that is
            pushed out [mm], shape (2,).
    """

    surface: Integers
    rest: Vectors
    limits: Scalars


@kernel
def find_self_contacts(
    reach_of_bodies: ScalarTable,
    touching: SelfTouching,
    surfaces: Surfaces,
    trees: Trees,
    moved: MovedSurfaces,
    space: SearchSpace,
    found: Contacts,
):
    """Add the self-contacts closer than the reach of their body [mm] to `found`.

    `reach_of_bodies` is of shape (body_count, body_count); a body with a negative entry on the diagonal is skipped.
    """
    ti.loop_config(serialize=True)
    for k in range(touching.surface.shape[0]):
        s = touching.surface[k]
        body = surfaces.body[s]
        reach = reach_of_bodies[body, body]
        if reach > 0.0:
            deepest = 0.0
            for node in range(trees.root[s], trees.root[s + 1]):
                start, end = trees.vertex_start[node], trees.vertex_start[node + 1]
                if start < end:
                    low, high = moved.lower[node] - reach, moved.upper[node] + reach
                    near_count = find_leaves(s, low, high, trees, moved, space.leaf)
                    for i in range(start, end):
                        depth_here = touch_itself(
                            FIRST_GROUP + 2 * k, trees.vertex[i], body, near_count, reach, touching,
                            surfaces, trees, moved, space, found,
                        )  # fmt: skip
                        deepest = ti.max(deepest, depth_here)
            least = -touching.limits[DEPTH]
            if deepest > 0.0:
                least = -deepest
            for node in range(trees.root[s], trees.root[s + 1]):
                start, end = trees.edge_start[node], trees.edge_start[node + 1]
                if start < end:
                    low, high = moved.lower[node] - reach, moved.upper[node] + reach
                    near_count = find_leaves(s, low, high, trees, moved, space.leaf)
                    for i in range(start, end):
                        cross_itself(
                            FIRST_GROUP + 2 * k + 1, trees.edge[i], body, near_count, reach, least, touching,
                            surfaces, trees, moved, space, found,
                        )  # fmt: skip


@func
def touch_itself(
    group: ti.i32,
    v: ti.i32,
    body: ti.i32,
    near_count: ti.i32,
    reach: ti.f64,
    touching: SelfTouching,
    surfaces: Surfaces,
    trees: Trees,
    moved: MovedSurfaces,
    space: SearchSpace,
    found: Contacts,
) -> ti.f64:
    """Store the contacts of vertex v with the triangles of the leaves nearby; returns its penetration [mm]."""
    p = moved.position[v]
    facing_here = vertex_pseudonormal(v, surfaces, moved.position)
    behind = -1
    behind_weights, behind_out = vec3(0.0), vec3(0.0)
    least_depth = touching.limits[DEPTH]
    for k in range(near_count):
        leaf = space.leaf[k]
        if squared_distance(leaf, p, moved) < reach * reach:
            for i in range(trees.triangle_start[leaf], trees.triangle_start[leaf + 1]):
                t = trees.triangle[i]
                corners = ivec3(surfaces.triangles[t, 0], surfaces.triangles[t, 1], surfaces.triangles[t, 2])
                w = closest_on_corners(p, corners, moved.position)
                away = p - on_triangle(t, w, surfaces, moved.position)
                distance = away.norm()
                is_minimum = 0
                if distance < reach:  # nested: after `and` Taichi would always call the function
                    is_minimum = is_local_minimum(t, w, away, surfaces, moved.position)
                if is_minimum:
                    u = closest_on_corners(touching.rest[v], corners, touching.rest)
                    at_rest = touching.rest[v] - on_triangle(t, u, surfaces, touching.rest)
                    if at_rest.norm() >= touching.limits[NEAR]:
                        facing_there = outward_normal(t, w, surfaces, moved.position)
                        if away.dot(facing_there) < 0.0:
                            if distance < least_depth and facing_there.dot(facing_here) < 0.0:
                                behind, behind_weights, least_depth = t, w, distance
                                behind_out = facing_there
                                if distance > COINCIDENT:
                                    behind_out = -away / distance
                        elif away.dot(facing_here) <= 0.0:
                            if distance > COINCIDENT:
                                facing_there = away / distance
                            store_vertex(group, v, t, body, w, -facing_there, distance, surfaces, moved, space, found)
    slipped = 0.0
    if behind >= 0:
        slipped = least_depth
        store_vertex(group, v, behind, body, behind_weights, -behind_out, -slipped, surfaces, moved, space, found)
    return slipped


@func
def closest_on_corners(p: vec3, corners: ivec3, position: Vectors) -> vec3:
    """Barycentric weights of the point closest to p of the triangle with vertices `corners`."""
    return closest_on_triangle(p, position[corners[0]], position[corners[1]], position[corners[2]])


@func
def store_vertex(
    group: ti.i32,
    v: ti.i32,
    t: ti.i32,
    body: ti.i32,
    weights: vec3,
    normal: vec3,
    distance: ti.f64,
    surfaces: Surfaces,
    moved: MovedSurfaces,
    space: SearchSpace,
    found: Contacts,
):
    """Add a contact of vertex v with triangle t; the normal points from the vertex into the triangle."""
    flipped = is_backward(normal)
    c = append(group, v, t, body, body, (1 - 2 * flipped) * normal, distance, space, found)
    corners = ivec3(surfaces.triangles[t, 0], surfaces.triangles[t, 1], surfaces.triangles[t, 2])
    set_side(c, flipped, ivec3(v), vec3(1.0, 0.0, 0.0), moved.position[v], found)
    set_side(c, 1 - flipped, corners, weights, on_triangle(t, weights, surfaces, moved.position), found)


@func
def cross_itself(
    group: ti.i32,
    e: ti.i32,
    body: ti.i32,
    near_count: ti.i32,
    reach: ti.f64,
    least: ti.f64,
    touching: SelfTouching,
    surfaces: Surfaces,
    trees: Trees,
    moved: MovedSurfaces,
    space: SearchSpace,
    found: Contacts,
):
    """Store the contacts of edge e with edges of higher numbers in the leaves nearby."""
    a, b = surfaces.edges[e, 0], surfaces.edges[e, 1]
    low = ti.min(moved.position[a], moved.position[b]) - reach
    high = ti.max(moved.position[a], moved.position[b]) + reach
    axis, spread = normal_cone(e, surfaces, moved.position)
    middle = 0.5 * (moved.position[a] + moved.position[b])
    slack = 0.5 * (moved.position[b] - moved.position[a]).norm() + reach * spread
    for k in range(near_count):
        leaf = space.leaf[k]
        if meets(leaf, low, high, moved) and meets_beam(leaf, middle, axis, slack, moved):
            for i in range(trees.edge_start[leaf], trees.edge_start[leaf + 1]):
                f = trees.edge[i]
                c, d = surfaces.edges[f, 0], surfaces.edges[f, 1]
                lower = ti.min(moved.position[c], moved.position[d])
                upper = ti.max(moved.position[c], moved.position[d])
                apart = a != c and a != d and b != c and b != d
                if f > e and apart and (lower <= high).all() and (upper >= low).all():
                    cross_edge(group, e, f, body, reach, least, touching, surfaces, moved.position, space, found)


@func
def cross_edge(
    group: ti.i32,
    e: ti.i32,
    f: ti.i32,
    body: ti.i32,
    reach: ti.f64,
    least: ti.f64,
    touching: SelfTouching,
    surfaces: Surfaces,
    position: Vectors,
    space: SearchSpace,
    found: Contacts,
):
    """Store the contact of edges e and f, if they cross at a distance between `least` and `reach` [mm]."""
    a, c = position[surfaces.edges[e, 0]], position[surfaces.edges[f, 0]]
    along, other = position[surfaces.edges[e, 1]] - a, position[surfaces.edges[f, 1]] - c
    lengths, cosine = along.norm_sqr() * other.norm_sqr(), along.dot(other)
    crossing = lengths - cosine * cosine
    r = a - c
    s = (cosine * other.dot(r) - along.dot(r) * other.norm_sqr()) / crossing
    q = (along.norm_sqr() * other.dot(r) - cosine * along.dot(r)) / crossing
    if crossing > 1e-8 * lengths and s > 0.0 and s < 1.0 and q > 0.0 and q < 1.0:
        gap = c + q * other - a - s * along
        distance = gap.norm()
        apart_at_rest = 0.0
        if distance < reach:  # nested: after `and` Taichi would always call the function
            apart_at_rest = segment_distance(e, f, surfaces, touching.rest)
        if distance < reach and apart_at_rest >= touching.limits[NEAR]:
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
                flipped = is_backward(normal)
                k = append(group, e, f, body, body, (1 - 2 * flipped) * normal, distance, space, found)
                ends = ivec3(surfaces.edges[e, 0], surfaces.edges[e, 1], surfaces.edges[e, 1])
                set_side(k, flipped, ends, vec3(1.0 - s, s, 0.0), a + s * along, found)
                ends = ivec3(surfaces.edges[f, 0], surfaces.edges[f, 1], surfaces.edges[f, 1])
                set_side(k, 1 - flipped, ends, vec3(1.0 - q, q, 0.0), c + q * other, found)


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
