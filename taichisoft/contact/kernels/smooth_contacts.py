"""Narrow phase: triangulated surfaces treated as curved, against planes and other surfaces.

A curved surface touches a plane where the normals are opposite, and the edge of another surface at the nearest point;
vertices of the other surface touch along the curved normal.
"""

from taichisoft.contact.kernels.box_trees import find_leaves, meets
from taichisoft.contact.kernels.contacts import (
    CURVED_ON_EDGES,
    CURVED_ON_FACES,
    CURVED_ON_PLANES,
    Carriers,
    PoseArrays,
    Search,
    SmoothSurfaces,
    append,
    corners,
    ends,
    ivec2,
    ivec3,
    set_side,
)
from taichisoft.contact.kernels.vertex_contacts import (
    closest_point,
    face_normal,
    find_triangles,
    in_normal_cone,
    is_local_minimum,
)
from taichisoft.runtime.language import func, ti, vec3
from taichisoft.runtime.launch import kernel

# Triangulated surfaces treated as the curved surfaces spanned by their vertices and vertex normals.
#
# The flat point p(b) of a triangle with weights b is moved towards the tangent planes at the corners (Boubekeur and
# Alexa 2008, Phong Tessellation): x(b) = p + 1/2 sum of b_i ((x_i - p) . n_i) n_i. The factor 1/2, instead of their
# 3/4, reproduces a sphere to the fourth order of the triangle's size. The normal is the sum of b_i n_i.

ON_EDGE = 1e-12  # tolerance of negative weights: at least one of two triangles has the points on their edge


@kernel
def turn_normals(smooth: SmoothSurfaces, carriers: Carriers, poses: PoseArrays):
    """Rotate the normals with their rigid bodies."""
    ti.loop_config(serialize=True)
    for i in range(smooth.vertices.shape[0]):
        v = smooth.vertices[i]
        if carriers.owner[v] >= 0:
            smooth.normal[v] = poses.rigid_rotation[carriers.owner[v]] @ smooth.local_normal[v]


@func
def curved_point(t: ti.i32, weights: vec3, search: Search) -> vec3:
    """Point of the curved surface with barycentric `weights` in triangle t [mm]."""
    surfaces, moved, smooth = ti.static(search.surfaces, search.moved, search.smooth)
    p = vec3(0.0)
    for k in ti.static(range(3)):
        p += weights[k] * moved.position[surfaces.triangles[t, k]]
    bulge = vec3(0.0)
    for k in ti.static(range(3)):
        v = surfaces.triangles[t, k]
        bulge += weights[k] * (moved.position[v] - p).dot(smooth.normal[v]) * smooth.normal[v]
    return p + 0.5 * bulge


@func
def curved_normal(t: ti.i32, weights: vec3, search: Search) -> vec3:
    """Unit normal of the curved surface with barycentric `weights` in triangle t."""
    surfaces, smooth = ti.static(search.surfaces, search.smooth)
    normal = vec3(0.0)
    for k in ti.static(range(3)):
        normal += weights[k] * smooth.normal[surfaces.triangles[t, k]]
    return normal.normalized()


@func
def weights_of_normal(t: ti.i32, direction: vec3, search: Search):
    """Whether curved triangle t has a point with its normal in this direction, and the weights of the point."""
    surfaces, smooth = ti.static(search.surfaces, search.smooth)
    a = smooth.normal[surfaces.triangles[t, 0]]
    b = smooth.normal[surfaces.triangles[t, 1]]
    c = smooth.normal[surfaces.triangles[t, 2]]
    span = a.dot(b.cross(c))
    weights = vec3(direction.dot(b.cross(c)), direction.dot(c.cross(a)), direction.dot(a.cross(b))) / span
    total = weights.sum()
    weights /= total
    return total > 0.0 and weights.min() >= -ON_EDGE, weights


SAME_PLACE = 1e-6  # [mm]
OPPOSITE = 0.8  # cosine of the largest angle between flat and curved normal within a triangle
HALVINGS = 40


@kernel
def smooth_against_planes(search: Search):
    """Add the contacts of moving smooth surfaces with planes within the reach of their bodies [mm]."""
    reaches, surfaces, trees, planes, moved, smooth = ti.static(
        search.reaches, search.surfaces, search.trees, search.planes, search.moved, search.smooth
    )
    ti.loop_config(serialize=True)
    for plane in range(planes.point.shape[0]):
        up = planes.normal[plane]
        for k in range(smooth.moving.shape[0]):
            s = smooth.moving[k]
            reach = reaches[surfaces.body[s], planes.body[plane]]
            for node in range(trees.root[s], ti.select(reach < 0.0, trees.root[s], trees.root[s + 1])):
                for i in range(trees.triangle_start[node], trees.triangle_start[node + 1]):
                    t = trees.triangle[i]
                    if face_normal(t, surfaces, moved.position).dot(up) < -OPPOSITE:
                        is_here, weights = weights_of_normal(t, -up, search)
                        if is_here:
                            x = curved_point(t, weights, search)
                            height = (x - planes.point[plane]).dot(up)
                            if height < reach:
                                bodies = ivec2(surfaces.body[s], planes.body[plane])
                                c = append(CURVED_ON_PLANES + plane, t, 0, bodies, -up, height, search)
                                set_side(c, 0, corners(t, surfaces), weights, x, search)
                                set_side(c, 1, ivec3(-1), vec3(0.0), x - height * up, search)


