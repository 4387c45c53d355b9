"""The walls of a mesh: found with rays, and measured by the surfaces between which they lie.

From the middle of every boundary triangle a ray goes into the body, at a right angle, tetrahedron by tetrahedron,
until it leaves it again. Where it leaves nearly at a right angle there is a wall. So walls need no description.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from taichisoft.mesh import (
    CAVITY,
    OUTER,
    VolumeMesh,
    count_open_edges,
    enclosed_volume,
    named_surfaces,
    tetrahedron_volumes,
)

# The surfaces of a mesh: whether they are closed, which way they face, and what they enclose.

# Number of vertices of a cavity that are tested: if its surface does not cross the skin, one would be enough.
SAMPLE = 50


@dataclass(frozen=True)
class SurfaceQuality:
    """Figures of one surface.

    Attributes:
        name: name of the group; "outer", "cavity" or "cavity_N" too where the mesh has no groups.
        triangles: node indices, shape (triangle_count, 3).
        area: area [mm^2].
        volume: enclosed volume [mm^3], positive where it faces away from what is inside; 0 if it is not closed.
        open_edges: number of directed edges that have not exactly one opposite.
    """

    name: str
    triangles: np.ndarray
    area: float
    volume: float
    open_edges: int

    @property
    def of_cavity(self) -> bool:
        """Whether it is the wall of an air chamber, which its name says."""
        return self.name.startswith(CAVITY)

    @property
    def closed_by_name(self) -> bool:
        """Whether its name says that it is closed."""
        return self.name == OUTER or self.of_cavity


def measure_surface(name: str, nodes: np.ndarray, triangles: np.ndarray) -> SurfaceQuality:
    """Measure one surface; node positions in [mm]."""
    a, b, c = np.moveaxis(nodes[triangles], 1, 0)
    area = float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)
    open_edges = count_open_edges(triangles)
    volume = 0.0 if open_edges or not len(triangles) else enclosed_volume(nodes, triangles)
    return SurfaceQuality(name, triangles, area, volume, open_edges)


def measure_surfaces(mesh: VolumeMesh) -> tuple[SurfaceQuality, ...]:
    """Measure the surfaces that a mesh names; where it names no outer skin, also the pieces of its boundary."""
    return tuple(
        measure_surface(name, mesh.nodes, triangles)
        for name, triangles in named_surfaces(mesh).items()
        if len(triangles)
    )


def cavities_outside(nodes: np.ndarray, surfaces: tuple[SurfaceQuality, ...]) -> tuple[str, ...]:
    """Names of cavities that touch the outer skin, but for caps that are triangles of both, or lie outside of it."""
    skin = np.concatenate(
        [np.empty((0, 3), dtype=np.int32), *(surface.triangles for surface in surfaces if surface.name == OUTER)]
    )
    of_skin = set(map(tuple, np.sort(skin, axis=1).tolist()))
    outside = []
    for surface in surfaces:
        if surface.of_cavity:
            caps = [one for one in np.sort(surface.triangles, axis=1).tolist() if tuple(one) in of_skin]
            vertices = np.setdiff1d(surface.triangles, np.array(caps, dtype=int))
            sample = vertices[:: max(len(vertices) // SAMPLE, 1)]
            if np.isin(vertices, skin).any() or not (winding_numbers(nodes[sample], nodes[skin]) > 0.5).all():
                outside.append(surface.name)
    return tuple(outside)


def winding_numbers(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Winding numbers of a closed surface around points: 1 inside of it, 0 outside (van Oosterom and Strackee 1983).

    Args:
        points: [mm], shape (point_count, 3).
        triangles: corners, outward [mm], shape (triangle_count, 3, 3).
    """
    a, b, c = np.moveaxis(triangles[None] - points[:, None, None], 2, 0)
    la, lb, lc = (np.linalg.norm(corner, axis=-1) for corner in (a, b, c))
    triple = _dot(a, np.cross(b, c))
    spread = la * lb * lc + _dot(a, b) * lc + _dot(b, c) * la + _dot(c, a) * lb
    return np.arctan2(triple, spread).sum(axis=1) / (2 * np.pi)


def _dot(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return np.einsum("ptd,ptd->pt", first, second)


# The shapes of tetrahedra, and their neighbours.

# Start and end of each edge, and the two other corners.
EDGES = ((0, 1, 2, 3), (0, 2, 3, 1), (0, 3, 1, 2), (1, 2, 0, 3), (1, 3, 2, 0), (2, 3, 0, 1))

# Corners of each face, outward for positive tetrahedra; face k is opposite to corner k.
FACES = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])


