"""Signs of a diverged step: leaps of nodes, and inverted elements."""

from typing import NamedTuple

from taichisoft.bodies.kernels.domain_deformation import Domains
from taichisoft.runtime.language import Integers, IntegerTable, Scalars, Vectors, ti
from taichisoft.runtime.launch import kernel

# Integration points of a quadratic element.
POINTS = 4


class Points(NamedTuple):
    """Points of all bodies of a kind, before and after a step.

    Attributes:
        before: positions before the step [mm], shape (point_count, 3).
        velocity: velocities before the step [mm/s], shape (point_count, 3).
        after: positions after the step [mm], shape (point_count, 3).
        body_start: first point of each body, then the number of points, shape (body_count + 1,).
        largest: largest leap of a point of each body [mm], shape (body_count,).
    """

    before: Vectors
    velocity: Vectors
    after: Vectors
    body_start: Integers
    largest: Scalars


class InvertedElements(NamedTuple):
    """Elements of all soft bodies, and the number of inverted ones.

    Attributes:
        elements: corners, shape (element_count, 4).
        first_point: first of the POINTS integration domains of a quadratic element; -1 for others, which are checked by
            their corners, shape (element_count,).
        body_start: first element of each body, then the number of elements, shape (body_count + 1,).
        count: number of inverted elements of each body, shape (body_count,).
    """

    elements: IntegerTable
    first_point: Integers
    body_start: Integers
    count: Integers


@kernel
def largest_leaps(time_step: ti.f64, points: Points):
    """Fill in `largest`: move of a point, or its distance from the position by its velocity, whichever is less."""
    ti.loop_config(serialize=True)
    for body in range(points.largest.shape[0]):
        most = 0.0
        for i in range(points.body_start[body], points.body_start[body + 1]):
            move = points.after[i] - points.before[i]
            surprise = move - time_step * points.velocity[i]
            for d in ti.static(range(3)):
                most = ti.max(most, ti.min(ti.abs(move[d]), ti.abs(surprise[d])))
        points.largest[body] = most


@kernel
def count_inverted(inverted: InvertedElements, domains: Domains, position: Vectors):
    """Count the elements of each body without positive volume, at their corners or at an integration point."""
    ti.loop_config(serialize=True)
    for body in range(inverted.count.shape[0]):
        count = 0
        for e in range(inverted.body_start[body], inverted.body_start[body + 1]):
            origin = position[inverted.elements[e, 0]]
            first, second = position[inverted.elements[e, 1]] - origin, position[inverted.elements[e, 2]] - origin
            least = first.cross(second).dot(position[inverted.elements[e, 3]] - origin)
            if inverted.first_point[e] >= 0:
                for d in range(inverted.first_point[e], inverted.first_point[e] + POINTS):
                    deformation = ti.Matrix.zero(ti.f64, 3, 3)
                    for c in range(domains.start[d], domains.start[d + 1]):
                        deformation += (position[domains.node[c]] - origin).outer_product(domains.gradient[c])
                    least = ti.min(least, deformation.determinant())
            if least <= 0.0:
                count += 1
        inverted.count[body] = count
