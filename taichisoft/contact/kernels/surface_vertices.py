"""The contact surfaces of all bodies in one set of arrays, and the motion of their vertices with the bodies."""

from typing import NamedTuple

from taichisoft.runtime.language import SOFT, Integers, IntegerTable, Matrices, ScalarTable, Vectors, ti, vec3
from taichisoft.runtime.launch import kernel

# What surface a vertex stands for, of `ContactSurfaces.vertex_is_round`: with a corner, round, treated as curved.
SHARP, ROUND, SMOOTH = range(3)


class Surfaces(NamedTuple):
    """Triangles, edges and vertices of all surfaces, and their adjacency.

    Attributes:
        body: number of each surface's body, shape (surface_count,).
        triangles: vertices of each triangle, shape (triangle_count, 3).
        triangle_edges: edge opposite to each corner, shape (triangle_count, 3).
        edges: vertices of each edge, shape (edge_count, 2).
        edge_triangles: the one or two triangles at each edge, -1 for none, shape (edge_count, 2).
        star_start, star: star[star_start[v] : star_start[v + 1]] are the vertices joined to vertex v by an edge.
        first_triangle: triangle with the lowest number at each vertex, shape (vertex_count,).
        fan_start, fan: fan[fan_start[v] : fan_start[v + 1]] are the triangle corners at v (3 * triangle + corner).
        moving: numbers of the surfaces that can move, shape (moving_count,).
        pairs: pairs of surfaces that can touch: at least one moves, no group in common, shape (pair_count, 2).
    """

    body: Integers
    triangles: IntegerTable
    triangle_edges: IntegerTable
    edges: IntegerTable
    edge_triangles: IntegerTable
    star_start: Integers
    star: Integers
    first_triangle: Integers
    fan_start: Integers
    fan: Integers
    moving: Integers
    pairs: IntegerTable


class Planes(NamedTuple):
    """Half-spaces.

    Attributes:
        body: number of each plane's body, shape (plane_count,).
        point: a point on each plane [mm], shape (plane_count, 3).
        normal: outward unit vector, shape (plane_count, 3).
    """

    body: Integers
    point: Vectors
    normal: Vectors


class Carriers(NamedTuple):
    """The bodies and nodes that carry the vertices.

    Attributes:
        owner: number of the rigid body that carries a vertex, or SOFT, or STATIC, shape (vertex_count,).
        local: rest position, on a rigid body in body axes from the centre of mass [mm], shape (vertex_count, 3).
        nodes, weights: soft nodes that carry a vertex and their weights [-], shape (vertex_count, nodes_per_vertex).
    """

    owner: Integers
    local: Vectors
    nodes: IntegerTable
    weights: ScalarTable


class PoseArrays(NamedTuple):
    """Positions and rotations of the bodies.

    Attributes:
        node_position: soft nodes [mm], shape (node_count, 3).
        rigid_position: centres of mass [mm], shape (rigid_count, 3).
        rigid_rotation: body axes in the world, shape (rigid_count, 3, 3).
    """

    node_position: Vectors
    rigid_position: Vectors
    rigid_rotation: Matrices


class MovedSurfaces(NamedTuple):
    """Current positions of the surfaces.

    Attributes:
        position: vertices [mm], shape (vertex_count, 3).
        lower, upper: corners of the boxes of the trees [mm], shape (tree_node_count, 3).
    """

    position: Vectors
    lower: Vectors
    upper: Vectors


@kernel
def move_vertices(carriers: Carriers, poses: PoseArrays, moved: MovedSurfaces):
    """Move the vertices of soft bodies with their nodes, and the vertices of rigid bodies with their poses."""
    ti.loop_config(serialize=True)
    for v in range(carriers.owner.shape[0]):
        owner = carriers.owner[v]
        if owner == SOFT:
            position = vec3(0.0)
            for k in range(carriers.nodes.shape[1]):
                position += carriers.weights[v, k] * poses.node_position[carriers.nodes[v, k]]
            moved.position[v] = position
        elif owner >= 0:
            moved.position[v] = poses.rigid_rotation[owner] @ carriers.local[v] + poses.rigid_position[owner]
