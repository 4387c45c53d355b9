"""Points and cells inside the boxes and spheres of SOFA's ROI engines."""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

Inside = Callable[[np.ndarray], np.ndarray]
"""Predicate: which of the points [mm], shape (count, 3), lie in a region, shape (count,)."""


def in_boxes(boxes: ArrayLike) -> Inside:
    """Make the predicate of boxes of six numbers, two opposite corners; includes their faces, to the last bit."""
    corners = np.asarray(boxes, dtype=np.float64).reshape(-1, 2, 3)
    lower, upper = corners.min(axis=1), corners.max(axis=1)

    def inside(points: np.ndarray) -> np.ndarray:
        apart = points[:, None]
        return ((apart >= lower) & (apart <= upper)).all(axis=2).any(axis=1)

    return inside


def in_oriented_boxes(boxes: ArrayLike) -> Inside:
    """Make the predicate of boxes of ten numbers: three consecutive corners of a rectangle, and a depth.

    The first and third corners are opposite; half of the depth is on each side of the rectangle.
    """
    rows = np.asarray(boxes, dtype=np.float64).reshape(-1, 10)

    def inside(points: np.ndarray) -> np.ndarray:
        found = np.zeros(len(points), dtype=bool)
        for row in rows:
            first, second, third, depth = row[:3], row[3:6], row[6:9], row[9]
            along, across = second - first, third - second
            normal = np.cross(along, across)
            middle = (first + third) / 2.0
            axes = np.stack([v / np.linalg.norm(v) for v in (along, np.cross(normal, along), normal)])
            across_length = abs(across @ axes[1])
            half = np.array([np.linalg.norm(along), across_length, depth]) / 2.0
            found |= (np.abs((points - middle) @ axes.T) <= half).all(axis=1)
        return found

    return inside


def in_spheres(centres: ArrayLike, radii: ArrayLike) -> Inside:
    """Make the predicate of spheres, including their surfaces; a single radius holds for all."""
    middle = np.asarray(centres, dtype=np.float64).reshape(-1, 3)
    reach = np.broadcast_to(np.asarray(radii, dtype=np.float64).reshape(-1), len(middle))

    def inside(points: np.ndarray) -> np.ndarray:
        apart = points[:, None] - middle
        return ((apart**2).sum(axis=2) <= reach**2).any(axis=1)

    return inside


def cells_inside(points: np.ndarray, cells: np.ndarray, inside: Inside, strict: bool) -> np.ndarray:
    """Indices of the cells with all corners in the region, or, if not `strict`, with their mean corner in it."""
    if not len(cells):
        return np.zeros(0, dtype=np.int64)
    if strict:
        return np.flatnonzero(inside(points)[cells].all(axis=1))
    corners = points[cells]
    total = corners[:, 0]
    for corner in range(1, cells.shape[1]):
        total = total + corners[:, corner]
    return np.flatnonzero(inside(total / cells.shape[1]))
