"""Volumes of closed surfaces that follow the nodes, and the gradients of the volumes."""

from taichisoft.kernels.launch import kernel
from taichisoft.kernels.runtime import Integers, IntegerTable, Scalars, ScalarTable, Vectors, ti, vec3


@kernel
def volumes_and_gradients(
    node_position: Vectors,
    vertex_nodes: IntegerTable,
    vertex_weights: ScalarTable,
    triangle_start: Integers,
    triangles: IntegerTable,
    part_start: Integers,
    part_vertex: Integers,
    part_weight: Scalars,
    position: Vectors,
    area_vector: Vectors,
    volume: Scalars,
    gradient: Vectors,
):
    """Volumes by the divergence theorem; their gradient at a vertex is a third of the area vectors around it.

    Positions are taken from the first vertex of a cavity: far from the origin that saves digits.
    """
    ti.loop_config(serialize=True)
    for v in range(position.shape[0]):
        total = vec3(0.0)
        for k in range(vertex_nodes.shape[1]):
            total += vertex_weights[v, k] * node_position[vertex_nodes[v, k]]
        position[v] = total
        area_vector[v] = vec3(0.0)
    ti.loop_config(serialize=True)
    for cavity in range(volume.shape[0]):
        origin = position[triangles[triangle_start[cavity], 0]]
        six_volumes = 0.0
        for t in range(triangle_start[cavity], triangle_start[cavity + 1]):
            a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
            corner = position[a]
            double_area = (position[b] - corner).cross(position[c] - corner)
            six_volumes += (corner - origin).dot(double_area)
            area_vector[a] += double_area / 6.0
            area_vector[b] += double_area / 6.0
            area_vector[c] += double_area / 6.0
        volume[cavity] = six_volumes / 6.0
    ti.loop_config(serialize=True)
    for i in range(gradient.shape[0]):
        total = vec3(0.0)
        for k in range(part_start[i], part_start[i + 1]):
            total += part_weight[k] * area_vector[part_vertex[k]]
        gradient[i] = total


@kernel
def flows(entry_start: Integers, gradient: Vectors, velocity: Vectors, rate: Scalars):
    """Rate of each cavity's volume, from the velocities of the nodes that its entries stand for."""
    ti.loop_config(serialize=True)
    for cavity in range(rate.shape[0]):
        total = 0.0
        for entry in range(entry_start[cavity], entry_start[cavity + 1]):
            total += gradient[entry].dot(velocity[entry])
        rate[cavity] = total
