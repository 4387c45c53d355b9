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


class Trees(NamedTuple):
    """Binary trees of axis-parallel boxes, one per surface, with the nodes of all trees in one set of arrays.

    Nodes are in depth-first order: the first child of node n is n + 1, and `escape[n]` is the node after its last
    descendant, where a search that skips n continues without a stack. For a leaf `escape[n]` is n + 1.

    Every vertex and every edge that can touch belongs to one leaf, whose box contains it. The vertices of node n are
    `vertex[vertex_start[n] : vertex_start[n + 1]]`, likewise its triangles, corners and edges; empty for inner nodes.

    Attributes:
        root: first node of each surface, then the number of nodes, shape (surface_count + 1,).
        escape: node after the last descendant, shape (node_count,).
        triangle_start, triangle: triangles of each leaf.
        corner_start, corner: vertices of these triangles, each once.
        vertex_start, vertex: vertices that belong to each leaf and can touch.
        edge_start, edge: edges that belong to each leaf and can touch.
    """

    root: Integers
    escape: Integers
    triangle_start: Integers
    triangle: Integers
    corner_start: Integers
    corner: Integers
    vertex_start: Integers
    vertex: Integers
    edge_start: Integers
    edge: Integers


class RoundShapes(NamedTuple):
    """Geometry and owners of the shapes, and the surfaces and shapes that they can touch.

    Attributes:
        body: number of each shape's body, shape (shape_count,).
        owner: number of the rigid body that carries a shape, or STATIC, shape (shape_count,).
        flat: 1 for flat ends (cylinder), 0 for round ones (sphere, capsule), shape (shape_count,).
        radius: radius [mm], shape (shape_count,).
        half_length: half the length of the axis, without round ends [mm], shape (shape_count,).
        local_centre: middle of the axis, on a rigid body in body axes from the centre of mass [mm], (shape_count, 3).
        local_axis, local_side: unit vectors along and across the axis, in the same axes, shape (shape_count, 3).
        moving: numbers of the shapes that can move, shape (moving_count,).
        surface_pairs: numbers of a SHAPE and a SURFACE that can touch, and whether the surface IS_SOFT, shape
            (pair_count, SURFACE_PAIR_COLUMNS).
        shape_pairs: numbers of two shapes that can touch, the lower body number first, shape (shape_pair_count, 2).
    """

    body: Integers
    owner: Integers
    flat: Integers
    radius: Scalars
    half_length: Scalars
    local_centre: Vectors
    local_axis: Vectors
    local_side: Vectors
    moving: Integers
    surface_pairs: IntegerTable
    shape_pairs: IntegerTable


class MovedShapes(NamedTuple):
    """Current positions of the shapes.

    Attributes:
        centre: middles of the axes [mm], shape (shape_count, 3).
        axis, side: unit vectors along and across the axes, shape (shape_count, 3).
        lean: unit vectors across the axes from which the rims of level ends are divided, for the end at the beginning
            and the end at the tip of the axis, shape (shape_count, 2, 3).
    """

    centre: Vectors
    axis: Vectors
    side: Vectors
    lean: VectorTable


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

ivec2, ivec3 = ti.types.vector(2, ti.i32), ti.types.vector(3, ti.i32)

# Columns of `SearchSpace.place`.
GROUP, FIRST_FEATURE, SECOND_FEATURE, PLACE_COLUMNS = range(4)

