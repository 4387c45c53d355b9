"""Where the distance from a point or edge to a triangulated surface is a local minimum, and on which side.

The side follows from pseudo-normals (Baerentzen and Aanaes 2005, Signed Distance Computation Using the Angle Weighted
Pseudonormal), which separate inside from outside at edges and corners too.
"""

import math

from taichisoft.contact.kernels.surface_vertices import Surfaces
from taichisoft.runtime.language import Vectors, func, ti, vec3

# Edges of a deformed flat patch are slightly convex or concave at random: normals may leave an edge's normal cone
# by this much (sine of the angle).
CONE_TOLERANCE = 0.1
CONE_CHORD = 2.0 * math.sin(0.5 * math.asin(CONE_TOLERANCE))  # distance of unit vectors at this angle


@func
def closest_on_triangle(p: vec3, a: vec3, b: vec3, c: vec3) -> vec3:
    """Barycentric weights of the point closest to p; exactly 0 for other corners (Ericson 2005, section 5.1.5)."""
    ab, ac = b - a, c - a
    d1, d2 = ab.dot(p - a), ac.dot(p - a)
    d3, d4 = ab.dot(p - b), ac.dot(p - b)
    d5, d6 = ab.dot(p - c), ac.dot(p - c)
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    weights = vec3(0.0)
    if d1 <= 0.0 and d2 <= 0.0:
        weights[0] = 1.0
    elif d3 >= 0.0 and d4 <= d3:
        weights[1] = 1.0
    elif d6 >= 0.0 and d5 <= d6:
        weights[2] = 1.0
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        weights[1] = d1 / (d1 - d3)
        weights[0] = 1.0 - weights[1]
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        weights[2] = d2 / (d2 - d6)
        weights[0] = 1.0 - weights[2]
    elif va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        weights[2] = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        weights[1] = 1.0 - weights[2]
    else:
        weights[1] = vb / (va + vb + vc)
        weights[2] = vc / (va + vb + vc)
        weights[0] = 1.0 - weights[1] - weights[2]
    return weights


@func
def face_normal(t: ti.i32, surfaces: Surfaces, position: Vectors) -> vec3:
    """Unit normal of triangle t."""
    a = position[surfaces.triangles[t, 0]]
    normal = (position[surfaces.triangles[t, 1]] - a).cross(position[surfaces.triangles[t, 2]] - a)
    return normal / ti.max(normal.norm(), 1e-300)


@func
def edge_pseudonormal(e: ti.i32, surfaces: Surfaces, position: Vectors) -> vec3:
    """Sum of the normals of the triangles at an edge."""
    normal = face_normal(surfaces.edge_triangles[e, 0], surfaces, position)
    if surfaces.edge_triangles[e, 1] >= 0:
        normal += face_normal(surfaces.edge_triangles[e, 1], surfaces, position)
    return normal


@func
def vertex_pseudonormal(v: ti.i32, surfaces: Surfaces, position: Vectors) -> vec3:
    """Sum of the normals of the triangles around a vertex, weighted by their angles at the vertex."""
    normal = vec3(0.0)
    for k in range(surfaces.fan_start[v], surfaces.fan_start[v + 1]):
        t = surfaces.fan[k] // 3
        corner = surfaces.fan[k] % 3
        first = position[surfaces.triangles[t, (corner + 1) % 3]] - position[v]
        second = position[surfaces.triangles[t, (corner + 2) % 3]] - position[v]
        normal += ti.atan2(first.cross(second).norm(), first.dot(second)) * face_normal(t, surfaces, position)
    return normal


@func
def outward_normal(t: ti.i32, weights: vec3, surfaces: Surfaces, position: Vectors) -> vec3:
    """Unit pseudo-normal of the corner, edge or face of triangle t on which a point with these weights lies."""
    normal = vec3(0.0)
    zeros = 0
    corner = 0
    opposite = 0
    for k in ti.static(range(3)):
        if weights[k] == 0.0:
            zeros += 1
            opposite = k
        else:
            corner = k
    if zeros == 0:
        normal = face_normal(t, surfaces, position)
    elif zeros == 1:
        normal = edge_pseudonormal(surfaces.triangle_edges[t, opposite], surfaces, position)
    else:
        normal = vertex_pseudonormal(surfaces.triangles[t, corner], surfaces, position)
    return normal / ti.max(normal.norm(), 1e-300)


@func
def inward(t: ti.i32, start: ti.i32, end: ti.i32, surfaces: Surfaces, position: Vectors) -> vec3:
    """Unit direction in the plane of triangle t, across its edge (start, end), into the triangle."""
    third = surfaces.triangles[t, 0] + surfaces.triangles[t, 1] + surfaces.triangles[t, 2] - start - end
    along = (position[end] - position[start]).normalized()
    across = position[third] - position[start]
    across -= across.dot(along) * along
    return across.normalized()


@func
def is_local_minimum(t: ti.i32, weights: vec3, away: vec3, surfaces: Surfaces, position: Vectors) -> ti.i32:
    """Whether the distance grows in every direction from the closest point on triangle t.

    `away` is the vector from the closest point. At a shared corner or edge, one triangle only has the minimum.
    """
    zeros = 0
    corner = 0
    opposite = 0
    for k in ti.static(range(3)):
        if weights[k] == 0.0:
            zeros += 1
            opposite = k
        else:
            corner = surfaces.triangles[t, k]
    minimum = 1
    if zeros == 1:
        e = surfaces.triangle_edges[t, opposite]
        other = surfaces.edge_triangles[e, 1]
        if surfaces.edge_triangles[e, 0] != t:
            minimum = 0
        if other >= 0:
            across = inward(other, surfaces.edges[e, 0], surfaces.edges[e, 1], surfaces, position)
            if away.dot(across) > 0.0:
                minimum = 0
    elif zeros == 2:
        if surfaces.first_triangle[corner] != t:
            minimum = 0
        for k in range(surfaces.star_start[corner], surfaces.star_start[corner + 1]):
            if away.dot(position[surfaces.star[k]] - position[corner]) > 0.0:
                minimum = 0
    return minimum


@func
def in_normal_cone(e: ti.i32, normal: vec3, surfaces: Surfaces, position: Vectors) -> ti.i32:
    """Whether an outward direction at edge e lies between the normals of its triangles."""
    inside = 1
    for k in ti.static(range(2)):
        t = surfaces.edge_triangles[e, k]
        if t >= 0:  # nested: after `and` Taichi would always call the function
            across = inward(t, surfaces.edges[e, 0], surfaces.edges[e, 1], surfaces, position)
            if normal.dot(across) > CONE_TOLERANCE:
                inside = 0
    return inside


@func
def normal_cone(e: ti.i32, surfaces: Surfaces, position: Vectors):
    """Axis of the normal cone of edge e, and the largest distance of an outward unit vector in it from the axis."""
    first = face_normal(surfaces.edge_triangles[e, 0], surfaces, position)
    axis = first
    spread = 2.0
    if surfaces.edge_triangles[e, 1] >= 0:
        total = first + face_normal(surfaces.edge_triangles[e, 1], surfaces, position)
        length = total.norm()
        if length > 1e-6:
            axis = total / length
            spread = (first - axis).norm() + CONE_CHORD
    return axis, spread
