"""Round shapes without triangles: spheres, capsules and cylinders.

A capsule is all points closer to a segment than the radius; a sphere is a capsule of length 0. A cylinder has flat
ends.
"""

from typing import NamedTuple

from taichisoft.contact.kernels.surface_vertices import PoseArrays
from taichisoft.runtime.language import Integers, IntegerTable, Scalars, Vectors, VectorTable, ti
from taichisoft.runtime.launch import kernel

# Columns of `RoundShapes.surface_pairs`.
SHAPE, SURFACE, IS_SOFT, SURFACE_PAIR_COLUMNS = range(4)


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


@kernel
def move_shapes(shapes: RoundShapes, poses: PoseArrays, there: MovedShapes):
    """Move the shapes of rigid bodies to their poses."""
    ti.loop_config(serialize=True)
    for s in range(shapes.owner.shape[0]):
        owner = shapes.owner[s]
        if owner >= 0:
            turn = poses.rigid_rotation[owner]
            there.centre[s] = turn @ shapes.local_centre[s] + poses.rigid_position[owner]
            there.axis[s] = turn @ shapes.local_axis[s]
            there.side[s] = turn @ shapes.local_side[s]
            for end in ti.static(range(2)):
                there.lean[s, end] = there.side[s]
