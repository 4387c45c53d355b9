"""Actuators' coordinates: numbers that depend on where bodies are, a cavity's volume or how far a cable is pulled in.

The effort of a coordinate is what does work on it: the pressure in a cavity, the tension of a cable.
"""

from typing import NamedTuple

from taichisoft.runtime.language import SOFT, Integers, IntegerTable, Matrices, Scalars, ScalarTable, Vectors, ti, vec3
from taichisoft.runtime.launch import kernel

# Volumes of closed surfaces that follow the nodes, and the gradients of the volumes.
#
# A surface has flat triangles or, around quadratic elements, six-node triangles, whose sides bend with the elements.


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
    """The six-node triangles of all cavities, and how functions on them are integrated (`mesh/surface.py`).

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


class Coordinates(NamedTuple):
    """What the coordinates depend on: the volumes of the cavities, then the coordinates of the cables.

    Attributes:
        entry_start: where the soft nodes of each coordinate begin, shape (coordinate_count + 1,).
        entry_node: soft node of each entry, once in a coordinate, shape (entry_count,).
        rigid_start: where the rigid bodies of each coordinate begin, shape (coordinate_count + 1,).
        rigid_body: rigid body of each of these entries, once in a coordinate, shape (rigid_entry_count,).
    """

    entry_start: Integers
    entry_node: Integers
    rigid_start: Integers
    rigid_body: Integers


class Gradient(NamedTuple):
    """Derivatives of the coordinates, of volumes [mm^2] and of cables [-], at the start of a step.

    Attributes:
        soft: by the position of each entry's node, shape (entry_count, 3).
        rigid: by the translation of each rigid entry's body [-] and its rotation [mm], shape (rigid_entry_count, 6).
    """

    soft: Vectors
    rigid: ScalarTable


# Cables: lengths of polylines through points of bodies, and how they change with the bodies' motion.


class CablePaths(NamedTuple):
    """The points of all cables, each from its pulled end to the attached one.

    A cable's first coordinate is how far it is pulled in. With friction a coordinate follows for each inner point: the
    length between this point and the attached end.

    Attributes:
        point_start: where each cable's points begin, shape (cable_count + 1,).
        owner: SOFT, STATIC, or the rigid body that carries each point, shape (point_count,).
        nodes, weights: soft nodes that carry a point, shape (point_count, slots).
        slot: place of each of these nodes among the soft entries of its cable, or -1, shape (point_count, slots).
        rigid_slot: place of the rigid body among the rigid entries of its cable, or -1, shape (point_count,).
        cable: cable of each coordinate, shape (coordinate_count,).
        first_point: first point on which each coordinate depends, shape (coordinate_count,).
        friction: coefficient between a cable and its points [-], shape (cable_count,).
    """

    point_start: Integers
    owner: Integers
    nodes: IntegerTable
    weights: ScalarTable
    slot: IntegerTable
    rigid_slot: Integers
    cable: Integers
    first_point: Integers
    friction: Scalars


class CableShapeArrays(NamedTuple):
    """The cables at the bodies' present positions.

    Attributes:
        place: points that no soft body carries, in the rigid body's frame or in space [mm], shape (point_count, 3).
        position: [mm], shape (point_count, 3).
        both, onward: sum of the unit vectors to a point's neighbours, and the one to the next, shape (point_count, 3).
        length: [mm], shape (cable_count,).
        grip: exp(friction times turning angle) - 1 at the inner point of each coordinate; 0 for whole cables,
            shape (coordinate_count,).
    """

    place: Vectors
    position: Vectors
    both: Vectors
    onward: Vectors
    length: Scalars
    grip: Scalars


@kernel
def measure(
    first_coordinate: ti.i32,
    paths: CablePaths,
    coordinates: Coordinates,
    node_position: Vectors,
    rigid_position: Vectors,
    rigid_rotation: Matrices,
    shapes: CableShapeArrays,
    gradient: Gradient,
):
    """Lengths, turning angles, and the gradients of the cables' coordinates, `first_coordinate` and those after it."""
    position, both, onward = ti.static(shapes.position, shapes.both, shapes.onward)
    ti.loop_config(serialize=True)
    for p in range(position.shape[0]):
        place = shapes.place[p]
        if paths.owner[p] >= 0:
            place = rigid_position[paths.owner[p]] + rigid_rotation[paths.owner[p]] @ place
        elif paths.owner[p] == SOFT:
            place = vec3(0.0)
            for k in range(paths.nodes.shape[1]):
                place += paths.weights[p, k] * node_position[paths.nodes[p, k]]
        position[p] = place
        both[p] = vec3(0.0)
        onward[p] = vec3(0.0)
    ti.loop_config(serialize=True)
    for c in range(shapes.length.shape[0]):
        total = 0.0
        for p in range(paths.point_start[c], paths.point_start[c + 1] - 1):
            way = position[p + 1] - position[p]
            length = way.norm()
            total += length
            if length > 0.0:
                onward[p] = way / length
                both[p] += way / length
                both[p + 1] -= way / length
        shapes.length[c] = total
    ti.loop_config(serialize=True)
    for r in range(paths.cable.shape[0]):
        c, first = paths.cable[r], paths.first_point[r]
        whole = first == paths.point_start[c]
        shapes.grip[r] = 0.0
        if not whole:
            before, after = onward[first - 1], onward[first]
            angle = ti.atan2(before.cross(after).norm(), before.dot(after))
            shapes.grip[r] = ti.exp(paths.friction[c] * angle) - 1.0
        row = first_coordinate + r
        soft_start, rigid_start = coordinates.entry_start[row], coordinates.rigid_start[row]
        for k in range(soft_start, coordinates.entry_start[row + 1]):
            gradient.soft[k] = vec3(0.0)
        for k in range(rigid_start, coordinates.rigid_start[row + 1]):
            for d in range(6):
                gradient.rigid[k, d] = 0.0
        for p in range(first, paths.point_start[c + 1]):
            direction = both[p]
            if not whole:
                direction = -both[p]
                if p == first:
                    direction = -onward[p]
            for k in range(paths.slot.shape[1]):
                if paths.slot[p, k] >= 0:
                    gradient.soft[soft_start + paths.slot[p, k]] += paths.weights[p, k] * direction
            if paths.rigid_slot[p] >= 0:
                moment = (position[p] - rigid_position[paths.owner[p]]).cross(direction)
                entry = rigid_start + paths.rigid_slot[p]
                for d in ti.static(range(3)):
                    gradient.rigid[entry, d] = gradient.rigid[entry, d] + direction[d]
                    gradient.rigid[entry, 3 + d] = gradient.rigid[entry, 3 + d] + moment[d]
