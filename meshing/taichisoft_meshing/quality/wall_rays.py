"""Walls of a body, found with rays: their thicknesses, and the number of elements across each.

From the middle of every boundary triangle a ray goes into the body, at a right angle, tetrahedron by tetrahedron,
until it leaves it again. Where it leaves nearly at a right angle there is a wall. So walls need no description.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix

from taichisoft_meshing.quality.tetrahedra import FACES, neighbours

PARALLEL = 0.9
"""Least cosine between the sides of a wall [-]: within 25 degrees, so that the slanted sides of a corner are none."""

MANY = 5
"""Number up to which elements across are counted."""


@dataclass(frozen=True)
class Walls:
    """Walls, with one entry for every boundary triangle that has a wall behind it.

    Attributes:
        triangles: nodes of the triangle at which the ray starts, shape (count, 3).
        opposite: nodes of the triangle through which the ray leaves, shape (count, 3).
        areas: areas of the triangles at which the rays start [mm^2], shape (count,).
        thickness: lengths of the rays [mm], shape (count,).
        elements_across: smallest number of edges that lead from the one triangle to the other, at most MANY, shape
            (count,); 1 where no node lies inside the wall, so that it bends much too stiffly.
    """

    triangles: np.ndarray
    opposite: np.ndarray
    areas: np.ndarray
    thickness: np.ndarray
    elements_across: np.ndarray


def find_walls(nodes: np.ndarray, elements: np.ndarray) -> Walls:
    """Send a ray from every boundary triangle.

    Args:
        nodes: positions [mm], shape (node_count, 3).
        elements: tetrahedra of positive volume, shape (element_count, 4 or more).
    """
    elements = elements[:, :4]
    corners = elements[:, FACES]
    a, b, c = np.moveaxis(nodes[corners], 2, 0)
    normals = np.cross(b - a, c - a)
    offsets = np.einsum("efd,efd->ef", normals, a)
    behind = neighbours(elements)
    element, face = np.nonzero(behind < 0)
    areas = np.linalg.norm(normals[element, face], axis=1) / 2
    directions = -normals[element, face] / (2 * areas[:, None])
    origins = nodes[corners[element, face]].mean(axis=1)
    last_element, last_face, length = _walk(element, face, origins, directions, normals, offsets, behind)
    arrived = last_face >= 0
    out = normals[last_element, last_face]
    cosine = np.einsum("rd,rd->r", out, directions) / np.linalg.norm(out, axis=1)
    start, end = corners[element, face], corners[last_element, last_face]
    across = _edges_between(elements, start, end, len(nodes))
    wall = arrived & (cosine > PARALLEL) & (across > 0)  # triangles that meet in a node are an edge of the body
    return Walls(start[wall], end[wall], areas[wall], length[wall], across[wall])


def _walk(
    element: np.ndarray,
    face: np.ndarray,
    origins: np.ndarray,
    directions: np.ndarray,
    normals: np.ndarray,
    offsets: np.ndarray,
    behind: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The element and face through which each ray leaves the body (face -1 if it got lost), and its length [mm].

    A ray leaves a tetrahedron through the nearest plane of a face that it crosses outward. So it cannot miss an edge
    that it hits: whichever of the two faces rounding prefers, the next tetrahedron also has the edge.
    """
    last_element, last_face = element.copy(), np.full(len(element), -1)
    length = np.zeros(len(element))
    active = np.arange(len(element))
    came_from = np.full(len(element), -1)
    for _ in range(len(normals)):
        if not len(active):
            break
        here, direction = last_element[active], directions[active]
        steepness = np.einsum("rfd,rd->rf", normals[here], direction)
        distance = offsets[here] - np.einsum("rfd,rd->rf", normals[here], origins[active])
        outward = (steepness > 0) & ((behind[here] != came_from[active, None]) | (behind[here] < 0))
        reach = np.where(outward, distance / np.where(outward, steepness, 1.0), np.inf)
        through = reach.argmin(axis=1)
        length[active] = reach[np.arange(len(active)), through]
        following = behind[here, through]
        lost = ~np.isfinite(length[active])
        left = (following < 0) & ~lost
        last_face[active[left]] = through[left]
        going = ~left & ~lost
        came_from[active[going]] = here[going]
        last_element[active[going]] = following[going]
        active = active[going]
    return last_element, last_face, length


def _edges_between(elements: np.ndarray, starts: np.ndarray, ends: np.ndarray, node_count: int) -> np.ndarray:
    """Smallest number of edges, at most MANY, from any corner of a triangle to any corner of another, for each pair."""
    pairs = elements[:, [[i, j] for i in range(4) for j in range(4)]].reshape(-1, 2)
    reach = _incidence(pairs[:, 0], pairs[:, 1], (node_count, node_count))
    row = np.repeat(np.arange(len(starts)), 3)
    near_start = _incidence(row, starts.ravel(), (len(starts), node_count))
    near_end = _incidence(row, ends.ravel(), (len(ends), node_count))
    across = np.full(len(starts), MANY)
    found = np.zeros(len(starts), dtype=bool)
    for edges in range(MANY):  # the two neighbourhoods grow in turn until they meet
        meet = np.asarray(near_start.multiply(near_end).sum(axis=1)).ravel() > 0
        across[meet & ~found] = edges
        found |= meet
        if edges % 2:
            near_end = _ones(near_end @ reach)
        else:
            near_start = _ones(near_start @ reach)
    return across


def _incidence(rows: np.ndarray, columns: np.ndarray, shape: tuple[int, int]) -> csr_matrix:
    return _ones(coo_matrix((np.ones(len(rows), dtype=np.int32), (rows, columns)), shape=shape).tocsr())


def _ones(matrix: csr_matrix) -> csr_matrix:
    matrix.data[:] = 1
    return matrix
