"""Trees of boxes over the triangles of every surface: update of the boxes, and search for boxes nearby."""

from typing import NamedTuple

from taichisoft.contact.kernels.surface_vertices import MovedSurfaces
from taichisoft.runtime.language import Integers, func, ti, vec3
from taichisoft.runtime.launch import kernel


class Trees(NamedTuple):
    """Binary trees of axis-parallel boxes, one per surface, with the nodes of all trees in one set of arrays.

    Nodes are in depth-first order: the first child of node n is n + 1, and `escape[n]` is the node after its last
    descendant, where a search that skips n continues without a stack. For a leaf `escape[n]` is n + 1.

    Every vertex and every edge that can touch belongs to one leaf, whose box contains it. The vertices of node n are
    `vertex[vertex_start[n] : vertex_start[n + 1]]`, likewise its triangles, corners and edges; empty for inner nodes.

    Attributes:
        root: first node of each surface, then the number of nodes, shape (surface_count + 1,).
        escape: node after the last descendant, shape (node_count,).
        triangle_start, triangle: triangles of each leaf.
        corner_start, corner: vertices of these triangles, each once.
        vertex_start, vertex: vertices that belong to each leaf and can touch.
        edge_start, edge: edges that belong to each leaf and can touch.
    """

    root: Integers
    escape: Integers
    triangle_start: Integers
    triangle: Integers
    corner_start: Integers
    corner: Integers
    vertex_start: Integers
    vertex: Integers
    edge_start: Integers
    edge: Integers


@kernel
def refit(surfaces: Integers, trees: Trees, moved: MovedSurfaces):
    """Update the boxes of `surfaces`: a leaf's box contains its corners, an inner node's box its children."""
    ti.loop_config(serialize=True)
    for k in range(surfaces.shape[0]):
        first, behind = trees.root[surfaces[k]], trees.root[surfaces[k] + 1]
        for backwards in range(behind - first):
            node = behind - 1 - backwards  # children come after their parents
            if trees.escape[node] == node + 1:
                low = moved.position[trees.corner[trees.corner_start[node]]]
                high = low
                for c in range(trees.corner_start[node] + 1, trees.corner_start[node + 1]):
                    p = moved.position[trees.corner[c]]
                    low = ti.min(low, p)
                    high = ti.max(high, p)
                moved.lower[node] = low
                moved.upper[node] = high
            else:
                second = trees.escape[node + 1]
                moved.lower[node] = ti.min(moved.lower[node + 1], moved.lower[second])
                moved.upper[node] = ti.max(moved.upper[node + 1], moved.upper[second])


@func
def meets(node: ti.i32, low: vec3, high: vec3, moved: MovedSurfaces) -> ti.i32:
    """Whether a node's box intersects the box from `low` to `high` [mm]."""
    return (moved.lower[node] <= high).all() and (moved.upper[node] >= low).all()


@func
def meets_beam(node: ti.i32, start: vec3, axis: vec3, radius: ti.f64, moved: MovedSurfaces) -> ti.i32:
    """Whether the ball around a node's box is within `radius` [mm] of the line through `start` along `axis`."""
    away = 0.5 * (moved.lower[node] + moved.upper[node]) - start
    across = away - away.dot(axis) * axis
    largest = radius + 0.5 * (moved.upper[node] - moved.lower[node]).norm()
    return across.norm_sqr() <= largest * largest


@func
def squared_distance(node: ti.i32, p: vec3, moved: MovedSurfaces) -> ti.f64:
    """Squared distance of a point from a node's box [mm^2]."""
    return ti.max(moved.lower[node] - p, p - moved.upper[node], 0.0).norm_sqr()


@func
def find_leaves(surface: ti.i32, low: vec3, high: vec3, trees: Trees, moved: MovedSurfaces, found: Integers) -> ti.i32:
    """Write the leaves of a surface that intersect the box from `low` to `high` to `found`; returns their number."""
    count = 0
    node = trees.root[surface]
    behind = trees.root[surface + 1]
    while node < behind:
        if meets(node, low, high, moved):
            if trees.escape[node] == node + 1:
                found[count] = node
                count += 1
            node += 1
        else:
            node = trees.escape[node]
    return count
