"""Surfaces that follow their bodies: vertex positions and pseudo-normals."""

from taichisoft.kernels.launch import kernel
from taichisoft.kernels.runtime import (
    SOFT,
    Integers,
    IntegerTable,
    Matrices,
    Scalars,
    ScalarTable,
    Vectors,
    ti,
    vec3,
)


@kernel
def move_vertices(
    owner: Integers,
    local: Vectors,
    nodes: IntegerTable,
    weights: ScalarTable,
    node_position: Vectors,
    rigid_position: Vectors,
    rigid_rotation: Matrices,
    triangles: IntegerTable,
    position: Vectors,
    triangle_normal: Vectors,
):
    """Vertices of soft bodies (owner SOFT) follow their nodes, those of rigid bodies their pose; then unit normals."""
    for v in range(owner.shape[0]):
        if owner[v] == SOFT:
            moved = vec3(0.0)
            for k in range(nodes.shape[1]):
                moved += weights[v, k] * node_position[nodes[v, k]]
            position[v] = moved
        elif owner[v] >= 0:
            position[v] = rigid_rotation[owner[v]] @ local[v] + rigid_position[owner[v]]
    for t in range(triangles.shape[0]):
        a = position[triangles[t, 0]]
        normal = (position[triangles[t, 1]] - a).cross(position[triangles[t, 2]] - a)
        triangle_normal[t] = normal / ti.max(normal.norm(), 1e-300)


@kernel
def cavity_gradients(
    vertex_start: Integers,
    fan: Integers,
    triangles: IntegerTable,
    position: Vectors,
    area_vector: Vectors,
    node_start: Integers,
    node_vertex: Integers,
    node_weight: Scalars,
    gradient: Vectors,
):
    """Gradient of the enclosed volume with respect to nodes: a third of the area vectors around each vertex."""
    for v in range(position.shape[0]):
        total = vec3(0.0)
        for k in range(vertex_start[v], vertex_start[v + 1]):
            t = fan[k] // 3
            a = position[triangles[t, 0]]
            total += (position[triangles[t, 1]] - a).cross(position[triangles[t, 2]] - a) / 6.0
        area_vector[v] = total
    for i in range(gradient.shape[0]):
        total = vec3(0.0)
        for k in range(node_start[i], node_start[i + 1]):
            total += node_weight[k] * area_vector[node_vertex[k]]
        gradient[i] = total
