"""The mesh of a SOFA loader."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

# Scale, rotation and translation as SOFA's loaders and mechanical objects apply them, to the last bit.
#
# Rotations are about the fixed x, y and z axes, in this order. The last bit matters if a box selects nodes on its
# faces.


def rotation_matrix(degrees: Sequence[float]) -> np.ndarray:
    """Matrix (3, 3) of rotations about the x, y and z axes [degrees], by way of a quaternion as in SOFA."""
    x, y, z, w = quaternion(degrees)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (z * x + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (z * z + x * x), 2 * (y * z - x * w)],
            [2 * (z * x - y * w), 2 * (y * z + x * w), 1 - 2 * (y * y + x * x)],
        ]
    )


def quaternion(degrees: Sequence[float]) -> tuple[float, float, float, float]:
    """Unit quaternion (x, y, z, w) of rotations about the x, y and z axes [degrees]."""
    halves = [angle * math.pi / 180.0 / 2.0 for angle in degrees]
    (cx, cy, cz), (sx, sy, sz) = map(math.cos, halves), map(math.sin, halves)
    return (
        sx * cy * cz - cx * sy * sz,
        cx * sy * cz + sx * cy * sz,
        cx * cy * sz - sx * sy * cz,
        cx * cy * cz + sx * sy * sz,
    )


def multiply_quaternions(first: Sequence[float], second: Sequence[float]) -> np.ndarray:
    """Quaternion (x, y, z, w) of a rotation by `second`, then by `first`."""
    a, b = np.array(first[:3]), np.array(second[:3])
    return np.array([*(first[3] * b + second[3] * a + np.cross(a, b)), first[3] * second[3] - a @ b])


def placed(
    points: np.ndarray, scale: Sequence[float], rotation: Sequence[float], translation: Sequence[float]
) -> np.ndarray:
    """Points (count, 3) [mm] scaled, then rotated [degrees], then translated [mm]."""
    return _transformed(points, rotation_matrix(rotation) * np.asarray(scale), translation)


def placed_by_loader(
    points: np.ndarray, scale: Sequence[float], rotation: Sequence[float], translation: Sequence[float]
) -> np.ndarray:
    """Points transformed as by a loader: when it reads the file, and again at its initialisation.

    The second time it first inverts the first transformation, with round-off errors: a node of a rotated mesh that
    should lie on the plane z = 0 may lie 1e-30 below it, outside a box that ends there.
    """
    matrix = rotation_matrix(rotation) * np.asarray(scale)
    if (matrix == np.eye(3)).all() and not np.any(translation):
        return points
    inverse = _inverse(matrix)
    back = [-((row[0] * translation[0] + row[1] * translation[1]) + row[2] * translation[2]) for row in inverse]
    once = _transformed(points, matrix, translation)
    return _transformed(_transformed(once, inverse, back), matrix, translation)


def _transformed(points: np.ndarray, matrix: np.ndarray, shift: Sequence[float]) -> np.ndarray:
    x, y, z = np.asarray(points, dtype=np.float64).reshape(-1, 3).T
    return np.column_stack([((row[0] * x + row[1] * y) + row[2] * z) + s for row, s in zip(matrix, shift, strict=True)])


def _inverse(m: np.ndarray) -> np.ndarray:
    """Inverse by cofactors, with the round-off errors of SOFA instead of those by a factorisation."""
    determinant = (
        m[0, 0] * m[1, 1] * m[2, 2]
        + m[1, 0] * m[2, 1] * m[0, 2]
        + m[2, 0] * m[0, 1] * m[1, 2]
        - m[0, 0] * m[2, 1] * m[1, 2]
        - m[1, 0] * m[0, 1] * m[2, 2]
        - m[2, 0] * m[1, 1] * m[0, 2]
    )
    inverse = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            a, b, c, d = (j + 1) % 3, (j + 2) % 3, (i + 1) % 3, (i + 2) % 3
            inverse[i, j] = (m[a, c] * m[b, d] - m[b, c] * m[a, d]) / determinant
    return inverse


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
