"""The contacts of a step, as kernels see them."""

from typing import NamedTuple

import numpy as np

from taichisoft.runtime.launch import func
from taichisoft.runtime.sorting import sort_rows
from taichisoft.runtime.taichi_start import (
    IntegerBlocks,
    Integers,
    IntegerTable,
    Scalars,
    ScalarTable,
    Vectors,
    VectorTable,
    ti,
    vec3,
)

ivec3 = ti.types.vector(3, ti.i32)

# Columns of the place of a contact in the order of all.
GROUP, FIRST_FEATURE, SECOND_FEATURE, PLACE_COLUMNS = range(4)


class Contacts(NamedTuple):
    """Pairs of points on two surfaces, in arrays with room for more; the first body of a pair has the lower number.

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

    @classmethod
    def with_room(cls, capacity: int) -> "Contacts":
        """Arrays for so many contacts, none in them yet."""
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
        """A copy in arrays without room for more."""
        return Contacts(self.count.copy(), *(array[: self.count[0]].copy() for array in self[1:]))


@func
def copy_contact(source: Contacts, c: ti.i32, target: Contacts, k: ti.i32):
    """Write contact c of `source` to number k of `target`."""
    target.distance[k] = source.distance[c]
    target.normal[k] = source.normal[c]
    for side in ti.static(range(2)):
        target.bodies[k, side] = source.bodies[c, side]
        target.weights[k, side] = source.weights[c, side]
        target.points[k, side] = source.points[c, side]
        for corner in ti.static(range(3)):
            target.vertices[k, side, corner] = source.vertices[c, side, corner]


class SearchSpace(NamedTuple):
    """Work space of the search for contacts, with the contacts in the order in which a search through trees finds them.

    Attributes:
        leaf: leaves of the other surface near a feature, shape (most_leaves,).
        triangle, weights: triangles within reach of a vertex, and the barycentric weights of the points closest to it,
            shapes (most_triangles,) and (most_triangles, 3).
        deepest: least distance of a vertex of each pair of surfaces below 0, 0 for none [mm], shape (pair_count,).
        place: place of each contact found in the order of all: the GROUP of features that it belongs to, and the
            number of each feature, shape (capacity, PLACE_COLUMNS).
        order, spare: the order of the places, and work space to find it, shape (capacity,).
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
    """Add a contact, whose sides are still to be set, and return its number.

    One that finds no room is counted and takes the number of the last: the caller makes room and starts again.
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
    """The feature of one side of a contact, and the point on it."""
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
    """Add a contact of two points on things without vertices."""
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
