"""The walls of a mesh: found with rays, and measured by the surfaces between which they lie.

From the middle of every boundary triangle a ray goes into the body, at a right angle, tetrahedron by tetrahedron,
until it leaves it again. Where it leaves nearly at a right angle there is a wall. So walls need no description.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from taichisoft.meshes import VolumeMesh
from taichisoft_meshing.quality.mesh_surfaces import OUTER, SurfaceQuality
from taichisoft_meshing.quality.tetrahedra import FACES, neighbours

PARALLEL = 0.9
"""Least cosine between the sides of a wall [-]: within 25 degrees, which excludes the slanted sides of a corner."""
MANY = 5
"""Number up to which elements across are counted."""
LEFT_OUT = 0.05
"""Share of a wall's area that may have fewer elements across than reported [-]: single edges of the mesh that lead
straight through a wall of two elements do not make it a wall of one."""


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


@dataclass(frozen=True)
class WallQuality:
    """Figures of all walls between two surfaces.

    Attributes:
        sides: names of the surfaces, a cavity first; both are the same where the outer skin faces itself.
        of_cavity: whether one side is a cavity.
        thinnest: smallest thickness [mm].
        elements_across: least number of elements across 95 % of the area; counted up to MANY.
        share_of_one: share of the area that is one element thick [-].
    """

    sides: tuple[str, str]
    of_cavity: bool
    thinnest: float
    elements_across: int
    share_of_one: float

    @property
    def name(self) -> str:
        """The name for people: "cavity to outer"."""
        return " to ".join(self.sides)


def measure_walls(mesh: VolumeMesh, surfaces: Sequence[SurfaceQuality]) -> tuple[WallQuality, ...]:
    """Find the walls of a mesh of positive elements and sort them by their sides, cavities first."""
    walls = find_walls(mesh.nodes, mesh.elements)
    closed = sorted((one for one in surfaces if one.closed_by_name), key=lambda surface: surface.name == OUTER)
    side, opposite = (_surface_of(triangles, closed) for triangles in (walls.triangles, walls.opposite))
    found = []
    for first, surface in enumerate(closed):
        for second in range(first, len(closed)):
            here = ((side == first) & (opposite == second)) | ((side == second) & (opposite == first))
            if not here.any():
                continue
            areas, across = walls.areas[here], walls.elements_across[here]
            share = np.bincount(across, areas, MANY + 1).cumsum() / areas.sum()
            thinnest, least = float(walls.thickness[here].min()), int(np.argmax(share > LEFT_OUT))
            sides = (surface.name, closed[second].name)
            found.append(WallQuality(sides, surface.of_cavity, thinnest, least, float(share[1])))
    return tuple(found)


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
    doubled = np.linalg.norm(normals[element, face], axis=1)
    directions = -normals[element, face] / doubled[:, None]
    origins = nodes[corners[element, face]].mean(axis=1)
    last_element, last_face, length = _trace_rays(element, origins, directions, normals, offsets, behind)
    out = normals[last_element, last_face]
    cosine = np.einsum("rd,rd->r", out, directions) / np.linalg.norm(out, axis=1)
    start, end = corners[element, face], corners[last_element, last_face]
    across = _edges_between(elements, start, end, len(nodes))
    # Triangles that meet in a node are an edge of the body, not the sides of a wall.
    wall = (last_face >= 0) & (cosine > PARALLEL) & (across > 0)
    return Walls(start[wall], end[wall], doubled[wall] / 2, length[wall], across[wall])


def _trace_rays(
    start: np.ndarray,
    origins: np.ndarray,
    directions: np.ndarray,
    normals: np.ndarray,
    offsets: np.ndarray,
    behind: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The element and face through which each ray leaves the body (face -1 for a lost ray), and its length [mm].

    A ray leaves a tetrahedron through the nearest plane of a face that it crosses outward. So it cannot miss an edge
    that it hits: whichever of the two faces rounding prefers, the next tetrahedron also has the edge.
    """
    element, came_from = start.copy(), np.full(len(start), -1)
    last_face, length = np.full(len(start), -1), np.zeros(len(start))
    active = np.arange(len(start))
    for _ in range(len(normals)):
        here = element[active]
        steepness = np.einsum("rfd,rd->rf", normals[here], directions[active])
        distance = offsets[here] - np.einsum("rfd,rd->rf", normals[here], origins[active])
        outward = (steepness > 0) & ((behind[here] != came_from[active, None]) | (behind[here] < 0))
        reach = np.where(outward, distance / np.where(outward, steepness, 1.0), np.inf)
        through = reach.argmin(axis=1)
        length[active] = reach.min(axis=1)
        following, found = behind[here, through], np.isfinite(length[active])
        leaving, going = found & (following < 0), found & (following >= 0)
        last_face[active[leaving]] = through[leaving]
        active = active[going]
        came_from[active], element[active] = here[going], following[going]
        if not len(active):
            break
    return element, last_face, length


def _edges_between(elements: np.ndarray, starts: np.ndarray, ends: np.ndarray, node_count: int) -> np.ndarray:
    """Smallest number of edges, at most MANY, from any corner of a triangle to any corner of another, for each pair."""
    pairs = elements[:, [[i, j] for i in range(4) for j in range(4)]].reshape(-1, 2)
    reach = _incidence(pairs[:, 0], pairs[:, 1], (node_count, node_count))
    row = np.repeat(np.arange(len(starts)), 3)
    near_start, near_end = (_incidence(row, corners.ravel(), (len(starts), node_count)) for corners in (starts, ends))
    across = np.full(len(starts), MANY)
    for edges in range(MANY):  # the two neighbourhoods grow in turn until they meet
        meet = near_start.multiply(near_end).sum(axis=1) > 0
        across[meet] = np.minimum(across[meet], edges)
        if edges % 2:
            near_end = (near_end @ reach).astype(bool)
        else:
            near_start = (near_start @ reach).astype(bool)
    return across


def _incidence(rows: np.ndarray, columns: np.ndarray, shape: tuple[int, int]) -> csr_array:
    return csr_array((np.ones(len(rows), dtype=bool), (rows, columns)), shape=shape)


def _surface_of(triangles: np.ndarray, surfaces: Sequence[SurfaceQuality]) -> np.ndarray:
    """Index of the surface of each triangle, which has all three corners; -1 where no surface has them."""
    found = np.full(len(triangles), -1)
    for number, surface in enumerate(surfaces):
        found[np.isin(triangles, surface.triangles).all(axis=1)] = number
    return found
