"""Places in a soft body: nodes and elements selected by box, group or number, and points embedded in elements."""

from collections.abc import Sequence
from itertools import product
from typing import Literal

import numpy as np

from taichisoft.errors import SceneError
from taichisoft.mesh.surface import named_surfaces
from taichisoft.mesh.volume_mesh import VolumeMesh
from taichisoft.scene.soft_body import Anchor, NodalForce, NodeSelection, Selection, SoftBodySettings
from taichisoft.scene.table import Vector

# Points that follow a mesh: the element around each and its barycentric weights.

Embedding = Literal["deepest", "grid"]
"""Which elements are looked at for a point: all, or those near it."""

POINTS_AT_A_TIME = 64
# The least weight of a node for a point outside all elements: those further out magnify errors of the elements' motion.
SMALLEST_WEIGHT = -0.2
# A surface or cable that follows the mesh may stick out of it by this share of the body's largest extent: a coarse mesh
# cuts the corners of a fine surface.
EMBEDDING_MARGIN = 0.05
# A point on the boundary counts as inside: tolerance for the round-off of its barycentric weights.
ON_BOUNDARY = 1e-9


def embed(
    points: np.ndarray, nodes: np.ndarray, elements: np.ndarray, embedding: Embedding = "deepest"
) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and weights of each point in the tetrahedra, as SOFA's BarycentricMapping chooses them.

    The element in which the point lies deepest wins; a point outside all of them belongs to the element with
    the nearest centroid, with extrapolated weights. The two embeddings differ in points outside: "deepest" looks at all
    elements, as SOFA where the body is a MeshTopology, "grid" only at some nearby, as where it is a
    TetrahedronSetTopologyContainer, see `_Grid`.

    Args:
        points: [mm], shape (point_count, 3).
        nodes: [mm], shape (node_count, 3).
        elements: shape (element_count, 4).
        embedding: which elements are looked at.

    Returns:
        node indices and weights, both of shape (point_count, 4); a point outside has a negative weight.
    """
    tetrahedra = _Tetrahedra(nodes, elements)
    chosen, inner = np.empty(len(points), dtype=np.int64), np.empty((len(points), 3))
    if embedding == "grid":
        grid = _Grid(nodes, elements, tetrahedra)
        for k, point in enumerate(points):
            chosen[k], inner[k] = grid.find(point)
    else:
        for start in range(0, len(points), POINTS_AT_A_TIME):
            some = slice(start, start + POINTS_AT_A_TIME)
            chosen[some], inner[some] = tetrahedra.nearest(points[some])[:2]
    weights = np.column_stack([1.0 - inner.sum(axis=1), inner])
    return elements[chosen, :4].astype(np.int32), weights


def far_outside(points: np.ndarray, mesh: VolumeMesh) -> tuple[np.ndarray, str]:
    """Whether points [mm] lie outside the box around a mesh by more than the margin, and the box for a message."""
    lower, upper = mesh.nodes.min(axis=0), mesh.nodes.max(axis=0)
    margin = EMBEDDING_MARGIN * (upper - lower).max()
    outside = ((points < lower - margin) | (points > upper + margin)).any(axis=1)
    return outside, f"{np.round(lower, 3).tolist()} to {np.round(upper, 3).tolist()} mm"


class _Tetrahedra:
    """Elements, and how far points are from them."""

    def __init__(self, nodes: np.ndarray, elements: np.ndarray):
        self._origin = nodes[elements[:, 0]]
        self._to_local = np.linalg.inv((nodes[elements[:, 1:]] - self._origin[:, None]).transpose(0, 2, 1))
        self._centroid = nodes[elements].mean(axis=1)

    def nearest(
        self, points: np.ndarray, some: np.ndarray | slice = slice(None)
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The best of some elements for each point: its place among them, the last three weights, and its measure.

        The measure is the largest negative of the weights where the point is inside (0 on the boundary, lower is
        deeper), else the squared distance from the centroid [mm^2].
        """
        local = np.einsum("eij,pej->pei", self._to_local[some], points[:, None] - self._origin[some])
        outside = np.maximum(-local.min(axis=2), local.sum(axis=2) - 1.0)
        distance = ((points[:, None] - self._centroid[some]) ** 2).sum(axis=2)
        measure = np.where(outside > ON_BOUNDARY, distance, outside)
        element = measure.argmin(axis=1)
        point = np.arange(len(points))
        return element, local[point, element], measure[point, element]


