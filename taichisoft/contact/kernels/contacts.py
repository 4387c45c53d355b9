"""The contacts of a step, and the moved vertices of surfaces, in arrays for kernels."""

from typing import NamedTuple

import numpy as np

from taichisoft.runtime.arithmetic import sort_rows
from taichisoft.runtime.language import (
    SOFT,
    IntegerBlocks,
    Integers,
    IntegerTable,
    Matrices,
    Scalars,
    ScalarTable,
    Vectors,
    VectorTable,
    func,
    ti,
    vec3,
)
from taichisoft.runtime.launch import kernel

# The contact surfaces of all bodies in one set of arrays, and the motion of their vertices with the bodies.

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


# The contacts of a step in arrays for kernels.

ivec3 = ti.types.vector(3, ti.i32)

# Columns of `SearchSpace.place`.
GROUP, FIRST_FEATURE, SECOND_FEATURE, PLACE_COLUMNS = range(4)


class Contacts(NamedTuple):
    """Pairs of points on two surfaces, in arrays with spare capacity; the first body has the lower number.

    Attributes:
        count: number of contacts, shape (1,); entries of the other arrays beyond it are undefined.
        bodies: numbers of the two bodies, shape (capacity, 2).
        vertices: three vertices of each side's feature, repeated for edges and vertices, -1 on a plane, shape
            (capacity, 2, 3).
        weights: barycentric weights of the points in these vertices, shape (capacity, 2, 3).
        points: the two points [mm], shape (capacity, 2, 3); on a plane the projection of the other point.
        normal: unit vector from the first body to the second, shape (capacity, 3).
        distance: distance of the points [mm], negative if the surfaces penetrate each other, shape (capacity,).
    """

    count: Integers
    bodies: IntegerTable
    vertices: IntegerBlocks
    weights: VectorTable
    points: VectorTable
    normal: Vectors
    distance: Scalars

    @classmethod
    def with_room(cls, capacity: int) -> "Contacts":
        """Empty arrays for `capacity` contacts."""
        return cls(
            count=np.zeros(1, dtype=np.int32),
            bodies=np.zeros((capacity, 2), dtype=np.int32),
            vertices=np.zeros((capacity, 2, 3), dtype=np.int32),
            weights=np.zeros((capacity, 2, 3)),
            points=np.zeros((capacity, 2, 3)),
            normal=np.zeros((capacity, 3)),
            distance=np.zeros(capacity),
        )

    def trimmed(self) -> "Contacts":
        """A copy without spare capacity."""
        return Contacts(self.count.copy(), *(array[: self.count[0]].copy() for array in self[1:]))


@func
def copy_contact(source: Contacts, c: ti.i32, target: Contacts, k: ti.i32):
    """Copy contact c of `source` to index k of `target`."""
    target.distance[k] = source.distance[c]
    target.normal[k] = source.normal[c]
    for side in ti.static(range(2)):
        target.bodies[k, side] = source.bodies[c, side]
        target.weights[k, side] = source.weights[c, side]
        target.points[k, side] = source.points[c, side]
        for corner in ti.static(range(3)):
            target.vertices[k, side, corner] = source.vertices[c, side, corner]


class SearchSpace(NamedTuple):
    """Work space of the search for contacts, which are in the order in which the search through the trees finds them.

    Attributes:
        leaf: leaves of the other surface near a feature, shape (largest leaf count,).
        triangle, weights: triangles within reach of a vertex, and the barycentric weights of the points closest to the
            vertex, shapes (n,) and (n, 3) with the largest triangle count n of a surface.
        deepest: most negative distance of a vertex of each pair of surfaces, 0 without penetration [mm], (pair_count,).
        place: sort key of each contact: the GROUP of its features, and the numbers of both features, shape
            (capacity, PLACE_COLUMNS).
        order, spare: contacts sorted by place, and work space of the sorting, shape (capacity,).
    """

    leaf: Integers
    triangle: Integers
    weights: Vectors
    deepest: Scalars
    place: ScalarTable
    order: Integers
    spare: Integers


@func
def append(
    group: ti.i32,
    first_feature: ti.i32,
    second_feature: ti.i32,
    first_body: ti.i32,
    second_body: ti.i32,
    normal: vec3,
    distance: ti.f64,
    space: SearchSpace,
    found: Contacts,
) -> ti.i32:
    """Add a contact without its sides, and return its index.

    Beyond the capacity a contact is counted and overwrites the last one: the caller must enlarge the arrays and repeat
    the search.
    """
    c = ti.min(found.count[0], found.distance.shape[0] - 1)
    found.count[0] = found.count[0] + 1
    space.place[c, GROUP] = group
    space.place[c, FIRST_FEATURE] = first_feature
    space.place[c, SECOND_FEATURE] = second_feature
    found.bodies[c, 0] = first_body
    found.bodies[c, 1] = second_body
    found.normal[c] = normal
    found.distance[c] = distance
    return c


@func
def set_side(c: ti.i32, side: ti.i32, vertices: ivec3, weights: vec3, point: vec3, found: Contacts):
    """Set the feature of one side of a contact, and the point on it [mm]."""
    for k in ti.static(range(3)):
        found.vertices[c, side, k] = vertices[k]
    found.weights[c, side] = weights
    found.points[c, side] = point


@func
def append_points(
    group: ti.i32,
    feature: ti.i32,
    k: ti.i32,
    first_body: ti.i32,
    second_body: ti.i32,
    first_point: vec3,
    second_point: vec3,
    normal: vec3,
    distance: ti.f64,
    space: SearchSpace,
    found: Contacts,
):
    """Add a contact of two points on features without vertices, such as planes and round shapes."""
    c = append(group, feature, k, first_body, second_body, normal, distance, space, found)
    set_side(c, 0, ivec3(-1), vec3(0.0), first_point, found)
    set_side(c, 1, ivec3(-1), vec3(0.0), second_point, found)


@func
def put_in_order(space: SearchSpace, found: Contacts, contacts: Contacts):
    """Write the contacts found to `contacts` in the order of their places."""
    sort_rows(found.count[0], space.place, space.order, space.spare)
    for k in range(found.count[0]):
        copy_contact(found, space.order[k], contacts, k)
    contacts.count[0] = found.count[0]
