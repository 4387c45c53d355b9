"""Contact features: all vertices and edges of soft surfaces, on other surfaces those not inside a flat face."""

import numpy as np

from taichisoft.contact.kernels.surface_vertices import Carriers, Surfaces
from taichisoft.runtime.language import SOFT

# On an undeformable body, faces whose normals differ by less than this angle from the first face's normal form one
# plane facet [rad]; an edge inside a facet touches nothing that the facet does not touch.
FLAT_ANGLE = 0.02


# A vertex represents a round surface if the normals of its faces differ by less than this angle from their mean [rad].
ROUND_ANGLE = 0.05


def find_round_vertices(topology: Surfaces, carriers: Carriers) -> np.ndarray:
    """Whether each vertex of an undeformable surface represents a round surface, shape (vertex_count,)."""
    corners = carriers.local[topology.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    mean = np.zeros_like(carriers.local)
    for corner in range(3):
        np.add.at(mean, topology.triangles[:, corner], normals)
    mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-300)
    least = np.ones(len(mean))
    for corner in range(3):
        vertex = topology.triangles[:, corner]
        np.minimum.at(least, vertex, np.einsum("td,td->t", mean[vertex], normals))
    return least > np.cos(ROUND_ANGLE)


def find_features(topology: Surfaces, carriers: Carriers, is_smooth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Whether each vertex and each edge may touch other surfaces, shapes (vertex_count,) and (edge_count,).

    Vertices of smooth surfaces, `is_smooth`, shape (vertex_count,), and their edges are not features.
    """
    edges, edge_triangles, position = topology.edges, topology.edge_triangles, carriers.local
    facet = _find_facets(topology, carriers)[edge_triangles]
    is_edge = (carriers.owner[edges[:, 0]] == SOFT) | (facet[:, 0] != facet[:, 1]) | (edge_triangles[:, 1] < 0)
    is_edge &= ~is_smooth[edges[:, 0]]
    # A corner joins edges of at least two directions.
    along = position[edges[:, 1]] - position[edges[:, 0]]
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300)  # edges of length 0
    spread = np.zeros((len(position), 3, 3))
    for end in (0, 1):
        np.add.at(spread, edges[is_edge, end], along[is_edge, :, None] * along[is_edge, None, :])
    middle_direction = np.linalg.eigvalsh(spread)[:, 1]
    return ((carriers.owner == SOFT) | (middle_direction > FLAT_ANGLE**2)) & ~is_smooth, is_edge


def _find_facets(topology: Surfaces, carriers: Carriers) -> np.ndarray:
    """Number of the plane facet of each triangle of an undeformable surface, -1 on soft ones, (triangle_count,).

    A facet grows over neighbours whose normals differ from the normal of its first triangle by less than FLAT_ANGLE.
    With the neighbour's normal instead, a finely triangulated ball would be one facet without an edge.
    """
    corners = carriers.local[topology.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)  # triangles of area 0
    facet = np.full(len(corners), -1)
    keeps_shape = carriers.owner[topology.triangles[:, 0]] != SOFT
    neighbours: list[list[int]] = [[] for _ in corners]
    for first, second in topology.edge_triangles[topology.edge_triangles[:, 1] >= 0].tolist():
        neighbours[first].append(second)
        neighbours[second].append(first)
    for number, seed in enumerate(np.flatnonzero(keeps_shape).tolist()):
        if facet[seed] >= 0:
            continue
        facet[seed] = number
        grown = [seed]
        while grown:
            for neighbour in neighbours[grown.pop()]:
                if facet[neighbour] < 0 and normals[neighbour] @ normals[seed] > np.cos(FLAT_ANGLE):
                    facet[neighbour] = number
                    grown.append(neighbour)
    return facet
