"""The list of contacts that the narrow phase fills.

The order in which a search through trees finds them is that of the trees; every contact carries its place in an order
of its own: the group of features that it belongs to, and the number of each feature.
"""

from taichisoft.kernels.runtime import IntegerBlocks, Integers, IntegerTable, Scalars, Vectors, VectorTable, ti, vec3

COINCIDENT = 1e-9  # [mm]

ivec3 = ti.types.vector(3, ti.i32)


@ti.func
def store(
    group: ti.i32,
    first_feature: ti.i32,
    second_feature: ti.i32,
    first_body: ti.i32,
    second_body: ti.i32,
    first: ivec3,
    second: ivec3,
    first_weights: vec3,
    second_weights: vec3,
    first_point: vec3,
    second_point: vec3,
    normal: vec3,
    distance: ti.f64,
    count: Integers,
    places: IntegerTable,
    bodies: IntegerTable,
    vertices: IntegerBlocks,
    weights: VectorTable,
    points: VectorTable,
    normals: Vectors,
    distances: Scalars,
):
    """Append a contact; one that finds no room is only counted, and the caller makes room and starts again."""
    c = count[0]
    if c < distances.shape[0]:
        places[c, 0] = group
        places[c, 1] = first_feature
        places[c, 2] = second_feature
        bodies[c, 0] = first_body
        bodies[c, 1] = second_body
        for k in ti.static(range(3)):
            vertices[c, 0, k] = first[k]
            vertices[c, 1, k] = second[k]
        weights[c, 0] = first_weights
        weights[c, 1] = second_weights
        points[c, 0] = first_point
        points[c, 1] = second_point
        normals[c] = normal
        distances[c] = distance
    count[0] = c + 1
