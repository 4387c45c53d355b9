"""Narrow phase: pairs of points on two surfaces whose distance is a local minimum.

A vertex touches a triangle, edge or vertex of the other surface, an edge touches an edge. A pair that has slipped
through has a negative distance and keeps its normal. Contact normals point from the first surface of the pair to the
second.
"""

from taichisoft.kernels.launch import kernel
from taichisoft.kernels.local_distance import (
    closest_on_triangle,
    edge_pseudonormal,
    in_normal_cone,
    is_local_minimum,
    outward_normal,
)
from taichisoft.kernels.runtime import (
    STATIC,
    IntegerBlocks,
    Integers,
    IntegerTable,
    Scalars,
    Vectors,
    VectorTable,
    ti,
    vec3,
)

COINCIDENT = 1e-9  # [mm]


@ti.func
def store(
    pair: ti.i32,
    first: ti.types.vector(3, ti.i32),
    first_weights: vec3,
    second: ti.types.vector(3, ti.i32),
    second_weights: vec3,
    normal: vec3,
    distance: ti.f64,
    count: Integers,
    pairs: Integers,
    vertices: IntegerBlocks,
    weights: VectorTable,
    normals: Vectors,
    distances: Scalars,
):
    """Append a contact; one that finds no room is only counted, and the caller makes room and starts again."""
    c = count[0]
    if c < pairs.shape[0]:
        pairs[c] = pair
        for k in ti.static(range(3)):
            vertices[c, 0, k] = first[k]
            vertices[c, 1, k] = second[k]
        weights[c, 0] = first_weights
        weights[c, 1] = second_weights
        normals[c] = normal
        distances[c] = distance
    count[0] = c + 1


@kernel
def vertices_against_triangles(
    pair_surfaces: IntegerTable,
    lower: Vectors,
    upper: Vectors,
    reach: ti.f64,
    depth: ti.f64,
    vertex_range: IntegerTable,
    triangle_range: IntegerTable,
    is_feature: Integers,
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
    triangle_normal: Vectors,
    near: Integers,
    count: Integers,
    pairs: Integers,
    vertices: IntegerBlocks,
    weights: VectorTable,
    normals: Vectors,
    distances: Scalars,
):
    """Vertices of each surface of a pair against the other's triangles.

    A vertex outside touches at every local minimum closer than `reach`; one inside only at the closest point of
    all, if it is not deeper than `depth`.
    """
    ti.loop_config(serialize=True)
    for task in range(2 * pair_surfaces.shape[0]):
        pair, flipped = task // 2, task % 2
        mine, theirs = pair_surfaces[pair, flipped], pair_surfaces[pair, 1 - flipped]
        far = ti.max(reach, depth)
        near_count = 0
        for t in range(triangle_range[theirs, 0], triangle_range[theirs, 1]):
            a, b, c = position[triangles[t, 0]], position[triangles[t, 1]], position[triangles[t, 2]]
            low, high = ti.min(a, b, c) - far, ti.max(a, b, c) + far
            if (low <= upper[mine]).all() and (high >= lower[mine]).all():
                near[near_count] = t
                near_count += 1
        for v in range(vertex_range[mine, 0], vertex_range[mine, 1]):
            p = position[v]
            inside_box = (p >= lower[theirs] - far).all() and (p <= upper[theirs] + far).all()
            if near_count > 0 and is_feature[v] != 0 and inside_box:
                best = far * far
                best_triangle = -1
                best_weights = vec3(0.0)
                for k in range(near_count):
                    t = near[k]
                    a = position[triangles[t, 0]]
                    if ti.abs(triangle_normal[t].dot(p - a)) <= far:
                        b, c = position[triangles[t, 1]], position[triangles[t, 2]]
                        w = closest_on_triangle(p, a, b, c)
                        d = (p - w[0] * a - w[1] * b - w[2] * c).norm_sqr()
                        if d < best:
                            best, best_triangle, best_weights = d, t, w
                if best_triangle >= 0:
                    t = best_triangle
                    w = best_weights
                    out = outward_normal(
                        t, w, triangles, triangle_edges, edge_triangles, fan_start, fan, position, triangle_normal
                    )
                    foot = vec3(0.0)
                    for k in ti.static(range(3)):
                        foot += w[k] * position[triangles[t, k]]
                    if (p - foot).dot(out) < 0.0:
                        beyond_rim = 0
                        for k in ti.static(range(3)):
                            if w[k] == 0.0 and edge_triangles[triangle_edges[t, k], 1] < 0:
                                beyond_rim = 1
                        away = foot - p
                        distance = away.norm()
                        if distance > COINCIDENT:
                            out = away / distance
                        if distance <= depth and beyond_rim == 0:
                            store_vertex_contact(
                                pair, flipped, v, t, w, out, -distance, triangles,
                                count, pairs, vertices, weights, normals, distances,
                            )  # fmt: skip
                    else:
                        # Names of their own: where an outer `w` was assigned again here, Taichi 1.7.4 went on
                        # using its old value.
                        for k in range(near_count):
                            s = near[k]
                            a = position[triangles[s, 0]]
                            if ti.abs(triangle_normal[s].dot(p - a)) <= reach:
                                b, c = position[triangles[s, 1]], position[triangles[s, 2]]
                                there = closest_on_triangle(p, a, b, c)
                                away = p - there[0] * a - there[1] * b - there[2] * c
                                distance = away.norm()
                                facing = outward_normal(
                                    s,
                                    there,
                                    triangles,
                                    triangle_edges,
                                    edge_triangles,
                                    fan_start,
                                    fan,
                                    position,
                                    triangle_normal,
                                )
                                if (
                                    distance < reach
                                    and away.dot(facing) >= 0.0
                                    and is_local_minimum(
                                        s, there, away, triangles, triangle_edges, edges, edge_triangles,
                                        star_start, star, first_triangle, position,
                                    )
                                ):  # fmt: skip
                                    if distance > COINCIDENT:
                                        facing = away / distance
                                    store_vertex_contact(
                                        pair, flipped, v, s, there, facing, distance, triangles,
                                        count, pairs, vertices, weights, normals, distances,
                                    )  # fmt: skip


