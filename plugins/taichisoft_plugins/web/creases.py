"""Smooth shading with sharp edges, for a renderer that averages the normals of each vertex by itself."""

import numpy as np

CREASE_ANGLE = 40.0
"""Faces that meet at a sharper angle [degrees] keep the edge between them."""


def split_creases(vertices: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Give a vertex on a crease one copy per smooth part of the surface around it.

    A surface that deforms is split once; copy i is then always where vertex `source[i]` is.

    Args:
        vertices: [mm], shape (vertex_count, 3).
        triangles: vertex indices, shape (triangle_count, 3).

    Returns:
        `source`, vertex of each copy, shape (copy_count,), and triangles of copies, shape (triangle_count, 3).
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    corners = vertices[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    # Corner 3 i + k is corner k of triangle i; each edge is listed with the corner at its lower vertex first.
    start = np.arange(triangles.size)
    stop = start.reshape(-1, 3)[:, [1, 2, 0]].ravel()
    at = triangles.ravel()
    swap = at[start] > at[stop]
    low, high = np.where(swap, stop, start), np.where(swap, start, stop)
    order = np.lexsort((at[high], at[low]))
    low, high = low[order], high[order]
    same = (at[low][1:] == at[low][:-1]) & (at[high][1:] == at[high][:-1])
    first, second = np.flatnonzero(same), np.flatnonzero(same) + 1
    cosine = np.einsum("ij,ij->i", normals[low[first] // 3], normals[low[second] // 3])
    smooth = cosine > np.cos(np.radians(CREASE_ANGLE))
    first, second = first[smooth], second[smooth]
    one, other = np.concatenate([low[first], high[first]]), np.concatenate([low[second], high[second]])
    joined = coo_matrix((np.ones(len(one)), (one, other)), shape=(triangles.size, triangles.size))
    count, copy = connected_components(joined, directed=False)
    source = np.empty(count, dtype=np.int64)
    source[copy] = at
    return source, copy.reshape(-1, 3)
