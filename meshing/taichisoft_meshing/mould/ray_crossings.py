"""Where rays cross triangles: all pairs at once, by the side on which a ray passes each edge (Pluecker coordinates)."""

from dataclasses import dataclass

import numpy as np

PAIRS = 3_000_000
"""Pairs of a ray and a triangle that are computed at a time."""
BESIDE = 50
"""Lines beside each other that are compared with the same triangles."""


@dataclass(frozen=True)
class RayCrossings:
    """Crossings of rays and triangles, an entry each.

    Attributes:
        ray: index of the ray, shape (count,).
        triangle: index of the triangle, shape (count,).
        distance: along the ray from its origin [mm], negative before it, shape (count,).
        cosine: between the ray and the triangle's normal [-], positive where it leaves a body, shape (count,).
    """

    ray: np.ndarray
    triangle: np.ndarray
    distance: np.ndarray
    cosine: np.ndarray


def find_crossings(origins: np.ndarray, directions: np.ndarray, corners: np.ndarray) -> RayCrossings:
    """All crossings of the lines through rays with triangles; what a ray only touches is none.

    Args:
        origins: starts of the rays [mm], shape (ray_count, 3).
        directions: unit vectors along them, shape (ray_count, 3).
        corners: of the triangles, counterclockwise as seen from outside [mm], shape (triangle_count, 3, 3).
    """
    if not len(corners):
        return RayCrossings(np.empty(0, int), np.empty(0, int), np.empty(0), np.empty(0))
    middle = corners.reshape(-1, 3).mean(axis=0)  # numbers are small around it, and rounding with them
    origins, corners = origins - middle, corners - middle
    rays = np.concatenate([directions, np.cross(origins, directions)], axis=1)
    edges = []
    for first in range(3):
        begin, end = corners[:, first], corners[:, (first + 1) % 3]
        edges.append(np.concatenate([np.cross(begin, end), end - begin], axis=1).T)
    found = []
    step = max(1, PAIRS // max(len(corners), 1))
    for start in range(0, max(len(rays), 1), step):
        sides = [rays[start : start + step] @ edge for edge in edges]
        above = (sides[0] > 0) & (sides[1] > 0) & (sides[2] > 0)
        below = (sides[0] < 0) & (sides[1] < 0) & (sides[2] < 0)
        ray, triangle = np.nonzero(above | below)
        found.append((ray + start, triangle))
    ray, triangle = (np.concatenate([pairs[which] for pairs in found]) for which in (0, 1))
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[triangle]
    steepness = np.einsum("cd,cd->c", normals, directions[ray])
    height = np.einsum("cd,cd->c", normals, corners[triangle, 0] - origins[ray])
    return RayCrossings(ray, triangle, height / steepness, steepness / np.linalg.norm(normals, axis=1))


def find_parallel_crossings(starts: np.ndarray, way: np.ndarray, corners: np.ndarray) -> RayCrossings:
    """All crossings, as above, of lines along one direction: each is compared with the triangles beside it alone.

    Args:
        starts: points of the lines [mm], shape (line_count, 3).
        way: unit vector along them, shape (3,).
        corners: of the triangles [mm], shape (triangle_count, 3, 3).
    """
    across = np.linalg.svd(way[None])[2][1:]
    along = across[np.argmax(np.ptp(corners.reshape(-1, 3) @ across.T, axis=0))]
    place, sides = starts @ along, corners @ along
    lower, upper = sides.min(axis=1), sides.max(axis=1)
    parts = []
    for some in np.array_split(np.argsort(place, kind="stable"), 1 + len(starts) // BESIDE):
        near = np.empty(0, dtype=int)
        if len(some):
            near = np.flatnonzero((lower <= place[some[-1]]) & (upper >= place[some[0]]))
        one = find_crossings(starts[some], np.broadcast_to(way, (len(some), 3)), corners[near])
        parts.append((some[one.ray], near[one.triangle], one.distance, one.cosine))
    return RayCrossings(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def inner_points(corners: np.ndarray) -> np.ndarray:
    """A point inside each triangle, shape (count, 3), that lies on no line of symmetry."""
    return np.array([0.41, 0.33, 0.26]) @ corners
