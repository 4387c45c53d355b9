"""Narrow phase: vertices of one surface against the triangles of another.

A contact is a local minimum of the distance; one that has slipped through has a negative distance and keeps its
normal. Contact normals point from the first surface of the pair to the second.
"""

from taichisoft.kernels.bounding_volumes import find_leaves, meets, squared_distance
from taichisoft.kernels.contact_store import COINCIDENT, store
from taichisoft.kernels.launch import kernel
from taichisoft.kernels.local_distance import closest_on_triangle, is_local_minimum, outward_normal
from taichisoft.kernels.runtime import IntegerBlocks, Integers, IntegerTable, Scalars, Vectors, VectorTable, ti, vec3


@kernel
def vertices_against_triangles(
    pair_surfaces: IntegerTable,
    body: Integers,
    reach: ti.f64,
    depth: ti.f64,
    triangles: IntegerTable,
    triangle_edges: IntegerTable,
    edges: IntegerTable,
    edge_triangles: IntegerTable,
    star_start: Integers,
    star: Integers,
    first_triangle: Integers,
    fan_start: Integers,
    fan: Integers,
    position: Vectors,
    root: Integers,
    escape: Integers,
    triangle_start: Integers,
    triangle: Integers,
    vertex_start: Integers,
    vertex: Integers,
    lower: Vectors,
    upper: Vectors,
    near: Integers,
    near_triangle: Integers,
    near_weights: Vectors,
    deepest: Scalars,
    count: Integers,
    places: IntegerTable,
    bodies: IntegerTable,
    vertices: IntegerBlocks,
    weights: VectorTable,
    points: VectorTable,
    normals: Vectors,
    distances: Scalars,
):
    """Vertices of each surface of a pair against the other's triangles.

    A vertex outside touches at every local minimum closer than `reach`; one inside only at the closest point of
    all, if it is not deeper than `depth`. `deepest` keeps the least distance of each pair below 0, 0 for none.
    """
    ti.loop_config(serialize=True)
    for task in range(2 * pair_surfaces.shape[0]):
        pair, flipped = task // 2, task % 2
        mine, theirs = pair_surfaces[pair, flipped], pair_surfaces[pair, 1 - flipped]
        far = ti.max(reach, depth)
        if flipped == 0:
            deepest[pair] = 0.0
        their_low, their_high = lower[root[theirs]] - far, upper[root[theirs]] + far
        node = root[mine]
        while node < root[mine + 1]:
            if meets(node, their_low, their_high, lower, upper):
                if vertex_start[node] < vertex_start[node + 1]:
                    near_count = find_leaves(
                        theirs, lower[node] - far, upper[node] + far, root, escape, lower, upper, near
                    )
                    for i in range(vertex_start[node], ti.select(near_count > 0, vertex_start[node + 1], 0)):
                        v = vertex[i]
                        p = position[v]
                        # The closest triangle, and all those within reach.
                        best = far * far
                        best_triangle = -1
                        best_weights = vec3(0.0)
                        within_reach = 0
                        for k in range(near_count):
                            leaf = near[k]
                            if squared_distance(leaf, p, lower, upper) <= ti.max(reach * reach, best):
                                for j in range(triangle_start[leaf], triangle_start[leaf + 1]):
                                    t = triangle[j]
                                    a, b, c = (
                                        position[triangles[t, 0]],
                                        position[triangles[t, 1]],
                                        position[triangles[t, 2]],
                                    )
                                    w = closest_on_triangle(p, a, b, c)
                                    d = (p - w[0] * a - w[1] * b - w[2] * c).norm_sqr()
                                    if d < best or (d == best and t < best_triangle):
                                        best, best_triangle, best_weights = d, t, w
                                    if d < reach * reach:
                                        near_triangle[within_reach] = t
                                        near_weights[within_reach] = w
                                        within_reach += 1
                        if best_triangle >= 0:
                            touch(
                                pair, flipped, v, best_triangle, best_weights, within_reach, depth,
                                body[pair_surfaces[pair, 0]], body[pair_surfaces[pair, 1]],
                                triangles, triangle_edges, edges, edge_triangles, star_start, star, first_triangle,
                                fan_start, fan, position, near_triangle, near_weights, deepest,
                                count, places, bodies, vertices, weights, points, normals, distances,
                            )  # fmt: skip
                node += 1
            else:
                node = escape[node]


