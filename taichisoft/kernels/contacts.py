"""The contacts of a step, as kernels see them."""

from typing import NamedTuple

from taichisoft.kernels.runtime import IntegerBlocks, Integers, IntegerTable, Scalars, Vectors, VectorTable


class Contacts(NamedTuple):
    """Pairs of points on two surfaces, in arrays with room for more; the first body has the lower number.

    Attributes:
        count: number of contacts, shape (1,); what stands behind them in the other arrays means nothing.
        bodies: numbers of the two bodies, shape (capacity, 2).
        vertices: three vertices of each side's feature, repeated where it has fewer, -1 on a plane, (capacity, 2, 3).
        weights: barycentric weights of the points in them, shape (capacity, 2, 3).
        points: the two points [mm], shape (capacity, 2, 3); on a plane the foot of the other point.
        normal: unit vector from the first body to the second, shape (capacity, 3).
        distance: [mm], negative when the surfaces have slipped through each other, shape (capacity,).
    """

    count: Integers
    bodies: IntegerTable
    vertices: IntegerBlocks
    weights: VectorTable
    points: VectorTable
    normal: Vectors
    distance: Scalars