@kernel
def smooth_against_surfaces(search: Search, depth: ti.f64):
    """Add the contacts of smooth surfaces with faces and edges of other surfaces.

    They are within the reach of their bodies or penetrate by up to `depth` [mm]. The contacts of vertices of other
    surfaces, found before, get the curved normal.
    """
    reaches, surfaces, trees, moved, smooth, found = ti.static(
        search.reaches, search.surfaces, search.trees, search.moved, search.smooth, search.found
    )
    ti.loop_config(serialize=True)
    for _ in range(1):
        for c in range(ti.min(found.count[0], found.distance.shape[0])):
            for side in range(2):
                v = found.vertices[c, side, 0]
                if v >= 0 and found.vertices[c, side, 1] != v:
                    bends = ti.i32(found.vertices[c, 1 - side, 0] >= 0)  # not on a plane
                    if smooth.is_smooth[v] and bends:
                        touch_along_normal(c, side, search)
        for pair in range(smooth.pairs.shape[0]):
            mine, theirs = smooth.pairs[pair, 0], smooth.pairs[pair, 1]
            reach = reaches[surfaces.body[mine], surfaces.body[theirs]]
            low, high = moved.lower[trees.root[mine]] - reach, moved.upper[trees.root[mine]] + reach
            node = ti.select(reach < 0.0, trees.root[theirs + 1], trees.root[theirs])
            while node < trees.root[theirs + 1]:
                if meets(node, low, high, moved):
                    start, end = moved.lower[node] - reach, moved.upper[node] + reach
                    for leaf in range(
                        trees.root[mine], ti.select(trees.escape[node] == node + 1, trees.root[mine + 1], 0)
                    ):
                        if trees.triangle_start[leaf] < trees.triangle_start[leaf + 1] and meets(
                            leaf, start, end, moved
                        ):
                            leaf_against_leaf(pair, leaf, node, reach, depth, search)
                    node += 1
                else:
                    node = trees.escape[node]


@func
def leaf_against_leaf(pair: ti.i32, leaf: ti.i32, node: ti.i32, reach: ti.f64, depth: ti.f64, search: Search):
    """Find contacts of the curved triangles of a leaf with faces and edges of the other surface's leaf `node`."""
    surfaces, trees, moved = ti.static(search.surfaces, search.trees, search.moved)
    for i in range(trees.triangle_start[leaf], trees.triangle_start[leaf + 1]):
        t = trees.triangle[i]
        flat = face_normal(t, surfaces, moved.position)
        for j in range(trees.triangle_start[node], trees.triangle_start[node + 1]):
            if flat.dot(face_normal(trees.triangle[j], surfaces, moved.position)) < -OPPOSITE:
                touch_face(pair, t, trees.triangle[j], reach, depth, search)
        for j in range(trees.edge_start[node], trees.edge_start[node + 1]):
            touch_edge(pair, t, trees.edge[j], reach, search)


@func
def touch_face(pair: ti.i32, t: ti.i32, face: ti.i32, reach: ti.f64, depth: ti.f64, search: Search):
    """Store the contact of curved triangle t with the inside of a face."""
    surfaces, trees, moved, smooth, space = ti.static(
        search.surfaces, search.trees, search.moved, search.smooth, search.space
    )
    up = face_normal(face, surfaces, moved.position)
    is_here, weights = weights_of_normal(t, -up, search)
    if is_here:
        x = curved_point(t, weights, search)
        height = (x - moved.position[surfaces.triangles[face, 0]]).dot(up)
        if height < reach and height > -depth:
            w, foot = closest_point(x, face, surfaces, moved.position)
            touches = ti.i32((x - height * up - foot).norm() < SAME_PLACE)
            if touches and w.min() == 0.0:
                touches = is_local_minimum(face, w, up, surfaces, moved.position)
            if touches and height < 0.0:
                near_count = find_leaves(smooth.pairs[pair, 1], x - depth, x + depth, trees, moved, space.leaf)
                closest, _weights, _count = find_triangles(x, near_count, 0.0, depth, search)
                touches = ti.i32(closest == face)
            if touches:
                k = store(pair, CURVED_ON_FACES, t, face, weights, x, -up, height, search)
                set_side(k, other_side(pair, search), corners(face, surfaces), w, foot, search)


