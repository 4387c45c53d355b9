"""Narrow phase: vertices and edges of a surface against the rest of the same surface.

A surface is close to itself everywhere, along the skin and through the thickness of every wall. The rest shape
separates contacts from neighbours: features closer to each other at rest than a limit never touch. The limit is twice
the depth to which penetrations are pushed out, so that a wall would have to be pressed to half of its thickness before
its two sides counted as penetrating.

Inside and outside follow as for two surfaces; besides, a vertex touches only what its own outward normal faces.
"""

from taichisoft.contact.kernels.box_trees import find_leaves, squared_distance
from taichisoft.contact.kernels.contacts import DEPTH, NEAR, OWN, Search, ivec2, ivec3
from taichisoft.contact.kernels.vertex_contacts import (
    COINCIDENT,
    closest_on_triangle,
    find_crossings,
    is_backward,
    is_local_minimum,
    on_triangle,
    outward_normal,
    store_vertex,
    vertex_pseudonormal,
)
from taichisoft.runtime.language import Vectors, func, ti, vec3
from taichisoft.runtime.launch import kernel


@kernel
def find_self_contacts(search: Search):
    """Add the self-contacts closer than the reach of their body [mm] to `found`.

    A body with a negative entry on the diagonal of `reaches` is skipped.
    """
    reaches, trees, moved, touching = ti.static(search.reaches, search.trees, search.moved, search.touching)
    leaves = ti.static(search.space.leaf)
    ti.loop_config(serialize=True)
    for k in range(touching.surface.shape[0]):
        s = touching.surface[k]
        bodies = ivec2(search.surfaces.body[s])
        reach = reaches[bodies[0], bodies[0]]
        if reach > 0.0:
            deepest = 0.0
            for node in range(trees.root[s], trees.root[s + 1]):
                start, end = trees.vertex_start[node], trees.vertex_start[node + 1]
                if start < end:
                    low, high = moved.lower[node] - reach, moved.upper[node] + reach
                    near_count = find_leaves(s, low, high, trees, moved, leaves)
                    for i in range(start, end):
                        deepest = ti.max(
                            deepest, touch_itself(OWN + 2 * k, trees.vertex[i], bodies, near_count, reach, search)
                        )
            least = -touching.limits[DEPTH]
            if deepest > 0.0:
                least = -deepest
            for node in range(trees.root[s], trees.root[s + 1]):
                start, end = trees.edge_start[node], trees.edge_start[node + 1]
                if start < end:
                    low, high = moved.lower[node] - reach, moved.upper[node] + reach
                    near_count = find_leaves(s, low, high, trees, moved, leaves)
                    for i in range(start, end):
                        find_crossings(OWN + 2 * k + 1, trees.edge[i], bodies, near_count, reach, least, search)


@func
def touch_itself(group: ti.i32, v: ti.i32, bodies: ivec2, near_count: ti.i32, reach: ti.f64, search: Search) -> ti.f64:
    """Store the contacts of vertex v with the triangles of the leaves nearby; returns its penetration [mm]."""
    surfaces, trees, moved, space = ti.static(search.surfaces, search.trees, search.moved, search.space)
    touching = ti.static(search.touching)
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
                            side = is_backward(-facing_there)
                            normal = (2 * side - 1) * facing_there
                            store_vertex(group, v, t, bodies, side, w, normal, distance, search)
    slipped = 0.0
    if behind >= 0:
        slipped = least_depth
        side = is_backward(-behind_out)
        store_vertex(group, v, behind, bodies, side, behind_weights, (2 * side - 1) * behind_out, -slipped, search)
    return slipped


@func
def closest_on_corners(p: vec3, corners: ivec3, position: Vectors) -> vec3:
    """Barycentric weights of the point closest to p of the triangle with vertices `corners`."""
    return closest_on_triangle(p, position[corners[0]], position[corners[1]], position[corners[2]])
