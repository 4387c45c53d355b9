"""Cables: lengths of polylines through points of bodies, and how they change with the bodies' motion."""

from typing import NamedTuple

from taichisoft.actuators.kernels.coordinate_gradients import Coordinates, Gradient
from taichisoft.runtime.language import (
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
from taichisoft.runtime.launch import kernel


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
