"""Narrow phase: edges of one surface against the edges of another.

Where two edges cross over each other, and the direction between them leaves both surfaces, the distance has a local
minimum; one that has slipped through has a negative distance and keeps its normal. Contact normals point from the
first surface of the pair to the second.
"""

from taichisoft.kernels.bounding_volumes import find_leaves, meets, meets_beam
from taichisoft.kernels.contact_store import COINCIDENT, store
from taichisoft.kernels.launch import kernel
from taichisoft.kernels.local_distance import edge_pseudonormal, in_normal_cone, normal_cone
from taichisoft.kernels.runtime import IntegerBlocks, Integers, IntegerTable, Scalars, Vectors, VectorTable, ti, vec3


@kernel
def edges_against_edges(
    pair_surfaces: IntegerTable,
    body: Integers,
    reach: ti.f64,
    depth: ti.f64,
    first_group: ti.i32,
    edges: IntegerTable,
    edge_triangles: IntegerTable,
    triangles: IntegerTable,
    position: Vectors,
    root: Integers,
    escape: Integers,
    edge_start: Integers,
    edge: Integers,
    lower: Vectors,
    upper: Vectors,
    near: Integers,
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
    """Crossing edges of two surfaces closer than `reach`, or not deeper than `depth` when they have slipped through.

    Crossed edges that are deeper than the `deepest` vertex inside (0 for none) are left out. Where a block has sunk
    a little into the rim of a table, its vertical edge and the table's edge also look as if they had slipped through
    each other, sideways and by far more: that is not the way out.
    """
    ti.loop_config(serialize=True)
    for pair in range(pair_surfaces.shape[0]):
        mine, theirs = pair_surfaces[pair, 0], pair_surfaces[pair, 1]
        their_low, their_high = lower[root[theirs]] - reach, upper[root[theirs]] + reach
        deepest_crossing = -depth
        if deepest[pair] < 0.0:
            deepest_crossing = ti.max(-depth, deepest[pair])
        node = root[mine]
        while node < root[mine + 1]:
            if meets(node, their_low, their_high, lower, upper):
                if edge_start[node] < edge_start[node + 1]:
                    near_count = find_leaves(
                        theirs, lower[node] - reach, upper[node] + reach, root, escape, lower, upper, near
                    )
                    for i in range(edge_start[node], ti.select(near_count > 0, edge_start[node + 1], 0)):
                        e = edge[i]
                        a, b = position[edges[e, 0]], position[edges[e, 1]]
                        low, high = ti.min(a, b) - reach, ti.max(a, b) + reach
                        axis, spread = normal_cone(e, edge_triangles, triangles, position)
                        middle = 0.5 * (a + b)
                        slack = 0.5 * (b - a).norm() + reach * spread
                        for k in range(near_count):
                            leaf = near[k]
                            if meets(leaf, low, high, lower, upper) and meets_beam(
                                leaf, middle, axis, slack, lower, upper
                            ):
                                for j in range(edge_start[leaf], edge_start[leaf + 1]):
                                    f = edge[j]
                                    c, d = position[edges[f, 0]], position[edges[f, 1]]
                                    if (ti.min(c, d) <= high).all() and (ti.max(c, d) >= low).all():
                                        cross_over(
                                            first_group + pair, e, f, reach, deepest_crossing, body[mine], body[theirs],
                                            edges, edge_triangles, triangles, position,
                                            count, places, bodies, vertices, weights, points, normals, distances,
                                        )  # fmt: skip
                node += 1
            else:
                node = escape[node]


@ti.func
def cross_over(
    group: ti.i32,
    e: ti.i32,
    f: ti.i32,
    reach: ti.f64,
    least: ti.f64,
    first_body: ti.i32,
    second_body: ti.i32,
    edges: IntegerTable,
    edge_triangles: IntegerTable,
    triangles: IntegerTable,
    position: Vectors,
    count: Integers,
    places: IntegerTable,
    bodies: IntegerTable,
    vertices: IntegerBlocks,
    weights: VectorTable,
    points: VectorTable,
    normals: Vectors,
    distances: Scalars,
):
    """Store the contact of edges e and f, if they cross over each other at a distance from `least` to `reach`."""
    a, c = position[edges[e, 0]], position[edges[f, 0]]
    along, other = position[edges[e, 1]] - a, position[edges[f, 1]] - c
    lengths = along.norm_sqr() * other.norm_sqr()
    cosine = along.dot(other)
    crossing = lengths - cosine * cosine
    r = a - c
    s = (cosine * other.dot(r) - along.dot(r) * other.norm_sqr()) / crossing
    q = (along.norm_sqr() * other.dot(r) - cosine * along.dot(r)) / crossing
    if crossing > 1e-8 * lengths and s > 0.0 and s < 1.0 and q > 0.0 and q < 1.0:
        gap = c + q * other - a - s * along
        distance = gap.norm()
        if distance < reach:
            normal = along.cross(other).normalized()
            if distance > COINCIDENT:
                normal = gap / distance
            leaving = normal.dot(edge_pseudonormal(e, edge_triangles, triangles, position))
            meeting = -normal.dot(edge_pseudonormal(f, edge_triangles, triangles, position))
            if leaving < 0.0 and meeting < 0.0:
                normal, distance = -normal, -distance
                leaving, meeting = -leaving, -meeting
            if (
                leaving > 0.0
                and meeting > 0.0
                and distance >= least
                and in_normal_cone(e, normal, edges, edge_triangles, triangles, position)
                and in_normal_cone(f, -normal, edges, edge_triangles, triangles, position)
            ):
                store(
                    group, e, f, first_body, second_body,
                    ti.Vector([edges[e, 0], edges[e, 1], edges[e, 1]]),
                    ti.Vector([edges[f, 0], edges[f, 1], edges[f, 1]]),
                    vec3(1.0 - s, s, 0.0), vec3(1.0 - q, q, 0.0),
                    a + s * along, c + q * other, normal, distance,
                    count, places, bodies, vertices, weights, points, normals, distances,
                )  # fmt: skip
