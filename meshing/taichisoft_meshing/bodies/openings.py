"""Chambers that are open to the outside, as at an air inlet: found where a flat cap would close them."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from taichisoft.meshes import enclosed_volume
from taichisoft_meshing.bodies.caps import cap_triangles, rims
from taichisoft_meshing.bodies.surface_geometry import area_vectors, diagonal, facing_sides
from taichisoft_meshing.quality.mesh_surfaces import winding_numbers

INWARD = 0.05
"""Distance of the points of a cap that must lie in air from its rim, as a share of its triangles' height [-]."""
AIR = 0.25
"""Largest winding number of the body around a point in air [-]: 0, 1/2 on its surface, 1 in silicone."""
PLACES = 8  # points of a rim that are tried


@dataclass(frozen=True, eq=False)
class Opening:
    """A chamber that is open to the outside.

    Attributes:
        faces: numbers of the faces behind its rim.
        beside: number of a face outside of its rim.
        centre: middle of the rim [mm], shape (3,).
        area: area of the cap over it [mm^2].
        volume: volume behind the cap [mm^3], of a coarse triangulation.
    """

    faces: frozenset[int]
    beside: int
    centre: np.ndarray
    area: float
    volume: float

    def __str__(self) -> str:
        place = ", ".join(f"{value:.4g}" for value in np.round(self.centre, 3) + 0.0)
        return f"{self.area:.4g} mm^2 wide in face {self.beside} around [{place}] mm"


def find_openings(
    nodes: np.ndarray, triangles: np.ndarray, face_of: np.ndarray, regions: Mapping[int, int]
) -> tuple[Opening, ...]:
    """Find the rims of chambers in the outside of a body, the chambers of largest volume first.

    A rim is a loop of edges around a hole in a flat or curved region, which parts the surface in two, and whose cap
    lies in air. So holes that lead through the body have none, and neither have studs. A rim behind another is none.

    Args:
        nodes: positions [mm], shape (node_count, 3).
        triangles: of the outside, outward, shape (triangle_count, 3); face_of: face of each, shape (triangle_count,).
        regions: the number of each face's region, the same for flat faces that continue each other.
    """
    sides = facing_sides(triangles)
    region = np.array([regions[face] for face in face_of.tolist()])[sides // 3]
    found: dict[frozenset[int], Opening] = {}  # two regions may have the same rim
    for number in np.unique(region[region[:, 0] != region[:, 1]]).tolist():
        border = np.flatnonzero((region == number).sum(axis=1) == 1)
        side = np.where(region[border, 0] == number, *sides[border].T)
        loops = rims(triangles.ravel()[np.column_stack([side, side - side % 3 + (side + 1) % 3])])
        for loop in sorted(loops, key=lambda loop: diagonal(nodes[loop]))[:-1]:
            cap = _cap(nodes, triangles, loop)
            parts = [] if cap is None else _parted(triangles, sides, loop)
            if cap is not None and parts:
                behind = min(parts, key=lambda part: diagonal(nodes[triangles[part].ravel()]))
                one = _opening(nodes, triangles, face_of, behind, cap)
                found.setdefault(one.faces, one)
    outermost = [one for one in found.values() if not any(one.faces < other.faces for other in found.values())]
    return tuple(sorted(outermost, key=lambda one: (-float(f"{one.volume:.2g}"), min(one.faces))))


def _parted(triangles: np.ndarray, sides: np.ndarray, loop: list[int]) -> list[np.ndarray]:
    """The triangles on either side of a loop, each as flags, shape (triangle_count,); none where it parts nothing."""
    side, numbers = sides[:, 0], np.array([triangles.max() + 1, 1])
    ends = triangles.ravel()[np.column_stack([side, side - side % 3 + (side + 1) % 3])]
    edges = np.sort(np.column_stack([loop, np.roll(loop, -1)]), axis=1)
    pairs = sides[~np.isin(np.sort(ends, axis=1) @ numbers, edges @ numbers)] // 3
    graph = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(len(triangles),) * 2)
    count, piece = connected_components(graph, directed=False)
    return [piece == number for number in range(2)] if count == 2 else []


def _cap(nodes: np.ndarray, triangles: np.ndarray, loop: list[int]) -> np.ndarray | None:
    """Triangles over a loop that lie in air, by their centres and places near their sides; None where none do."""
    try:
        cap = np.array(loop)[cap_triangles(nodes[loop])]
    except ValueError:
        return None
    corners = nodes[cap]
    middles = (corners + np.roll(corners, -1, axis=1)) / 2
    inward = middles + INWARD * (np.roll(corners, 1, axis=1) - middles)
    places = np.concatenate([corners.mean(axis=1), inward.reshape(-1, 3)])
    places = places[:: max(len(places) // PLACES, 1)]
    in_air = np.abs(winding_numbers(places, nodes[triangles])) < AIR
    return cap if in_air.all() else None


def _opening(
    nodes: np.ndarray, triangles: np.ndarray, face_of: np.ndarray, behind: np.ndarray, cap: np.ndarray
) -> Opening:
    """The opening under a cap; `behind` says of each triangle whether it is behind the cap."""
    rim = np.unique(cap)
    before = (np.isin(triangles, rim).sum(axis=1) > 1) & ~behind
    sides = triangles[behind][:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    if len(set(map(tuple, sides.tolist())) & set(map(tuple, cap[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).tolist()))):
        cap = cap[:, ::-1]
    return Opening(
        frozenset(face_of[behind].tolist()),
        int(face_of[before][0]),
        nodes[rim].mean(axis=0),
        float(np.linalg.norm(area_vectors(nodes[cap]), axis=1).sum() / 2),
        -enclosed_volume(nodes, np.concatenate([triangles[behind], cap])),
    )