class _Grid:
    """Cubic cells from the origin on, as wide as the mean edge is long, with the elements whose boxes meet each.

    A point is compared with the elements of its own cell; with the elements of the cells around it, too, if the best
    measure exceeds half the width of a cell, although it may be a squared length; with all if its own cell has none.
    """

    def __init__(self, nodes: np.ndarray, elements: np.ndarray, tetrahedra: _Tetrahedra):
        self._tetrahedra = tetrahedra
        pairs = elements[:, [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]]].reshape(-1, 2)
        first, second = np.unique(np.sort(pairs, axis=1), axis=0).T
        self._width = float(np.linalg.norm(nodes[first] - nodes[second], axis=1).mean())
        self._cells: dict[tuple[int, ...], list[int]] = {}
        lower, upper = self._cell(nodes[elements].min(axis=1)), self._cell(nodes[elements].max(axis=1))
        for element, (low, high) in enumerate(zip(lower.tolist(), upper.tolist(), strict=True)):
            for cell in product(*(range(a, b + 1) for a, b in zip(low, high, strict=True))):
                self._cells.setdefault(cell, []).append(element)

    def find(self, point: np.ndarray) -> tuple[int, np.ndarray]:
        """The element of a point [mm], shape (3,), and the last three weights."""
        x, y, z = self._cell(point).tolist()
        own = self._cells.get((x, y, z))
        if own is None:
            element, inner, _ = self._tetrahedra.nearest(point[None])
            return int(element[0]), inner[0]
        candidates = np.array(own)
        element, inner, measure = self._tetrahedra.nearest(point[None], candidates)
        if abs(measure[0]) > 0.5 * self._width:
            around = product((x - 1, x, x + 1), (y - 1, y, y + 1), (z - 1, z, z + 1))
            candidates = np.unique(np.concatenate([self._cells.get(cell, []) for cell in around])).astype(np.int64)
            element, inner, _ = self._tetrahedra.nearest(point[None], candidates)
        return int(candidates[element[0]]), inner[0]

    def _cell(self, points: np.ndarray) -> np.ndarray:
        return np.floor(points / self._width).astype(np.int64)


# Nodes and elements of a mesh that a scene selects by box or by group, nodes also by their numbers.

# A node on the face of a box belongs to it: tolerance for the last digit of a coordinate in a file [mm].
BOX_TOLERANCE = 1e-9


def select_nodes(mesh: VolumeMesh, selection: NodeSelection, key: str) -> np.ndarray:
    """Indices, in rising order, of the nodes inside the box, of the group's nodes, or those named by their numbers.

    Raises:
        SceneError: nothing is selected, or the mesh has no such group or node; `key` begins the error.
    """
    if selection.nodes is not None:
        highest = max(selection.nodes)
        if highest >= len(mesh.nodes):
            raise SceneError(f"{key}.nodes names node {highest}; {mesh.source} has nodes 0 to {len(mesh.nodes) - 1}")
        return np.sort(selection.nodes)
    if selection.box is not None:
        selected = np.flatnonzero(_inside(mesh.nodes, selection.box))
        return _not_empty(selected, _box_key(key, selection.box), "node", mesh.nodes, mesh)
    return np.unique(_group(mesh, selection.group or "", key, surfaces=True))


def anchor_stiffness(mesh: VolumeMesh, anchors: Sequence[Anchor], key: str) -> np.ndarray:
    """Stiffness of the spring at each node along x, y and z [mN/mm], 0 where there is none, shape (node_count, 3).

    Where two anchors hold a node along the same axis, the later one does.

    Raises:
        SceneError: an anchor selects nothing; `key` begins the error.
    """
    stiffness = np.zeros((len(mesh.nodes), 3))
    for index, anchor in enumerate(anchors):
        nodes = select_nodes(mesh, anchor, f"{key}.{index}")
        for direction in anchor.directions:
            stiffness[nodes, "xyz".index(direction)] = anchor.stiffness
    return stiffness