@ti.func
def store_vertex_contact(
    pair: ti.i32,
    flipped: ti.i32,
    v: ti.i32,
    t: ti.i32,
    triangle_weights: vec3,
    out: vec3,
    distance: ti.f64,
    triangles: IntegerTable,
    count: Integers,
    pairs: Integers,
    vertices: IntegerBlocks,
    weights: VectorTable,
    normals: Vectors,
    distances: Scalars,
):
    """Append a contact of vertex v with triangle t, whose surface's outward direction is `out`."""
    corner = ti.Vector([v, v, v])
    corner_weights = vec3(1.0, 0.0, 0.0)
    face = ti.Vector([triangles[t, 0], triangles[t, 1], triangles[t, 2]])
    if flipped == 0:
        store(
            pair, corner, corner_weights, face, triangle_weights, -out, distance,
            count, pairs, vertices, weights, normals, distances,
        )  # fmt: skip
    else:
        store(
            pair, face, triangle_weights, corner, corner_weights, out, distance,
            count, pairs, vertices, weights, normals, distances,
        )  # fmt: skip


@kernel
def edges_against_edges(
    pair_surfaces: IntegerTable,
    lower: Vectors,
    upper: Vectors,
    reach: ti.f64,
    depth: ti.f64,
    edge_range: IntegerTable,
    is_feature: Integers,
    edges: IntegerTable,
    edge_triangles: IntegerTable,
    triangles: IntegerTable,
    position: Vectors,
    triangle_normal: Vectors,
    near: Integers,
    count: Integers,
    pairs: Integers,
    vertices: IntegerBlocks,
    weights: VectorTable,
    normals: Vectors,
    distances: Scalars,
):
    """Crossing edges of two surfaces closer than `reach`, or not deeper than `depth` when they have slipped through."""
    ti.loop_config(serialize=True)
    for pair in range(pair_surfaces.shape[0]):
        mine, theirs = pair_surfaces[pair, 0], pair_surfaces[pair, 1]
        near_count = 0
        for e in range(edge_range[theirs, 0], edge_range[theirs, 1]):
            a, b = position[edges[e, 0]], position[edges[e, 1]]
            low, high = ti.min(a, b) - reach, ti.max(a, b) + reach
            if is_feature[e] != 0 and (low <= upper[mine]).all() and (high >= lower[mine]).all():
                near[near_count] = e
                near_count += 1
        for e in range(edge_range[mine, 0], edge_range[mine, 1]):
            a = position[edges[e, 0]]
            along = position[edges[e, 1]] - a
            low, high = ti.min(a, a + along) - reach, ti.max(a, a + along) + reach
            if is_feature[e] != 0 and (low <= upper[theirs]).all() and (high >= lower[theirs]).all():
                for k in range(near_count):
                    f = near[k]
                    c = position[edges[f, 0]]
                    other = position[edges[f, 1]] - c
                    if (ti.min(c, c + other) <= high).all() and (ti.max(c, c + other) >= low).all():
                        lengths = along.norm_sqr() * other.norm_sqr()
                        cosine = along.dot(other)
                        crossing = lengths - cosine * cosine
                        r = a - c
                        s = (cosine * other.dot(r) - along.dot(r) * other.norm_sqr()) / crossing
                        q = (along.norm_sqr() * other.dot(r) - cosine * along.dot(r)) / crossing
                        if crossing > 1e-8 * lengths and s > 0.0 and s < 1.0 and q > 0.0 and q < 1.0:
                            gap = c + q * other - a - s * along
                            distance = gap.norm()
                            normal = along.cross(other).normalized()
                            if distance > COINCIDENT:
                                normal = gap / distance
                            leaving = normal.dot(edge_pseudonormal(e, edge_triangles, triangle_normal))
                            meeting = -normal.dot(edge_pseudonormal(f, edge_triangles, triangle_normal))
                            if leaving < 0.0 and meeting < 0.0:
                                normal, distance = -normal, -distance
                                leaving, meeting = -leaving, -meeting
                            if (
                                leaving > 0.0
                                and meeting > 0.0
                                and distance < reach
                                and distance >= -depth
                                and in_normal_cone(e, normal, edges, edge_triangles, triangles, position)
                                and in_normal_cone(f, -normal, edges, edge_triangles, triangles, position)
                            ):
                                store(
                                    pair,
                                    ti.Vector([edges[e, 0], edges[e, 1], edges[e, 1]]),
                                    vec3(1.0 - s, s, 0.0),
                                    ti.Vector([edges[f, 0], edges[f, 1], edges[f, 1]]),
                                    vec3(1.0 - q, q, 0.0),
                                    normal, distance,
                                    count, pairs, vertices, weights, normals, distances,
                                )  # fmt: skip


@kernel
def vertices_against_planes(
    plane_point: Vectors,
    plane_normal: Vectors,
    reach: ti.f64,
    first_pair: ti.i32,
    surface_count: ti.i32,
    vertex_range: IntegerTable,
    is_feature: Integers,
    owner: Integers,
    position: Vectors,
    count: Integers,
    pairs: Integers,
    vertices: IntegerBlocks,
    weights: VectorTable,
    normals: Vectors,
    distances: Scalars,
):
    """Vertices of moving surfaces against infinite planes; below a plane is inside, however deep."""
    ti.loop_config(serialize=True)
    for plane in range(plane_point.shape[0]):
        for s in range(surface_count):
            for v in range(vertex_range[s, 0], vertex_range[s, 1]):
                distance = (position[v] - plane_point[plane]).dot(plane_normal[plane])
                if distance < reach and is_feature[v] != 0 and owner[v] != STATIC:
                    store(
                        first_pair + plane * surface_count + s,
                        ti.Vector([v, v, v]), vec3(1.0, 0.0, 0.0), ti.Vector([-1, -1, -1]), vec3(0.0),
                        -plane_normal[plane], distance,
                        count, pairs, vertices, weights, normals, distances,
                    )  # fmt: skip