def radius_ratios(nodes: np.ndarray, elements: np.ndarray) -> np.ndarray:
    """Three times the inscribed radius over the circumscribed one [-], shape (element_count,).

    1 for a regular tetrahedron, 0 for a flat one; gmsh calls it gamma.

    Args:
        nodes: positions [mm], shape (node_count, 3).
        elements: tetrahedra, shape (element_count, 4 or more); the first four nodes are the corners.
    """
    a, b, c, d = np.moveaxis(nodes[elements[:, :4]], 1, 0)
    volumes = np.abs(tetrahedron_volumes(nodes, elements))
    areas = sum(
        np.linalg.norm(np.cross(q - p, r - p), axis=1) / 2 for p, q, r in ((a, b, c), (a, b, d), (a, c, d), (b, c, d))
    )
    # Products of opposite edges are the sides of a triangle of area 6 V R (Crelle's formula).
    x, y, z = (
        np.linalg.norm(p, axis=1) * np.linalg.norm(q, axis=1)
        for p, q in ((b - a, d - c), (c - a, d - b), (d - a, c - b))
    )
    crelle = np.sqrt(np.maximum((x + y + z) * (x + y - z) * (x - y + z) * (-x + y + z), 0.0)) / 4
    inscribed = np.divide(3 * volumes, areas, out=np.zeros_like(volumes), where=areas > 0)
    return np.divide(18 * volumes * inscribed, crelle, out=np.zeros_like(volumes), where=crelle > 0)


def dihedral_angles(nodes: np.ndarray, elements: np.ndarray) -> np.ndarray:
    """Angles between the faces of each tetrahedron [degrees], shape (element_count, 6); 70.5 in a regular one.

    Args:
        nodes: positions [mm], shape (node_count, 3).
        elements: tetrahedra, shape (element_count, 4 or more); the first four nodes are the corners.
    """
    corners = nodes[elements[:, :4]]
    angles = []
    for start, end, first, second in EDGES:
        along = corners[:, end] - corners[:, start]
        a, b = (np.cross(along, corners[:, third] - corners[:, start]) for third in (first, second))
        angles.append(np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.einsum("ed,ed->e", a, b)))
    return np.degrees(np.column_stack(angles))


def edge_lengths(nodes: np.ndarray, elements: np.ndarray) -> np.ndarray:
    """Shortest and longest edge of each tetrahedron [mm], shape (element_count, 2)."""
    corners = nodes[elements[:, :4]]
    starts, ends = np.array(EDGES)[:, 0], np.array(EDGES)[:, 1]
    lengths = np.linalg.norm(corners[:, ends] - corners[:, starts], axis=-1)
    return np.column_stack([lengths.min(axis=1), lengths.max(axis=1)])


def neighbours(elements: np.ndarray) -> np.ndarray:
    """The tetrahedron behind each face, -1 on the boundary, shape (element_count, 4), for elements of that shape."""
    faces = np.sort(elements[:, FACES].reshape(-1, 3), axis=1)
    order = np.lexsort(faces.T)
    same = (faces[order[1:]] == faces[order[:-1]]).all(axis=1)
    pairs = order[:-1][same], order[1:][same]
    behind = np.full(len(faces), -1)
    behind[pairs[0]], behind[pairs[1]] = pairs[1] // 4, pairs[0] // 4
    return behind.reshape(-1, 4)


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
    closed = sorted(
        (surface for surface in surfaces if surface.closed_by_name), key=lambda surface: surface.name == OUTER
    )
    side, opposite = (_surface_of(triangles, closed) for triangles in (walls.triangles, walls.opposite))
    walls_by_sides = []
    for first, surface in enumerate(closed):
        for second in range(first, len(closed)):
            here = ((side == first) & (opposite == second)) | ((side == second) & (opposite == first))
            if not here.any():
                continue
            areas, across = walls.areas[here], walls.elements_across[here]
            share = np.bincount(across, areas, MANY + 1).cumsum() / areas.sum()
            thinnest, least = float(walls.thickness[here].min()), int(np.argmax(share > LEFT_OUT))
            sides = (surface.name, closed[second].name)
            walls_by_sides.append(WallQuality(sides, surface.of_cavity, thinnest, least, float(share[1])))
    return tuple(walls_by_sides)


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
        following, is_finite = behind[here, through], np.isfinite(length[active])
        leaving, going = is_finite & (following < 0), is_finite & (following >= 0)
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
    index = np.full(len(triangles), -1)
    for number, surface in enumerate(surfaces):
        index[np.isin(triangles, surface.triangles).all(axis=1)] = number
    return index
