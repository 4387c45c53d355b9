"""How curved a triangulated surface is, from the angles between its triangles."""

import numpy as np

from taichisoft_meshing.bodies.closed_shells import undirected_sides


def vertex_curvatures(vertices: np.ndarray, triangles: np.ndarray, feature_angle: float) -> np.ndarray:
    """The larger principal curvature at each vertex, about [1/mm], shape (vertex_count,); sharp edges do not count.

    Every edge gives the angle across it times its length, in its direction: a tensor. Over the area around a vertex its
    eigenvalues are the principal curvatures (Cohen-Steiner and Morvan 2003).

    Args:
        vertices: [mm], shape (vertex_count, 3).
        triangles: of a closed surface, shape (triangle_count, 3).
        feature_angle: two triangles with a larger angle between them [rad] meet in a sharp edge.
    """
    corners = vertices[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    edges, edge = np.unique(undirected_sides(triangles), axis=0, return_inverse=True)
    one, other = (np.argsort(edge.ravel(), kind="stable").reshape(-1, 2) // 3).T
    across = np.linalg.norm(np.cross(normals[one], normals[other]), axis=1)
    angles = np.arctan2(across, np.einsum("nd,nd->n", normals[one], normals[other]))
    along = np.subtract(*vertices[edges.T])
    lengths = np.linalg.norm(along, axis=1)
    bent = np.where(angles < feature_angle, angles, 0.0) / lengths
    tensors = np.zeros((len(vertices), 3, 3))
    for end in edges.T:  # half of the angle to either
        np.add.at(tensors, end, 0.5 * np.einsum("e,ei,ej->eij", bent, along, along))
    areas = np.linalg.norm(normals, axis=1) / 6  # a third to each corner
    around = np.bincount(triangles.ravel(), np.repeat(areas, 3), len(vertices))
    largest: np.ndarray = np.linalg.eigvalsh(tensors)[:, -1]
    return largest / around
