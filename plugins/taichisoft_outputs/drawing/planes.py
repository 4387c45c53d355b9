"""Infinite planes: which of them are floors, and slopes and walls as squares that end at the floors."""

from collections.abc import Sequence

import numpy as np

from taichisoft.bodies import Plane
from taichisoft_outputs.drawing.camera import radius_around_mean, scene_axes

HALF_WIDTH = 2.2
"""Half the width of what is drawn of a plane, in radii of what stands before it [-]."""
LEVEL = 0.99
"""Cosine of the angle to gravity from which a plane is a floor."""


def is_floor(plane: Plane, up: np.ndarray) -> bool:
    """Whether things stand on the plane as on level ground."""
    return bool(plane.normal @ up >= LEVEL)


def reaches_under(floor: Plane, vertices: np.ndarray, far: float = 0.5) -> bool:
    """Whether one of the vertices [mm], shape (vertex_count, 3), is more than `far` [mm] under the floor."""
    return bool(((vertices - floor.point) @ floor.normal < -far).any())


def foot_of(points: np.ndarray, plane: Plane) -> np.ndarray:
    """The point of a plane under the mean of points [mm], shape (3,)."""
    middle = points.mean(axis=0)
    return middle - plane.normal * ((middle - plane.point) @ plane.normal)


def square_of_plane(
    plane: Plane, points: np.ndarray, floors: Sequence[Plane], half: float = HALF_WIDTH
) -> tuple[np.ndarray, np.ndarray]:
    """The part of a plane that is drawn.

    Args:
        plane: the plane.
        points: what stands before the plane [mm], shape (point_count, 3).
        floors: planes; what is under them is left out.
        half: half the width of the square, in radii of the points [-].

    Returns:
        Vertices [mm], (vertex_count, 3), and triangles, counterclockwise as seen from where the normal points.
    """
    right, front, _ = scene_axes(plane.normal)
    # Front is right x up: seen from the side of the normal, right -> back -> left turns against the clock.
    corners = np.array([right - front, -right - front, front - right, right + front])
    corners = foot_of(points, plane) + half * radius_around_mean(points) * corners
    for floor in floors:
        corners = _above(corners, floor)
    fan = [[0, k, k + 1] for k in range(1, len(corners) - 1)]
    return corners, np.array(fan, dtype=int).reshape(-1, 3)


def _above(corners: np.ndarray, floor: Plane) -> np.ndarray:
    """The part of a convex polygon above a floor."""
    kept: list[np.ndarray] = []
    height = (corners - floor.point) @ floor.normal
    for k in range(len(corners)):
        after = (k + 1) % len(corners)
        if height[k] >= 0:
            kept.append(corners[k])
        if (height[k] >= 0) != (height[after] >= 0):
            part = height[k] / (height[k] - height[after])
            kept.append(corners[k] + part * (corners[after] - corners[k]))
    return np.array(kept).reshape(-1, 3)
