"""What tells that a step went wrong: nodes that leap, elements that are turned inside out."""

from taichisoft.kernels.launch import kernel
from taichisoft.kernels.runtime import Integers, IntegerTable, Scalars, Vectors, ti


@kernel
def largest_leaps(
    time_step: ti.f64, before: Vectors, velocity: Vectors, after: Vectors, body_start: Integers, largest: Scalars
):
    """How far a point of each body got in a step, or got away from where its velocity led, whichever is less."""
    ti.loop_config(serialize=True)
    for body in range(largest.shape[0]):
        most = 0.0
        for i in range(body_start[body], body_start[body + 1]):
            move = after[i] - before[i]
            surprise = move - time_step * velocity[i]
            for d in ti.static(range(3)):
                most = ti.max(most, ti.min(ti.abs(move[d]), ti.abs(surprise[d])))
        largest[body] = most


@kernel
def count_inverted(elements: IntegerTable, position: Vectors, body_start: Integers, inverted: Integers):
    """Elements of each body whose first four corners span no positive volume."""
    ti.loop_config(serialize=True)
    for body in range(inverted.shape[0]):
        count = 0
        for e in range(body_start[body], body_start[body + 1]):
            origin = position[elements[e, 0]]
            first, second = position[elements[e, 1]] - origin, position[elements[e, 2]] - origin
            if first.cross(second).dot(position[elements[e, 3]] - origin) <= 0.0:
                count += 1
        inverted[body] = count