@func
def touch_edge(pair: ti.i32, t: ti.i32, e: ti.i32, reach: ti.f64, search: Search):
    """Store the contact of curved triangle t with the inside of an edge.

    The points with a normal across the edge lie on a line through the triangle; the contact is the point of this line
    whose normal meets the edge.
    """
    surfaces, moved, smooth = ti.static(search.surfaces, search.moved, search.smooth)
    start, end = moved.position[surfaces.edges[e, 0]], moved.position[surfaces.edges[e, 1]]
    along = (end - start).normalized()
    rise = vec3(0.0)
    for k in ti.static(range(3)):
        rise[k] = smooth.normal[surfaces.triangles[t, k]].dot(along)
    if rise.min() < 0.0 and rise.max() >= 0.0:
        entry, leave = vec3(0.0), vec3(0.0)
        for k in ti.static(range(3)):
            one, two = k, (k + 1) % 3
            if (rise[one] < 0.0) != (rise[two] < 0.0):
                share = rise[one] / (rise[one] - rise[two])
                point = vec3(0.0)
                point[one], point[two] = 1.0 - share, share
                if rise[one] < 0.0:
                    entry = point
                else:
                    leave = point
        if beside(t, entry, start, along, search) * beside(t, leave, start, along, search) <= 0.0:
            before = beside(t, entry, start, along, search) < 0.0
            for _ in range(HALVINGS):
                middle = 0.5 * (entry + leave)
                if (beside(t, middle, start, along, search) < 0.0) == before:
                    entry = middle
                else:
                    leave = middle
            weights = 0.5 * (entry + leave)
            x = curved_point(t, weights, search)
            out = curved_normal(t, weights, search)
            place = (x - start).dot(along)
            length = (end - start).norm()
            foot = start + place * along
            distance = (foot - x).dot(out)
            is_near = distance < reach and distance > -reach and place > 0.0 and place < length
            if is_near and in_normal_cone(e, -out, surfaces, moved.position):
                k = store(pair, CURVED_ON_EDGES, t, e, weights, x, out, distance, search)
                weights_there = vec3(1.0 - place / length, place / length, 0.0)
                set_side(k, other_side(pair, search), ends(e, surfaces), weights_there, foot, search)


@func
def beside(t: ti.i32, weights: vec3, start: vec3, along: vec3, search: Search) -> ti.f64:
    """Signed distance of a line from the normal through a curved point [mm]; the normal is across the line."""
    out = curved_normal(t, weights, search)
    return (start - curved_point(t, weights, search)).dot(along.cross(out))


@func
def touch_along_normal(c: ti.i32, side: ti.i32, search: Search):
    """Move contact c of a vertex with a flat triangle on `side` to the curved triangle, with the same weights."""
    moved, smooth, found = ti.static(search.moved, search.smooth, search.found)
    p, flat = found.points[c, 1 - side], vec3(0.0)
    out, weights = vec3(0.0), found.weights[c, side]
    for k in ti.static(range(3)):
        v = found.vertices[c, side, k]
        flat += weights[k] * moved.position[v]
        out += weights[k] * smooth.normal[v]
    out = out.normalized()
    bulge = vec3(0.0)
    for k in ti.static(range(3)):
        v = found.vertices[c, side, k]
        bulge += 0.5 * weights[k] * (moved.position[v] - flat).dot(smooth.normal[v]) * smooth.normal[v]
    distance = (p - flat - bulge).dot(out)
    found.distance[c] = distance
    found.normal[c] = ti.select(side == 0, out, -out)
    found.points[c, side] = p - distance * out


@func
def other_side(pair: ti.i32, search: Search) -> ti.i32:
    """Side of the other surface in a contact: the lower body number is first."""
    surfaces, smooth = ti.static(search.surfaces, search.smooth)
    return ti.i32(surfaces.body[smooth.pairs[pair, 1]] > surfaces.body[smooth.pairs[pair, 0]])


@func
def store(
    pair: ti.i32,
    group: ti.i32,
    t: ti.i32,
    feature: ti.i32,
    weights: vec3,
    x: vec3,
    out: vec3,
    distance: ti.f64,
    search: Search,
) -> ti.i32:
    """Add a contact of curved triangle t at x, `distance` along `out` from the other surface; its index."""
    surfaces, smooth = ti.static(search.surfaces, search.smooth)
    other = other_side(pair, search)
    bodies = ivec2(surfaces.body[smooth.pairs[pair, 1 - other]], surfaces.body[smooth.pairs[pair, other]])
    c = append(group + pair, t, feature, bodies, ti.select(other == 1, out, -out), distance, search)
    set_side(c, 1 - other, corners(t, surfaces), weights, x, search)
    return c
