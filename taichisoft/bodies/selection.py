"""Nodes and elements of a mesh that a scene selects by box or by group, nodes also by their numbers."""

from collections.abc import Sequence

import numpy as np

from taichisoft.errors import SceneError
from taichisoft.meshes.volume_mesh import VolumeMesh
from taichisoft.scenes.soft_body import Anchor, NodalForce, NodeSelection, Selection
from taichisoft.scenes.table import Vector

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


def nodal_forces(mesh: VolumeMesh, forces: Sequence[NodalForce], key: str) -> np.ndarray:
    """Sum of the constant forces on each node [mN], shape (node_count, 3).

    Raises:
        SceneError: a force selects nothing; `key` begins the error.
    """
    total = np.zeros((len(mesh.nodes), 3))
    for index, force in enumerate(forces):
        nodes = select_nodes(mesh, force, f"{key}.{index}")
        total[nodes] += np.array(force.force) / len(nodes)
    return total


def select_elements(mesh: VolumeMesh, selection: Selection, key: str) -> np.ndarray:
    """Indices of the elements whose mean of nodes lies inside the box, or of the element group.

    Raises:
        SceneError: nothing is selected, or the mesh has no such group.
    """
    if selection.box is not None:
        means = mesh.nodes[mesh.elements].mean(axis=1)
        selected = np.flatnonzero(_inside(means, selection.box))
        return _not_empty(selected, _box_key(key, selection.box), "element", means, mesh)
    return _group(mesh, selection.group or "", key, surfaces=False)


def surface_group(mesh: VolumeMesh, name: str, key: str) -> np.ndarray:
    """Triangles (count, 3) of a named surface of the mesh.

    Raises:
        SceneError: the mesh has no such surface group.
    """
    if name not in mesh.surface_groups:
        known = ", ".join(sorted(mesh.surface_groups)) or "none"
        raise SceneError(f"{key}.group = '{name}': {mesh.source} has no such surface group; there are: {known}")
    return mesh.surface_groups[name]


def _group(mesh: VolumeMesh, name: str, key: str, surfaces: bool) -> np.ndarray:
    if surfaces and name in mesh.surface_groups:
        return mesh.surface_groups[name].reshape(-1)
    if name in mesh.element_groups:
        elements = mesh.element_groups[name]
        return mesh.elements[elements].reshape(-1) if surfaces else elements
    known = sorted({*mesh.element_groups, *(mesh.surface_groups if surfaces else ())})
    raise SceneError(
        f"{key}.group = '{name}': {mesh.source} has no such group; there are: {', '.join(known) or 'none'}"
    )


def _box_key(key: str, box: tuple[Vector, Vector]) -> str:
    """The box as the scene file has it."""
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
