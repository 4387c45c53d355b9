"""Places where closed surfaces go through themselves or each other, or touch.

Two triangles that cross have an edge of one that goes through the other, so edges are cut with triangles that share no
vertex with them. Triangles that lie upon each other have no such edge, but a vertex of one lies in the other.
"""

from dataclasses import dataclass

import numpy as np

from taichisoft.meshes import common_points, pairs_of_meeting_boxes
from taichisoft_meshing.bodies.surface_geometry import NEAR, angles_between, area_vectors, diagonal, joined_sides

SAME_SHELL_NEAR = 1e-9
"""Distance at which a vertex lies in a triangle of its own shell, as a share of the diagonal [-]. Fine meshes have thin
triangles, so NEAR, the distance at which different shells touch, would be too large."""

FOLDED = 1e-6
"""Largest angle between two neighbours that lie upon each other [rad]."""


@dataclass(frozen=True)
class Crossings:
    """Pairs of triangles that cross or touch.

    Attributes:
        triangles: the two triangles of each pair, the lower number first, each pair once, shape (count, 2).
        places: a point in both [mm], shape (count, 3).
    """

    triangles: np.ndarray
    places: np.ndarray


def find_crossings(vertices: np.ndarray, triangles: np.ndarray, shell: np.ndarray) -> Crossings:
    """Cut all triangles of some closed shells with each other.

    Args:
        vertices: positions [mm], shape (vertex_count, 3); no two shells have one in common.
        triangles: vertex indices, shape (triangle_count, 3).
        shell: number of the shell of each triangle, shape (triangle_count,).
    """
    edges, sides = joined_sides(triangles)
    own = sides[:, 0] // 3
    found = [_folds(vertices[triangles], sides // 3)]
    size = diagonal(vertices)
    for edge, triangle in pairs_of_meeting_boxes(vertices[edges], vertices[triangles], NEAR * size):
        apart = (edges[edge][:, :, None] != triangles[triangle][:, None, :]).all(axis=(1, 2))
        edge, triangle = edge[apart], triangle[apart]
        reach = np.where(shell[own[edge]] == shell[triangle], SAME_SHELL_NEAR, NEAR) * size
        place = common_points(vertices[edges[edge]], vertices[triangles[triangle]], reach)
        hit = np.isfinite(place).all(axis=1)
        found.append((np.column_stack([own[edge], triangle])[hit], place[hit]))
    pairs = np.sort(np.vstack([pairs for pairs, _ in found]), axis=1)
    pairs, once = np.unique(pairs, axis=0, return_index=True)
    return Crossings(pairs, np.vstack([places for _, places in found])[once])


def _folds(corners: np.ndarray, neighbours: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Neighbours that lie upon each other, as across their common edge the surface turns back, and a place in each."""
    folded = neighbours[angles_between(area_vectors(corners), neighbours) > np.pi - FOLDED]
    return folded, corners[folded[:, 0]].mean(axis=1)
