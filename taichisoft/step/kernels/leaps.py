"""What tells that a step went wrong: nodes that leap, elements that are turned inside out."""

from typing import NamedTuple

from taichisoft.bodies.kernels.domain_deformation import Domains
from taichisoft.runtime.launch import kernel
from taichisoft.runtime.taichi_start import Integers, IntegerTable, Scalars, Vectors, ti

# Integration points of a quadratic element.
POINTS = 4


class Points(NamedTuple):
    """Points of all bodies of a kind, before and after a step.

    Attributes:
        before: [mm], shape (point_count, 3).
        velocity: before the step [mm/s], shape (point_count, 3).
        after: [mm], shape (point_count, 3).
        body_start: where each body's points begin, shape (body_count + 1,).
        largest: how far a point of each body got [mm], shape (body_count,).
    """

    before: Vectors
    velocity: Vectors
    after: Vectors
    body_start: Integers
    largest: Scalars


class InvertedElements(NamedTuple):
    """Elements of all soft bodies.

    Attributes:
        elements: corners, shape (element_count, 4).
        first_point: of a quadratic element, the first of its POINTS integration domains; -1 for others, whose
            corners tell, shape (element_count,).
        body_start: where each body's elements begin, shape (body_count + 1,).
        count: how many of each body's are turned inside out, shape (body_count,).
    """

    elements: IntegerTable
    first_point: Integers
    body_start: Integers
    count: Integers


@kernel
def largest_leaps(time_step: ti.f64, points: Points):
    """How far a point of each body got in a step, or got away from where its velocity led, whichever is less."""
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
    """Elements of each body whose corners span no positive volume, or where an integration point has none."""
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
