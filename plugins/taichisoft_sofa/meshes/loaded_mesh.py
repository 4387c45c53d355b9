"""The mesh of a SOFA loader."""

from dataclasses import dataclass, field

import numpy as np


def no_cells(corners: int) -> np.ndarray:
    """An empty array of cells, shape (0, corners)."""
    return np.zeros((0, corners), dtype=np.int64)


@dataclass(frozen=True)
class LoadedMesh:
    """Points and cells in the order of the file.

    Attributes:
        points: positions [mm], shape (point_count, 3).
        edges: point indices, shape (edge_count, 2).
        triangles: point indices, shape (triangle_count, 3).
        quads: point indices, shape (quad_count, 4).
        tetrahedra: point indices, shape (tetrahedron_count, 4).
        hexahedra: point indices, shape (hexahedron_count, 8).
    """

    points: np.ndarray
    edges: np.ndarray = field(default_factory=lambda: no_cells(2))
    triangles: np.ndarray = field(default_factory=lambda: no_cells(3))
    quads: np.ndarray = field(default_factory=lambda: no_cells(4))
    tetrahedra: np.ndarray = field(default_factory=lambda: no_cells(4))
    hexahedra: np.ndarray = field(default_factory=lambda: no_cells(8))


def split_quads(quads: np.ndarray) -> np.ndarray:
    """Split each quad in two triangles, shape (2 * quad_count, 3)."""
    return quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)
