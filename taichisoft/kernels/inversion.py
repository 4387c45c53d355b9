"""How far the nodes of bodies moved in a step, and which elements are turned inside out."""

from taichisoft.kernels.launch import kernel
from taichisoft.kernels.runtime import Integers, IntegerTable, Scalars, ti, vec3


@ti.func
def node(position: Scalars, index: ti.i32) -> vec3:
    return vec3(position[3 * index], position[3 * index + 1], position[3 * index + 2])


@kernel
def count_inverted(elements: IntegerTable, position: Scalars, body_start: Integers, inverted: Integers):
    """Elements of each body whose first four corners span no positive volume."""
    ti.loop_config(serialize=True)
    for body in range(inverted.shape[0]):
        count = 0
        for e in range(body_start[body], body_start[body + 1]):
            origin = node(position, elements[e, 0])
            first, second = node(position, elements[e, 1]) - origin, node(position, elements[e, 2]) - origin
            if first.cross(second).dot(node(position, elements[e, 3]) - origin) <= 0.0:
                count += 1
        inverted[body] = count
