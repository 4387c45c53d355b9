"""Corner normals that are smooth over curved faces and keep edges sharp."""

import numpy as np


def split_at_creases(
    vertices: np.ndarray, triangles: np.ndarray, crease_angle: float = 40.0
) -> tuple[np.ndarray, np.ndarray]:
    """Give every triangle corner a vertex and a normal of its own.

    The normal of a corner is the area-weighted mean of those triangles at its vertex that are turned by
    less than `crease_angle` [degrees] against its own triangle.

    Args:
        vertices: [mm], shape (vertex_count, 3).
        triangles: vertex indices, shape (triangle_count, 3).

    Returns:
        Corner positions [mm] and unit normals, each (3 * triangle_count, 3); corner 3 i + k is corner k
        of triangle i.
    """
    corners = vertices[triangles]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    units = areas / np.maximum(np.linalg.norm(areas, axis=1, keepdims=True), 1e-30)
    first, second = _corners_at_same_vertex(triangles.ravel())
    smooth = np.einsum("ij,ij->i", units[first // 3], units[second // 3]) > np.cos(np.radians(crease_angle))
    normals = np.zeros((triangles.size, 3))
    np.add.at(normals, first[smooth], areas[second[smooth] // 3])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    return corners.reshape(-1, 3), normals


def _corners_at_same_vertex(vertex_of_corner: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """All ordered pairs of corners that share a vertex, each corner with itself too."""
    order = np.argsort(vertex_of_corner, kind="stable")
    _, start, count = np.unique(vertex_of_corner[order], return_index=True, return_counts=True)
    size = np.repeat(count, count)  # per sorted corner: how many corners its vertex has
    first = np.repeat(np.arange(len(order)), size)
    step = np.arange(len(first)) - np.repeat(np.cumsum(size) - size, size)
    second = np.repeat(np.repeat(start, count), size) + step
    return order[first], order[second]
