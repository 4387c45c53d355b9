"""Narrow phase: vertices of one surface against the triangles of another, and against planes.

A contact is a local minimum of the distance. A penetrating contact has a negative distance and keeps its normal.
Contact normals point from the first surface of the pair to the second.
"""

from taichisoft.contact.kernels.box_trees import Trees, find_leaves, meets, squared_distance
from taichisoft.contact.kernels.contacts import Contacts, SearchSpace, append, ivec3, set_side
from taichisoft.contact.kernels.local_distance import closest_on_triangle, is_local_minimum, outward_normal
from taichisoft.contact.kernels.surface_vertices import MovedSurfaces, Planes, Surfaces
from taichisoft.runtime.language import ScalarTable, Vectors, func, ti, vec3

COINCIDENT = 1e-9  # [mm]


@func
def vertices_against_triangles(
    reaches: ScalarTable,
    depth: ti.f64,
    surfaces: Surfaces,
    trees: Trees,
    moved: MovedSurfaces,
    space: SearchSpace,
    found: Contacts,
):
    """Find contacts of the vertices of each surface of a pair with the triangles of the other surface.

    A vertex outside touches at every local minimum within the reach of its bodies [mm]; a vertex inside touches at the
    closest point only, and only down to `depth` [mm].
    """
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
                        touch(task, trees.vertex[i], near_count, reach, depth, surfaces, trees, moved, space, found)
                node += 1
            else:
                node = trees.escape[node]


@func
def touch(
    task: ti.i32,
    v: ti.i32,
    near_count: ti.i32,
    reach: ti.f64,
    depth: ti.f64,
    surfaces: Surfaces,
    trees: Trees,
    moved: MovedSurfaces,
    space: SearchSpace,
    found: Contacts,
):
    """Store the contacts of vertex v with the triangles of the leaves nearby."""
    p = moved.position[v]
    closest, weights, within_reach = find_triangles(p, near_count, reach, depth, surfaces, trees, moved, space)
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
                store(task, v, closest, weights, p, foot, out, -depth_here, surfaces, space, found)
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
                        store(task, v, t, w, p, there, facing, distance, surfaces, space, found)


@func
def find_triangles(
    p: vec3,
    near_count: ti.i32,
    reach: ti.f64,
    depth: ti.f64,
    surfaces: Surfaces,
    trees: Trees,
    moved: MovedSurfaces,
    space: SearchSpace,
):
    """Triangle closest to p or -1, weights of its closest point, and number of triangles in `space` within reach."""
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
def store(
    task: ti.i32,
    v: ti.i32,
    t: ti.i32,
    weights: vec3,
    p: vec3,
    foot: vec3,
    out: vec3,
    distance: ti.f64,
    surfaces: Surfaces,
    space: SearchSpace,
    found: Contacts,
):
    """Add a contact of vertex v at p with triangle t at `foot`; `out` is the outward direction of t's surface."""
    pair, flipped = task // 2, task % 2
    first_body, second_body = surfaces.body[surfaces.pairs[pair, 0]], surfaces.body[surfaces.pairs[pair, 1]]
    normal = out
    if flipped == 0:
        normal = -out
    c = append(task, v, t, first_body, second_body, normal, distance, space, found)
    set_side(c, flipped, ivec3(v), vec3(1.0, 0.0, 0.0), p, found)
    corners = ivec3(surfaces.triangles[t, 0], surfaces.triangles[t, 1], surfaces.triangles[t, 2])
    set_side(c, 1 - flipped, corners, weights, foot, found)


@func
def vertices_against_planes(
    reaches: ScalarTable,
    surfaces: Surfaces,
    trees: Trees,
    planes: Planes,
    moved: MovedSurfaces,
    space: SearchSpace,
    found: Contacts,
):
    """Find vertices of moving surfaces within their bodies' reach of a plane; everything below it is inside."""
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
                                3 * surfaces.pairs.shape[0] + plane, v, plane, surfaces.body[s], planes.body[plane],
                                -up, distance, space, found,
                            )  # fmt: skip
                            set_side(c, 0, ivec3(v), vec3(1.0, 0.0, 0.0), p, found)
                            set_side(c, 1, ivec3(-1), vec3(0.0), p - distance * up, found)
                    node += 1
                else:
                    node = trees.escape[node]
