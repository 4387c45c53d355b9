"""Narrow phase: vertices of one surface against the triangles of another, and against planes.

A contact is a local minimum of the distance; one that has slipped through has a negative distance and keeps its
normal. Contact normals point from the first surface of the pair to the second.
"""

from typing import NamedTuple

from taichisoft.kernels.bounding_volumes import Trees, find_leaves, meets, squared_distance
from taichisoft.kernels.contacts import Contacts, append, ivec3, set_side
from taichisoft.kernels.launch import func, kernel
from taichisoft.kernels.local_distance import closest_on_triangle, is_local_minimum, outward_normal
from taichisoft.kernels.runtime import Integers, IntegerTable, Scalars, ScalarTable, Vectors, ti, vec3
from taichisoft.kernels.surfaces import MovedSurfaces, Planes, Surfaces

COINCIDENT = 1e-9  # [mm]


class Nearby(NamedTuple):
    """Work space of the search: what is near a feature or a pair of surfaces.

    Attributes:
        leaf: leaves of the other surface, shape (most_leaves,).
        triangle, weights: its triangles within reach of a vertex, and the barycentric weights of the points closest to
            the vertex, shapes (most_triangles,) and (most_triangles, 3).
        deepest: least distance of a vertex of each pair of surfaces below 0, 0 for none [mm], shape (pair_count,).
    """

    leaf: Integers
    triangle: Integers
    weights: Vectors
    deepest: Scalars


@kernel
def vertices_against_triangles(
    pairs: IntegerTable,
    reach: ti.f64,
    depth: ti.f64,
    surfaces: Surfaces,
    trees: Trees,
    moved: MovedSurfaces,
    near: Nearby,
    found: Contacts,
    places: ScalarTable,
):
    """Vertices of each surface of a pair against the other's triangles.

    A vertex outside touches at every local minimum closer than `reach`; one inside only at the closest point of
    all, if it is not deeper than `depth`.
    """
    ti.loop_config(serialize=True)
    for task in range(2 * pairs.shape[0]):
        pair, flipped = task // 2, task % 2
        mine, theirs = pairs[pair, flipped], pairs[pair, 1 - flipped]
        far = ti.max(reach, depth)
        if flipped == 0:
            near.deepest[pair] = 0.0
        their_low, their_high = moved.lower[trees.root[theirs]] - far, moved.upper[trees.root[theirs]] + far
        node = trees.root[mine]
        while node < trees.root[mine + 1]:
            if meets(node, their_low, their_high, moved):
                start, end = trees.vertex_start[node], trees.vertex_start[node + 1]
                if start < end:
                    near_count = find_leaves(
                        theirs, moved.lower[node] - far, moved.upper[node] + far, trees, moved, near.leaf
                    )
                    for i in range(start, ti.select(near_count > 0, end, 0)):
                        v = trees.vertex[i]
                        p = moved.position[v]
                        # The closest triangle, and all those within reach.
                        best = far * far
                        best_triangle = -1
                        best_weights = vec3(0.0)
                        within_reach = 0
                        for k in range(near_count):
                            leaf = near.leaf[k]
                            if squared_distance(leaf, p, moved) <= ti.max(reach * reach, best):
                                for j in range(trees.triangle_start[leaf], trees.triangle_start[leaf + 1]):
                                    t = trees.triangle[j]
                                    a, b, c = (
                                        moved.position[surfaces.triangles[t, 0]],
                                        moved.position[surfaces.triangles[t, 1]],
                                        moved.position[surfaces.triangles[t, 2]],
                                    )
                                    w = closest_on_triangle(p, a, b, c)
                                    d = (p - w[0] * a - w[1] * b - w[2] * c).norm_sqr()
                                    if d < best or (d == best and t < best_triangle):
                                        best, best_triangle, best_weights = d, t, w
                                    if d < reach * reach:
                                        near.triangle[within_reach] = t
                                        near.weights[within_reach] = w
                                        within_reach += 1
                        if best_triangle >= 0:
                            touch(
                                task, v, best_triangle, best_weights, within_reach, depth,
                                pairs, surfaces, moved, near, found, places,
                            )  # fmt: skip
                node += 1
            else:
                node = trees.escape[node]


