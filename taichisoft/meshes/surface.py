"""Closed triangulated surfaces: are they closed, and which way do they face."""

import warnings

import numpy as np

from taichisoft.errors import MeshError
from taichisoft.meshes.mapped_surface import enclosed_volume


def closed_outward(vertices: np.ndarray, triangles: np.ndarray, source: str) -> np.ndarray:
    """The triangles of a closed surface, turned round with a warning when it is inside out.

    Args:
        vertices: [mm], shape (vertex_count, 3).
        triangles: vertex indices, shape (triangle_count, 3).
        source: begins the error and the warning.

    Raises:
        MeshError: the surface is not closed, or encloses no volume.
    """
    open_edges = count_open_edges(triangles)
    if open_edges:
        raise MeshError(
            f"{source}: is not closed: {open_edges} edges do not join exactly two triangles of one "
            "orientation; fill the holes and merge equal vertices"
        )
    volume = enclosed_volume(vertices, triangles)
    if volume == 0.0:
        raise MeshError(f"{source}: encloses no volume")
    if volume < 0.0:
        warnings.warn(f"{source}: is inside out; its triangles are turned round", stacklevel=2)
        return np.ascontiguousarray(triangles[:, ::-1])
    return triangles


def count_open_edges(triangles: np.ndarray) -> int:
    """Number of directed edges that do not occur exactly once with exactly one opposite."""
    edges = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64)
    size = int(triangles.max()) + 1 if len(triangles) else 1
    forward, counts = np.unique(edges @ [size, 1], return_counts=True)
    backward = edges @ [1, size]
    return int((counts != 1).sum() + (~np.isin(backward, forward)).sum())
