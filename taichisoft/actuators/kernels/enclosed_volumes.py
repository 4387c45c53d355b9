"""Volumes of closed surfaces that follow the nodes, and the gradients of the volumes.

A surface has flat triangles or, around quadratic elements, six-node triangles, whose sides bend with the elements.
"""

from typing import NamedTuple

from taichisoft.runtime.language import Integers, IntegerTable, Scalars, ScalarTable, Vectors, ti, vec3
from taichisoft.runtime.launch import kernel


class CavitySurfaces(NamedTuple):
    """The surfaces of all cavities. A cavity's entries are the nodes that its volume depends on.

    Attributes:
        vertex_nodes, vertex_weights: nodes that carry each vertex, shape (vertex_count, nodes_per_vertex).
        origin: the vertex of each cavity from which positions are taken, shape (cavity_count,).
        triangle_start: where each cavity's flat triangles begin, shape (cavity_count + 1,).
        triangles: vertex indices, shape (triangle_count, 3).
        part_start: where the vertices that an entry carries begin in the lists that follow, shape (entry_count + 1,).
        part_vertex, part_weight: these vertices, and the entry's weight in each.
    """

    vertex_nodes: IntegerTable
    vertex_weights: ScalarTable
    origin: Integers
    triangle_start: Integers
    triangles: IntegerTable
    part_start: Integers
    part_vertex: Integers
    part_weight: Scalars


class CurvedTriangles(NamedTuple):
    """The six-node triangles of all cavities, and how functions on them are integrated (`meshes/curved_walls.py`).

    Attributes:
        start: where each cavity's triangles begin, shape (cavity_count + 1,).
        vertices: vertex indices, the corners before the middles of the sides, shape (triangle_count, 6).
        weighted_shape: weight of each point times the six shape functions there, shape (point_count, 6).
        first_slope, second_slope: slopes of the shape functions along two coordinates, shape (point_count, 6).
    """

    start: Integers
    vertices: IntegerTable
    weighted_shape: ScalarTable
    first_slope: ScalarTable
    second_slope: ScalarTable


class CavityVolumeArrays(NamedTuple):
    """Volumes at the nodes' present positions.

    Attributes:
        position: of the vertices [mm], shape (vertex_count, 3).
        area_vector: dV/dx of each vertex [mm^2], shape (vertex_count, 3): of flat triangles a third of the area vectors
            around it, of six-node triangles the integral of the vertex's shape function over these.
        volume: [mm^3], shape (cavity_count,).
        gradient: dV/dx of each entry's node [mm^2], shape (entry_count, 3).
    """

    position: Vectors
    area_vector: Vectors
    volume: Scalars
    gradient: Vectors


@kernel
def volumes_and_gradients(
    node_position: Vectors, cavities: CavitySurfaces, curved: CurvedTriangles, volumes: CavityVolumeArrays
):
    """Volumes by the divergence theorem, and their gradients, which for a closed surface have nothing of its edges.

    Positions are taken from a vertex of the cavity: far from the origin that saves digits.
    """
    position, area_vector, triangles = ti.static(volumes.position, volumes.area_vector, cavities.triangles)
    ti.loop_config(serialize=True)
    for v in range(position.shape[0]):
        total = vec3(0.0)
        for k in range(cavities.vertex_nodes.shape[1]):
            total += cavities.vertex_weights[v, k] * node_position[cavities.vertex_nodes[v, k]]
        position[v] = total
        area_vector[v] = vec3(0.0)
    ti.loop_config(serialize=True)
    for cavity in range(volumes.volume.shape[0]):
        origin = position[cavities.origin[cavity]]
        six_volumes = 0.0
        for t in range(cavities.triangle_start[cavity], cavities.triangle_start[cavity + 1]):
            a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
            corner = position[a]
            double_area = (position[b] - corner).cross(position[c] - corner)
            six_volumes += (corner - origin).dot(double_area)
            area_vector[a] += double_area / 6.0
            area_vector[b] += double_area / 6.0
            area_vector[c] += double_area / 6.0
        for t in range(curved.start[cavity], curved.start[cavity + 1]):
            corner = position[curved.vertices[t, 0]]
            for q in range(curved.weighted_shape.shape[0]):
                first, second, place = vec3(0.0), vec3(0.0), vec3(0.0)
                for k in range(1, 6):  # the slopes add up to nothing
                    way = position[curved.vertices[t, k]] - corner
                    first += curved.first_slope[q, k] * way
                    second += curved.second_slope[q, k] * way
                area = first.cross(second)
                for k in range(6):
                    vertex, share = curved.vertices[t, k], curved.weighted_shape[q, k]
                    area_vector[vertex] += share * area
                    place += share * (position[vertex] - origin)
                six_volumes += 2.0 * place.dot(area)
        volumes.volume[cavity] = six_volumes / 6.0
    ti.loop_config(serialize=True)
    for i in range(volumes.gradient.shape[0]):
        total = vec3(0.0)
        for k in range(cavities.part_start[i], cavities.part_start[i + 1]):
            total += cavities.part_weight[k] * area_vector[cavities.part_vertex[k]]
        volumes.gradient[i] = total
