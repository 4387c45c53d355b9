"""Lengths, edges and angles of triangulated surfaces."""

import numpy as np

NEAR = 1e-6
"""Distance at which points count as one, as a share of the surface's diagonal [-]. Single precision, which STL has,
rounds coordinates to a tenth of it."""


def diagonal(vertices: np.ndarray) -> float:
    """Length of the diagonal of the box around the vertices [mm]."""
    return float(np.linalg.norm(np.ptp(vertices, axis=0)))


def area_vectors(corners: np.ndarray) -> np.ndarray:
    """Normals of triangles with these corners [mm], shape (count, 3, 3), as long as twice their areas [mm^2]."""
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def undirected_sides(triangles: np.ndarray) -> np.ndarray:
    """The sides of all triangles, the lower vertex first, shape (3 * triangle_count, 2)."""
    return np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)


def joined_sides(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The edges of a closed surface, and the two sides of triangles that each joins.

    Returns:
        Edges as vertex indices, the lower first, shape (edge_count, 2), and sides, shape (edge_count, 2): side s of
        triangle t, from its corner s to the next, has the number 3 * t + s; the lower number stands first.
    """
    edges, edge = np.unique(undirected_sides(triangles), axis=0, return_inverse=True)
    return edges, np.argsort(edge.ravel(), kind="stable").reshape(-1, 2)


def facing_sides(triangles: np.ndarray) -> np.ndarray:
    """The pairs of sides, numbered as in `joined_sides`, at edges of exactly two triangles, shape (pair_count, 2)."""
    _, edge, counts = np.unique(undirected_sides(triangles), axis=0, return_inverse=True, return_counts=True)
    edge = edge.ravel()
    two = np.flatnonzero(counts[edge] == 2)
    pairs: np.ndarray = two[np.argsort(edge[two], kind="stable")].reshape(-1, 2)
    return pairs


def angles_between(normals: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Angles [rad] between the normals, shape (triangle_count, 3), of pairs of triangles, shape (pair_count, 2)."""
    one, other = normals[pairs[:, 0]], normals[pairs[:, 1]]
    return np.arctan2(np.linalg.norm(np.cross(one, other), axis=1), np.einsum("nd,nd->n", one, other))
