"""Narrow phase: vertices against infinite planes."""

from taichisoft.kernels.contact_store import store
from taichisoft.kernels.launch import kernel
from taichisoft.kernels.runtime import IntegerBlocks, Integers, IntegerTable, Scalars, Vectors, VectorTable, ti, vec3


@kernel
def vertices_against_planes(
    surfaces: Integers,
    body: Integers,
    plane_body: Integers,
    plane_point: Vectors,
    plane_normal: Vectors,
    reach: ti.f64,
    first_group: ti.i32,
    position: Vectors,
    root: Integers,
    escape: Integers,
    vertex_start: Integers,
    vertex: Integers,
    lower: Vectors,
    upper: Vectors,
    count: Integers,
    places: IntegerTable,
    bodies: IntegerTable,
    vertices: IntegerBlocks,
    weights: VectorTable,
    points: VectorTable,
    normals: Vectors,
    distances: Scalars,
):
    """Vertices of the given surfaces closer than `reach` to a plane; below it is inside, however deep."""
    ti.loop_config(serialize=True)
    for plane in range(plane_point.shape[0]):
        up = plane_normal[plane]
        for k in range(surfaces.shape[0]):
            s = surfaces[k]
            node = root[s]
            while node < root[s + 1]:
                lowest = 0.0  # of the box above the plane
                for axis in ti.static(range(3)):
                    corner = ti.select(up[axis] > 0.0, lower[node][axis], upper[node][axis])
                    lowest += up[axis] * (corner - plane_point[plane][axis])
                if lowest < reach:
                    for i in range(vertex_start[node], vertex_start[node + 1]):
                        v = vertex[i]
                        p = position[v]
                        distance = (p - plane_point[plane]).dot(up)
                        if distance < reach:
                            store(
                                first_group + plane, v, plane, body[s], plane_body[plane],
                                ti.Vector([v, v, v]), ti.Vector([-1, -1, -1]),
                                vec3(1.0, 0.0, 0.0), vec3(0.0), p, p - distance * up, -up, distance,
                                count, places, bodies, vertices, weights, points, normals, distances,
                            )  # fmt: skip
                    node += 1
                else:
                    node = escape[node]
