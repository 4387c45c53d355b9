"""The surfaces of a mesh: whether they are closed, which way they face, and what they enclose."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from taichisoft.meshes import VolumeMesh, boundary_triangles, count_open_edges, enclosed_volume

OUTER = "outer"
CAVITY = "cavity"

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
    named = dict(mesh.surface_groups)
    if OUTER not in named:
        skins, cavities = skins_and_cavities(mesh.nodes, mesh.elements)
        outer = {OUTER: np.concatenate(skins)} if skins else {}
        named = {**outer, **dict(zip(cavity_names(len(cavities)), cavities, strict=True)), **named}
    return tuple(measure_surface(name, mesh.nodes, triangles) for name, triangles in named.items() if len(triangles))


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


def skins_and_cavities(nodes: np.ndarray, elements: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """The closed pieces of a body's boundary: outer skins, which face outward, and cavities, which face the silicone.

    Args:
        nodes: positions [mm], shape (node_count, 3).
        elements: tetrahedra of positive volume, shape (element_count, 4).

    Returns:
        Skins and cavities, each (count, 3) node indices; both enclose positive volumes.
    """
    outward = connected_pieces(boundary_triangles(elements), len(nodes))
    skins = [piece for piece in outward if enclosed_volume(nodes, piece) > 0]
    cavities = [piece[:, ::-1] for piece in outward if enclosed_volume(nodes, piece) <= 0]
    return skins, cavities


def cavity_names(count: int) -> list[str]:
    """Names of the surface groups of cavities: "cavity" alone; "cavity_0", "cavity_1", ... where there are more."""
    return [CAVITY] if count == 1 else [f"{CAVITY}_{number}" for number in range(count)]


def connected_pieces(triangles: np.ndarray, node_count: int) -> list[np.ndarray]:
    """The triangles, each (count, 3), of every piece of a surface that shares no node with the others."""
    starts, ends = triangles[:, [0, 1]].ravel(), triangles[:, [1, 2]].ravel()
    graph = coo_matrix((np.ones(len(starts)), (starts, ends)), shape=(node_count, node_count))
    piece = connected_components(graph, directed=False)[1][triangles[:, 0]]
    return [triangles[piece == number] for number in np.unique(piece)]
