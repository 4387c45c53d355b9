"""Narrow phase: edges of one surface against the edges of another.

Where two edges cross over each other, and the direction between them leaves both surfaces, the distance has a local
minimum. A penetrating contact has a negative distance and keeps its normal. Contact normals point from the first
surface of the pair to the second.
"""

from taichisoft.contact.kernels.box_trees import Trees, find_leaves, meets, meets_beam
from taichisoft.contact.kernels.contacts import Contacts, SearchSpace, append, ivec3, set_side
from taichisoft.contact.kernels.local_distance import edge_pseudonormal, in_normal_cone, normal_cone
from taichisoft.contact.kernels.surface_vertices import MovedSurfaces, Surfaces
from taichisoft.contact.kernels.vertex_contacts import COINCIDENT
from taichisoft.runtime.language import Scalars, ScalarTable, Vectors, func, ti, vec3


@func
def edges_against_edges(
    reaches: ScalarTable,
    depth: ti.f64,
    extent: Scalars,
    surfaces: Surfaces,
    trees: Trees,
    moved: MovedSurfaces,
    space: SearchSpace,
    found: Contacts,
):
    """Find crossing edges of two surfaces within their bodies' reach, or penetrating by up to the reach and `depth`.

    They are no deeper than the thinner body: beyond it, edges only look as if they penetrated each other.

    Crossed edges deeper than the deepest vertex inside are excluded. Where a block has sunk a little into the rim of a
    table, its vertical edge and the table's edge also appear to penetrate each other, but sideways and by far more:
    pushing them apart would be wrong.
    """
    for pair in range(surfaces.pairs.shape[0]):
        mine, theirs = surfaces.pairs[pair, 0], surfaces.pairs[pair, 1]
        reach = reaches[surfaces.body[mine], surfaces.body[theirs]]
        their_low, their_high = moved.lower[trees.root[theirs]] - reach, moved.upper[trees.root[theirs]] + reach
        thinnest = ti.min(extent[surfaces.body[mine]], extent[surfaces.body[theirs]])
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
                        find_crossings(pair, e, near_count, reach, least, surfaces, trees, moved, space, found)
                node += 1
            else:
                node = trees.escape[node]


@func
def find_crossings(
    pair: ti.i32,
    e: ti.i32,
    near_count: ti.i32,
    reach: ti.f64,
    least: ti.f64,
    surfaces: Surfaces,
    trees: Trees,
    moved: MovedSurfaces,
    space: SearchSpace,
    found: Contacts,
):
    """Store the contacts of edge e with the edges of the leaves nearby, at distances from `least` to `reach`."""
    a, b = moved.position[surfaces.edges[e, 0]], moved.position[surfaces.edges[e, 1]]
    low, high = ti.min(a, b) - reach, ti.max(a, b) + reach
    axis, spread = normal_cone(e, surfaces, moved.position)
    middle = 0.5 * (a + b)
    slack = 0.5 * (b - a).norm() + reach * spread
    for k in range(near_count):
        leaf = space.leaf[k]
        if meets(leaf, low, high, moved) and meets_beam(leaf, middle, axis, slack, moved):
            for i in range(trees.edge_start[leaf], trees.edge_start[leaf + 1]):
                f = trees.edge[i]
                c, d = moved.position[surfaces.edges[f, 0]], moved.position[surfaces.edges[f, 1]]
                if (ti.min(c, d) <= high).all() and (ti.max(c, d) >= low).all():
                    cross_over(pair, e, f, reach, least, surfaces, moved.position, space, found)


@func
def cross_over(
    pair: ti.i32,
    e: ti.i32,
    f: ti.i32,
    reach: ti.f64,
    least: ti.f64,
    surfaces: Surfaces,
    position: Vectors,
    space: SearchSpace,
    found: Contacts,
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
                group = 2 * surfaces.pairs.shape[0] + pair
                first_body, second_body = surfaces.body[surfaces.pairs[pair, 0]], surfaces.body[surfaces.pairs[pair, 1]]
                k = append(group, e, f, first_body, second_body, normal, distance, space, found)
                ends = ivec3(surfaces.edges[e, 0], surfaces.edges[e, 1], surfaces.edges[e, 1])
                set_side(k, 0, ends, vec3(1.0 - s, s, 0.0), a + s * along, found)
                ends = ivec3(surfaces.edges[f, 0], surfaces.edges[f, 1], surfaces.edges[f, 1])
                set_side(k, 1, ends, vec3(1.0 - q, q, 0.0), c + q * other, found)