@ti.func
def touch(
    pair: ti.i32,
    flipped: ti.i32,
    v: ti.i32,
    closest: ti.i32,
    closest_weights: vec3,
    within_reach: ti.i32,
    depth: ti.f64,
    first_body: ti.i32,
    second_body: ti.i32,
    triangles: IntegerTable,
    triangle_edges: IntegerTable,
    edges: IntegerTable,
    edge_triangles: IntegerTable,
    star_start: Integers,
    star: Integers,
    first_triangle: Integers,
    fan_start: Integers,
    fan: Integers,
    position: Vectors,
    near_triangle: Integers,
    near_weights: Vectors,
    deepest: Scalars,
    count: Integers,
    places: IntegerTable,
    bodies: IntegerTable,
    vertices: IntegerBlocks,
    weights: VectorTable,
    points: VectorTable,
    normals: Vectors,
    distances: Scalars,
):
    """Store the contacts of vertex v, given its closest triangle and all those within reach."""
    p = position[v]
    out = outward_normal(closest, closest_weights, triangles, triangle_edges, edge_triangles, fan_start, fan, position)
    foot = on_triangle(closest, closest_weights, triangles, position)
    if (p - foot).dot(out) < 0.0:
        beyond_rim = 0
        for k in ti.static(range(3)):
            if closest_weights[k] == 0.0 and edge_triangles[triangle_edges[closest, k], 1] < 0:
                beyond_rim = 1
        depth_here = (foot - p).norm()
        if depth_here > COINCIDENT:
            out = (foot - p) / depth_here
        if depth_here <= depth and beyond_rim == 0:
            deepest[pair] = ti.min(deepest[pair], -depth_here)
            store_vertex_contact(
                pair, flipped, v, closest, closest_weights, p, foot, out, -depth_here, first_body, second_body,
                triangles, count, places, bodies, vertices, weights, points, normals, distances,
            )  # fmt: skip
    else:
        for k in range(within_reach):
            t, w = near_triangle[k], near_weights[k]
            there = on_triangle(t, w, triangles, position)
            away = p - there
            if is_local_minimum(
                t, w, away, triangles, triangle_edges, edges, edge_triangles, star_start, star, first_triangle, position
            ):
                facing = outward_normal(t, w, triangles, triangle_edges, edge_triangles, fan_start, fan, position)
                if away.dot(facing) >= 0.0:
                    distance = away.norm()
                    if distance > COINCIDENT:
                        facing = away / distance
                    store_vertex_contact(
                        pair, flipped, v, t, w, p, there, facing, distance, first_body, second_body, triangles,
                        count, places, bodies, vertices, weights, points, normals, distances,
                    )  # fmt: skip


@ti.func
def on_triangle(t: ti.i32, weights: vec3, triangles: IntegerTable, position: Vectors) -> vec3:
    """The point of triangle t with these barycentric weights."""
    return (
        weights[0] * position[triangles[t, 0]]
        + weights[1] * position[triangles[t, 1]]
        + weights[2] * position[triangles[t, 2]]
    )


@ti.func
def store_vertex_contact(
    pair: ti.i32,
    flipped: ti.i32,
    v: ti.i32,
    t: ti.i32,
    triangle_weights: vec3,
    p: vec3,
    foot: vec3,
    out: vec3,
    distance: ti.f64,
    first_body: ti.i32,
    second_body: ti.i32,
    triangles: IntegerTable,
    count: Integers,
    places: IntegerTable,
    bodies: IntegerTable,
    vertices: IntegerBlocks,
    weights: VectorTable,
    points: VectorTable,
    normals: Vectors,
    distances: Scalars,
):
    """Append a contact of vertex v at p with triangle t at `foot`, whose surface's outward direction is `out`."""
    corner = ti.Vector([v, v, v])
    corner_weights = vec3(1.0, 0.0, 0.0)
    face = ti.Vector([triangles[t, 0], triangles[t, 1], triangles[t, 2]])
    if flipped == 0:
        store(
            2 * pair + flipped, v, t,
            first_body, second_body, corner, face, corner_weights, triangle_weights, p, foot, -out, distance,
            count, places, bodies, vertices, weights, points, normals, distances,
        )  # fmt: skip
    else:
        store(
            2 * pair + flipped, v, t,
            first_body, second_body, face, corner, triangle_weights, corner_weights, foot, p, out, distance,
            count, places, bodies, vertices, weights, points, normals, distances,
        )  # fmt: skip
