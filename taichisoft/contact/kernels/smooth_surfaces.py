"""Triangulated surfaces treated as the curved surfaces spanned by their vertices and vertex normals.

The flat point p(b) of a triangle with weights b is moved towards the tangent planes at the corners (Boubekeur and Alexa
2008, Phong Tessellation): x(b) = p + 1/2 sum of b_i ((x_i - p) . n_i) n_i. The factor 1/2, instead of their 3/4,
reproduces a sphere to the fourth order of the triangle's size. The normal is the sum of b_i n_i.
"""

from typing import NamedTuple

from taichisoft.contact.kernels.surface_vertices import Carriers, MovedSurfaces, PoseArrays, Surfaces
from taichisoft.runtime.language import Integers, IntegerTable, Vectors, func, ti, vec3
from taichisoft.runtime.launch import kernel

ON_EDGE = 1e-12  # tolerance of negative weights: at least one of two triangles has the points on their edge


class SmoothSurfaces(NamedTuple):
    """The surfaces treated as curved.

    Attributes:
        vertices: vertices of all smooth surfaces, shape (smooth_vertex_count,).
        is_smooth: 1 for a vertex of a smooth surface, else 0, shape (vertex_count,).
        local_normal: outward unit normals of all vertices in body axes, 0 for vertices of other surfaces, shape
            (vertex_count, 3).
        normal: the same in world axes, shape (vertex_count, 3).
        moving: numbers of smooth surfaces that can move, shape (moving_count,).
        pairs: numbers of a smooth surface and of another surface that it can touch, shape (pair_count, 2).
    """

    vertices: Integers
    is_smooth: Integers
    local_normal: Vectors
    normal: Vectors
    moving: Integers
    pairs: IntegerTable


@kernel
def turn_normals(smooth: SmoothSurfaces, carriers: Carriers, poses: PoseArrays):
    """Rotate the normals with their rigid bodies."""
    ti.loop_config(serialize=True)
    for i in range(smooth.vertices.shape[0]):
        v = smooth.vertices[i]
        if carriers.owner[v] >= 0:
            smooth.normal[v] = poses.rigid_rotation[carriers.owner[v]] @ smooth.local_normal[v]


@func
def curved_point(t: ti.i32, weights: vec3, surfaces: Surfaces, moved: MovedSurfaces, smooth: SmoothSurfaces) -> vec3:
    """Point of the curved surface with barycentric `weights` in triangle t [mm]."""
    p = vec3(0.0)
    for k in ti.static(range(3)):
        p += weights[k] * moved.position[surfaces.triangles[t, k]]
    bulge = vec3(0.0)
    for k in ti.static(range(3)):
        v = surfaces.triangles[t, k]
        bulge += weights[k] * (moved.position[v] - p).dot(smooth.normal[v]) * smooth.normal[v]
    return p + 0.5 * bulge


@func
def curved_normal(t: ti.i32, weights: vec3, surfaces: Surfaces, smooth: SmoothSurfaces) -> vec3:
    """Unit normal of the curved surface with barycentric `weights` in triangle t."""
    normal = vec3(0.0)
    for k in ti.static(range(3)):
        normal += weights[k] * smooth.normal[surfaces.triangles[t, k]]
    return normal.normalized()


@func
def weights_of_normal(t: ti.i32, direction: vec3, surfaces: Surfaces, smooth: SmoothSurfaces):
    """Whether curved triangle t has a point with its normal in this direction, and the weights of the point."""
    a = smooth.normal[surfaces.triangles[t, 0]]
    b = smooth.normal[surfaces.triangles[t, 1]]
    c = smooth.normal[surfaces.triangles[t, 2]]
    span = a.dot(b.cross(c))
    weights = vec3(direction.dot(b.cross(c)), direction.dot(c.cross(a)), direction.dot(a.cross(b))) / span
    total = weights.sum()
    weights /= total
    return total > 0.0 and weights.min() >= -ON_EDGE, weights
