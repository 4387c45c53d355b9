"""Which elements are turned inside out."""

from taichisoft.kernels.launch import kernel
from taichisoft.kernels.runtime import Integers, IntegerTable, Vectors, ti


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