def anchor_frames(mesh: VolumeMesh, body: SoftBodySettings, key: str) -> np.ndarray:
    """Name of the frame that each anchored node moves with, "" of others, shape (node_count,).

    Raises:
        SceneError: two anchors hold a node at different frames; `key` begins the error.
    """
    frames = np.full(len(mesh.nodes), "", dtype=object)
    for index, anchor in enumerate(body.anchors):
        nodes, frame = select_nodes(mesh, anchor, f"{key}.{index}"), anchor.follows or body.follows
        shared = nodes[(frames[nodes] != "") & (frames[nodes] != frame)]
        if shared.size:
            raise SceneError(
                f"{key}.{index} holds node {shared[0]} at the frame '{frame}', and an anchor before it at "
                f"'{frames[shared[0]]}' ({shared.size} such nodes); a node moves with one frame: select apart"
            )
        frames[nodes] = frame
    return frames


def nodal_forces(mesh: VolumeMesh, forces: Sequence[NodalForce], key: str) -> np.ndarray:
    """Sum of the constant forces on each node [mN], shape (node_count, 3)."""
    total = np.zeros((len(mesh.nodes), 3))
    for index, force in enumerate(forces):
        nodes = select_nodes(mesh, force, f"{key}.{index}")
        total[nodes] += np.array(force.force) / len(nodes)
    return total


def select_elements(mesh: VolumeMesh, selection: Selection, key: str) -> np.ndarray:
    """Indices of the elements whose mean of nodes lies inside the box, or of the element group."""
    if selection.box is not None:
        means = mesh.nodes[mesh.elements].mean(axis=1)
        selected = np.flatnonzero(_inside(means, selection.box))
        return _not_empty(selected, _box_key(key, selection.box), "element", means, mesh)
    return _group(mesh, selection.group or "", key, surfaces=False)


def surface_group(mesh: VolumeMesh, name: str, key: str) -> np.ndarray:
    """Triangles (count, 3) of a named surface of the mesh."""
    surfaces = mesh.surface_groups if name in mesh.surface_groups else named_surfaces(mesh)
    if name not in surfaces:
        known = ", ".join(sorted(surfaces)) or "none"
        raise SceneError(f"{key}.group = '{name}': {mesh.source} has no such surface group; there are: {known}")
    return surfaces[name]


def _group(mesh: VolumeMesh, name: str, key: str, surfaces: bool) -> np.ndarray:
    if surfaces and name in mesh.surface_groups:
        return mesh.surface_groups[name].reshape(-1)
    if surfaces and name not in mesh.element_groups and (surface := named_surfaces(mesh).get(name)) is not None:
        return surface.reshape(-1)
    if name in mesh.element_groups:
        elements = mesh.element_groups[name]
        return mesh.elements[elements].reshape(-1) if surfaces else elements
    known = sorted({*mesh.element_groups, *(mesh.surface_groups if surfaces else ())})
    raise SceneError(
        f"{key}.group = '{name}': {mesh.source} has no such group; there are: {', '.join(known) or 'none'}"
    )


def _box_key(key: str, box: tuple[Vector, Vector]) -> str:
    return f"{key}.box = {[list(corner) for corner in box]}"


def _inside(points: np.ndarray, box: tuple) -> np.ndarray:
    lower, upper = np.asarray(box)
    return ((points >= lower - BOX_TOLERANCE) & (points <= upper + BOX_TOLERANCE)).all(axis=1)


def _not_empty(selected: np.ndarray, key: str, what: str, points: np.ndarray, mesh: VolumeMesh) -> np.ndarray:
    if not len(selected):
        lower, upper = points.min(axis=0), points.max(axis=0)
        raise SceneError(
            f"{key}: selects no {what} of {mesh.source}, whose {what}s span "
            f"{np.round(lower, 3).tolist()} to {np.round(upper, 3).tolist()} mm"
        )
    return selected
