"""Smooth shading with sharp edges, for a renderer that averages the normals of each vertex by itself."""

import numpy as np

from taichisoft_plugins.drawing.shading import corners_at_same_vertex, face_alike


def split_creases(vertices: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Give a vertex on a crease one copy per smooth part of the surface around it.

    A surface that deforms is split once; copy i is then always where vertex `source[i]` is.

    Args:
        vertices: positions [mm], shape (vertex_count, 3).
        triangles: vertex indices, shape (triangle_count, 3).

    Returns:
        `source`, vertex of each copy, shape (copy_count,), and triangles of copies, shape (triangle_count, 3).
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    corners = vertices[triangles]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    one, other = corners_at_same_vertex(triangles.ravel())
    smooth = face_alike(areas, one // 3, other // 3)
    joined = coo_matrix((np.ones(smooth.sum()), (one[smooth], other[smooth])), shape=(triangles.size, triangles.size))
    count, copy = connected_components(joined, directed=False)
    source = np.empty(count, dtype=np.int64)
    source[copy] = triangles.ravel()
    return source, copy.reshape(-1, 3)
