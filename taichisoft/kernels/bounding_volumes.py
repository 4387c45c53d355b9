"""Trees of boxes: boxes that follow the vertices, and a search for the leaves near a box.

The layout of the trees stands in `taichisoft.contact.bounding_volumes`.
"""

from taichisoft.kernels.launch import kernel
from taichisoft.kernels.runtime import Integers, Vectors, ti, vec3


@kernel
def refit(
    surfaces: Integers,
    root: Integers,
    escape: Integers,
    corner_start: Integers,
    corner: Integers,
    position: Vectors,
    lower: Vectors,
    upper: Vectors,
):
    """Boxes of the given surfaces: of leaves around their vertices, of other nodes around their children."""
    ti.loop_config(serialize=True)
    for k in range(surfaces.shape[0]):
        first, behind = root[surfaces[k]], root[surfaces[k] + 1]
        for backwards in range(behind - first):
            node = behind - 1 - backwards  # children stand behind their parents
            if escape[node] == node + 1:
                low = position[corner[corner_start[node]]]
                high = low
                for c in range(corner_start[node] + 1, corner_start[node + 1]):
                    p = position[corner[c]]
                    low = ti.min(low, p)
                    high = ti.max(high, p)
                lower[node] = low
                upper[node] = high
            else:
                second = escape[node + 1]
                lower[node] = ti.min(lower[node + 1], lower[second])
                upper[node] = ti.max(upper[node + 1], upper[second])


@ti.func
def meets(node: ti.i32, low: vec3, high: vec3, lower: Vectors, upper: Vectors) -> ti.i32:
    """Whether a node's box meets the box from `low` to `high`."""
    return (lower[node] <= high).all() and (upper[node] >= low).all()


@ti.func
def meets_beam(node: ti.i32, start: vec3, axis: vec3, radius: ti.f64, lower: Vectors, upper: Vectors) -> ti.i32:
    """Whether the ball around a node's box comes closer than `radius` to the line through `start` along `axis`."""
    away = 0.5 * (lower[node] + upper[node]) - start
    across = away - away.dot(axis) * axis
    largest = radius + 0.5 * (upper[node] - lower[node]).norm()
    return across.norm_sqr() <= largest * largest


@ti.func
def squared_distance(node: ti.i32, p: vec3, lower: Vectors, upper: Vectors) -> ti.f64:
    """Of a point from a node's box [mm^2]."""
    return ti.max(lower[node] - p, p - upper[node], 0.0).norm_sqr()


@ti.func
def find_leaves(
    surface: ti.i32,
    low: vec3,
    high: vec3,
    root: Integers,
    escape: Integers,
    lower: Vectors,
    upper: Vectors,
    found: Integers,
) -> ti.i32:
    """List the leaves of a surface that meet the box from `low` to `high` in `found`; returns how many."""
    count = 0
    node = root[surface]
    behind = root[surface + 1]
    while node < behind:
        if meets(node, low, high, lower, upper):
            if escape[node] == node + 1:
                found[count] = node
                count += 1
            node += 1
        else:
            node = escape[node]
    return count
