"""Smooth normals of surfaces, and how bright a surface is where its normal points.

There is a high key light, and light from all around, more of it from above.
"""

import numpy as np

from taichisoft import Scene
from taichisoft_outputs.drawing.camera import scene_axes

KEY_LIGHT = (0.55, 0.75, 1.25)
"""Direction to the usual key light in the axes (right, front, up) of `camera.scene_axes`: in front, from the right."""

DARKEST, KEY_STRENGTH, SKY_STRENGTH = 0.44, 0.44, 0.12
"""Brightness of what is turned away, and what the two lights add at most; together 1 [-]."""


CREASE_ANGLE = 40.0
"""Faces that meet at a sharper angle [degrees] keep the edge between them."""


class SmoothNormals:
    """Gives every triangle corner a vertex and a normal of its own, as its surface deforms.

    The normal of a corner is the area-weighted mean of the triangles at its vertex that are turned by less than
    CREASE_ANGLE against its own triangle: curved faces are smooth, and edges stay sharp.

    Args:
        triangles: vertex indices, outward, shape (triangle_count, 3).
    """

    def __init__(self, triangles: np.ndarray):
        self._triangles = triangles
        # The pairs do not change while the surface deforms; finding them takes longer than all the rest.
        self._corners, others = corners_at_same_vertex(triangles.ravel())
        self._own, self._other = self._corners // 3, others // 3

    def __call__(self, vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Corners and normals for vertices [mm] of shape (vertex_count, 3).

        Returns:
            Corner positions [mm] and unit normals, each (3 * triangle_count, 3); corner 3 i + k is corner k of
            triangle i.
        """
        corners = vertices[self._triangles]
        areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        smooth = face_alike(areas, self._own, self._other)
        where, what = self._corners[smooth], areas[self._other[smooth]]
        normals = np.stack([np.bincount(where, part, self._triangles.size) for part in what.T], axis=1)
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        return corners.reshape(-1, 3), normals / np.maximum(lengths, 1e-30)


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


def face_alike(areas: np.ndarray, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Whether triangles `one` and `other`, shape (count,), are turned against each other by less than CREASE_ANGLE.

    Args:
        areas: a vector along the normal of each triangle, of any length, shape (triangle_count, 3).
        one, other: indices of triangles, shape (count,).
    """
    units = areas / np.maximum(np.linalg.norm(areas, axis=1, keepdims=True), 1e-30)
    return np.einsum("ij,ij->i", units[one], units[other]) > np.cos(np.radians(CREASE_ANGLE))


def corners_at_same_vertex(vertex_of_corner: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """All ordered pairs of corners that share a vertex, each corner with itself too."""
    order = np.argsort(vertex_of_corner, kind="stable")
    _, start, count = np.unique(vertex_of_corner[order], return_index=True, return_counts=True)
    size = np.repeat(count, count)  # per sorted corner: how many corners its vertex has
    first = np.repeat(np.arange(len(order)), size)
    step = np.arange(len(first)) - np.repeat(np.cumsum(size) - size, size)
    second = np.repeat(np.repeat(start, count), size) + step
    return order[first], order[second]


def key_light(scene: Scene) -> np.ndarray:
    """Unit vector to the key light of a scene, shape (3,)."""
    chosen = scene.appearance.light
    key = np.array(KEY_LIGHT) @ scene_axes(scene.up) if chosen is None else np.array(chosen)
    return key / np.linalg.norm(key)


def shade(colours: np.ndarray, normals: np.ndarray, key: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Colours as they appear in the light, shape (count, 3).

    Args:
        colours: red, green and blue [-], shape (3,) or (count, 3).
        normals: unit normals, shape (count, 3).
        key: unit vector to the key light, shape (3,).
        up: unit vector against gravity, shape (3,).
    """
    # Half of the light reaches around what it falls on, so that no side that is turned away looks flat.
    from_key = (0.5 + 0.5 * normals @ key) ** 1.5
    from_sky = 0.5 + 0.5 * normals @ up
    return colours * (DARKEST + KEY_STRENGTH * from_key + SKY_STRENGTH * from_sky)[:, None]
