"""Narrow phase: edges of one surface against the edges of another.

Where two edges cross over each other, and the direction between them leaves both surfaces, the distance has a local
minimum; one that has slipped through has a negative distance and keeps its normal. Contact normals point from the
first surface of the pair to the second.
"""

from taichisoft.kernels.bounding_volumes import Trees, find_leaves, meets, meets_beam
from taichisoft.kernels.contacts import Contacts, append, ivec3, set_side
from taichisoft.kernels.launch import func, kernel
from taichisoft.kernels.local_distance import edge_pseudonormal, in_normal_cone, normal_cone
from taichisoft.kernels.runtime import IntegerTable, ScalarTable, Vectors, ti, vec3
from taichisoft.kernels.surfaces import MovedSurfaces, Surfaces
from taichisoft.kernels.vertex_contacts import COINCIDENT, Nearby


@kernel
def edges_against_edges(
    pairs: IntegerTable,
    reach: ti.f64,
    depth: ti.f64,
    first_group: ti.i32,
    surfaces: Surfaces,
    trees: Trees,
    moved: MovedSurfaces,
    near: Nearby,
    found: Contacts,
    places: ScalarTable,
):
    """Crossing edges of two surfaces closer than `reach`, or not deeper than `depth` when they have slipped through.

    Crossed edges that are deeper than the deepest vertex inside are left out. Where a block has sunk a little into the
    rim of a table, its vertical edge and the table's edge also look as if they had slipped through each other, sideways
    and by far more: that is not the way out.
    """
    ti.loop_config(serialize=True)
    for pair in range(pairs.shape[0]):
        mine, theirs = pairs[pair, 0], pairs[pair, 1]
        their_low, their_high = moved.lower[trees.root[theirs]] - reach, moved.upper[trees.root[theirs]] + reach
        deepest_crossing = -depth
        if near.deepest[pair] < 0.0:
            deepest_crossing = ti.max(-depth, near.deepest[pair])
        node = trees.root[mine]
        while node < trees.root[mine + 1]:
            if meets(node, their_low, their_high, moved):
                start, end = trees.edge_start[node], trees.edge_start[node + 1]
                if start < end:
                    near_count = find_leaves(
                        theirs, moved.lower[node] - reach, moved.upper[node] + reach, trees, moved, near.leaf
                    )
                    for i in range(start, ti.select(near_count > 0, end, 0)):
                        e = trees.edge[i]
                        a, b = moved.position[surfaces.edges[e, 0]], moved.position[surfaces.edges[e, 1]]
                        low, high = ti.min(a, b) - reach, ti.max(a, b) + reach
                        axis, spread = normal_cone(e, surfaces, moved.position)
                        middle = 0.5 * (a + b)
                        slack = 0.5 * (b - a).norm() + reach * spread
                        for k in range(near_count):
                            leaf = near.leaf[k]
                            if meets(leaf, low, high, moved) and meets_beam(leaf, middle, axis, slack, moved):
                                for j in range(trees.edge_start[leaf], trees.edge_start[leaf + 1]):
                                    f = trees.edge[j]
                                    c, d = moved.position[surfaces.edges[f, 0]], moved.position[surfaces.edges[f, 1]]
                                    if (ti.min(c, d) <= high).all() and (ti.max(c, d) >= low).all():
                                        cross_over(
                                            first_group + pair, e, f, reach, deepest_crossing,
                                            surfaces.body[mine], surfaces.body[theirs],
                                            surfaces, moved.position, found, places,
                                        )  # fmt: skip
                node += 1
            else:
                node = trees.escape[node]


@func
def cross_over(
    group: ti.i32,
    e: ti.i32,
    f: ti.i32,
    reach: ti.f64,
    least: ti.f64,
    first_body: ti.i32,
    second_body: ti.i32,
    surfaces: Surfaces,
    position: Vectors,
    found: Contacts,
    places: ScalarTable,
):
    """Store the contact of edges e and f, if they cross over each other at a distance from `least` to `reach`."""
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
        if distance < reach:
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
                k = append(group, e, f, first_body, second_body, normal, distance, found, places)
                ends = ivec3(surfaces.edges[e, 0], surfaces.edges[e, 1], surfaces.edges[e, 1])
                set_side(k, 0, ends, vec3(1.0 - s, s, 0.0), a + s * along, found)
                ends = ivec3(surfaces.edges[f, 0], surfaces.edges[f, 1], surfaces.edges[f, 1])
                set_side(k, 1, ends, vec3(1.0 - q, q, 0.0), c + q * other, found)