@func
def touch(
    task: ti.i32,
    v: ti.i32,
    closest: ti.i32,
    closest_weights: vec3,
    within_reach: ti.i32,
    depth: ti.f64,
    pairs: IntegerTable,
    surfaces: Surfaces,
    moved: MovedSurfaces,
    near: Nearby,
    found: Contacts,
    places: ScalarTable,
):
    """Store the contacts of vertex v, given its closest triangle and all those within reach."""
    p = moved.position[v]
    out = outward_normal(closest, closest_weights, surfaces, moved.position)
    foot = on_triangle(closest, closest_weights, surfaces, moved.position)
    if (p - foot).dot(out) < 0.0:
        beyond_rim = 0
        for k in ti.static(range(3)):
            if closest_weights[k] == 0.0 and surfaces.edge_triangles[surfaces.triangle_edges[closest, k], 1] < 0:
                beyond_rim = 1
        depth_here = (foot - p).norm()
        if depth_here > COINCIDENT:
            out = (foot - p) / depth_here
        if depth_here <= depth and beyond_rim == 0:
            near.deepest[task // 2] = ti.min(near.deepest[task // 2], -depth_here)
            store(task, v, closest, closest_weights, p, foot, out, -depth_here, pairs, surfaces, found, places)
    else:
        for k in range(within_reach):
            t, w = near.triangle[k], near.weights[k]
            there = on_triangle(t, w, surfaces, moved.position)
            away = p - there
            if is_local_minimum(t, w, away, surfaces, moved.position):
                facing = outward_normal(t, w, surfaces, moved.position)
                if away.dot(facing) >= 0.0:
                    distance = away.norm()
                    if distance > COINCIDENT:
                        facing = away / distance
                    store(task, v, t, w, p, there, facing, distance, pairs, surfaces, found, places)


@func
def on_triangle(t: ti.i32, weights: vec3, surfaces: Surfaces, position: Vectors) -> vec3:
    """The point of triangle t with these barycentric weights."""
    return (
        weights[0] * position[surfaces.triangles[t, 0]]
        + weights[1] * position[surfaces.triangles[t, 1]]
        + weights[2] * position[surfaces.triangles[t, 2]]
    )


@func
def store(
    task: ti.i32,
    v: ti.i32,
    t: ti.i32,
    weights: vec3,
    p: vec3,
    foot: vec3,
    out: vec3,
    distance: ti.f64,
    pairs: IntegerTable,
    surfaces: Surfaces,
    found: Contacts,
    places: ScalarTable,
):
    """Add a contact of vertex v at p with triangle t at `foot`, whose surface's outward direction is `out`."""
    pair, flipped = task // 2, task % 2
    first_body, second_body = surfaces.body[pairs[pair, 0]], surfaces.body[pairs[pair, 1]]
    normal = out
    if flipped == 0:
        normal = -out
    c = append(task, v, t, first_body, second_body, normal, distance, found, places)
    set_side(c, flipped, ivec3(v), vec3(1.0, 0.0, 0.0), p, found)
    corners = ivec3(surfaces.triangles[t, 0], surfaces.triangles[t, 1], surfaces.triangles[t, 2])
    set_side(c, 1 - flipped, corners, weights, foot, found)


@kernel
def vertices_against_planes(
    moving: Integers,
    reach: ti.f64,
    first_group: ti.i32,
    surfaces: Surfaces,
    planes: Planes,
    trees: Trees,
    moved: MovedSurfaces,
    found: Contacts,
    places: ScalarTable,
):
    """Vertices of the moving surfaces closer than `reach` to a plane; below it is inside, however deep."""
    ti.loop_config(serialize=True)
    for plane in range(planes.point.shape[0]):
        up = planes.normal[plane]
        for k in range(moving.shape[0]):
            s = moving[k]
            node = trees.root[s]
            while node < trees.root[s + 1]:
                lowest = 0.0  # of the box above the plane
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
                                first_group + plane, v, plane, surfaces.body[s], planes.body[plane],
                                -up, distance, found, places,
                            )  # fmt: skip
                            set_side(c, 0, ivec3(v), vec3(1.0, 0.0, 0.0), p, found)
                            set_side(c, 1, ivec3(-1), vec3(0.0), p - distance * up, found)
                    node += 1
                else:
                    node = trees.escape[node]