# First group of each kind of contact, in the order of the report: of vertices with triangles, of two edges, and of
# vertices with planes; of a surface with itself; of curved triangles with faces, edges and planes; of round shapes with
# surfaces, planes and each other.
(
    VERTEX_GROUPS,
    EDGE_GROUPS,
    PLANE_GROUPS,
    OWN_GROUPS,
    CURVED_ON_FACES,
    CURVED_ON_EDGES,
    CURVED_ON_PLANES,
    SHAPES_ON_SURFACES,
    SHAPES_ON_PLANES,
    SHAPES_ON_SHAPES,
) = range(0, 10 << 27, 1 << 27)


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
        place: sort key of each contact: the GROUP of its features, and the numbers of both features, shape
            (capacity, PLACE_COLUMNS).
        order, spare: contacts sorted by place, and work space of the sorting, shape (capacity,).
    """

    leaf: Integers
    triangle: Integers
    weights: Vectors
    place: ScalarTable
    order: Integers
    spare: Integers


# Entries of SelfTouching.limits.
NEAR, DEPTH = range(2)


class SelfTouching(NamedTuple):
    """The surfaces that touch themselves.

    Attributes:
        surface: numbers of the surfaces, shape (count,).
        rest: rest positions of the vertices of all surfaces [mm], shape (vertex_count, 3).
        limits: NEAR, the distance at rest below which features never touch, and DEPTH, the largest penetration that is
            pushed out [mm], shape (2,).
    """

    surface: Integers
    rest: Vectors
    limits: Scalars


class Search(NamedTuple):
    """What the search for contacts reads, and where it writes.

    Attributes:
        reaches: largest distance of contacts of two bodies [mm], negative where none are searched for, shape
            (body_count, body_count).
        surfaces, trees: all surfaces, and trees of boxes over them.
        planes: all half-spaces.
        moved: where the surfaces are.
        smooth: the surfaces treated as curved.
        shapes, there: all round shapes, and where they are.
        touching: the surfaces that touch themselves.
        space: work space.
        found: the contacts found, in the order in which the search finds them.
    """

    reaches: ScalarTable
    surfaces: Surfaces
    trees: Trees
    planes: Planes
    moved: MovedSurfaces
    smooth: SmoothSurfaces
    shapes: RoundShapes
    there: MovedShapes
    touching: SelfTouching
    space: SearchSpace
    found: Contacts


@func
def append(
    group: ti.i32,
    first_feature: ti.i32,
    second_feature: ti.i32,
    bodies: ivec2,
    normal: vec3,
    distance: ti.f64,
    search: Search,
) -> ti.i32:
    """Add a contact without its sides, and return its index.

    Beyond the capacity a contact is counted and overwrites the last one: the caller must enlarge the arrays and repeat
    the search.
    """
    space, found = ti.static(search.space, search.found)
    c = ti.min(found.count[0], found.distance.shape[0] - 1)
    found.count[0] = found.count[0] + 1
    space.place[c, GROUP] = group
    space.place[c, FIRST_FEATURE] = first_feature
    space.place[c, SECOND_FEATURE] = second_feature
    found.bodies[c, 0], found.bodies[c, 1] = bodies[0], bodies[1]
    found.normal[c] = normal
    found.distance[c] = distance
    return c


@func
def corners(t: ti.i32, surfaces: Surfaces) -> ivec3:
    """The vertices of triangle t."""
    return ivec3(surfaces.triangles[t, 0], surfaces.triangles[t, 1], surfaces.triangles[t, 2])


@func
def ends(e: ti.i32, surfaces: Surfaces) -> ivec3:
    """The vertices of edge e, as the feature of a contact."""
    return ivec3(surfaces.edges[e, 0], surfaces.edges[e, 1], surfaces.edges[e, 1])


@func
def set_side(c: ti.i32, side: ti.i32, vertices: ivec3, weights: vec3, point: vec3, search: Search):
    """Set the feature of one side of a contact, and the point on it [mm]."""
    found = ti.static(search.found)
    for k in ti.static(range(3)):
        found.vertices[c, side, k] = vertices[k]
    found.weights[c, side] = weights
    found.points[c, side] = point


@func
def append_points(
    group: ti.i32,
    feature: ti.i32,
    k: ti.i32,
    bodies: ivec2,
    first_point: vec3,
    second_point: vec3,
    normal: vec3,
    distance: ti.f64,
    search: Search,
):
    """Add a contact of two points on features without vertices, such as planes and round shapes."""
    c = append(group, feature, k, bodies, normal, distance, search)
    set_side(c, 0, ivec3(-1), vec3(0.0), first_point, search)
    set_side(c, 1, ivec3(-1), vec3(0.0), second_point, search)


@func
def put_in_order(search: Search, contacts: Contacts):
    """Write the contacts found to `contacts` in the order of their places."""
    space, found = ti.static(search.space, search.found)
    sort_rows(found.count[0], space.place, space.order, space.spare)
    for k in range(found.count[0]):
        copy_contact(found, space.order[k], contacts, k)
    contacts.count[0] = found.count[0]
