"""Chambers that are open to the outside, as at an air inlet: found where a flat cap would close them."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from taichisoft.errors import MeshError
from taichisoft.mesh import VolumeMesh, enclosed_volume
from taichisoft_meshing.closed_shells import area_vectors, diagonal, facing_sides
from taichisoft_meshing.wall_quality import winding_numbers

# Caps: triangles over the opening of a surface, whose corners are nodes of its rim.


def with_caps(mesh: VolumeMesh, cavity: str) -> VolumeMesh:
    """The mesh, with a cavity that is open to the outside, and the outside, closed by the same flat or ruled caps.

    The caps belong to no tetrahedron: the air's pressure on them acts at the nodes of the rim, as that of a plug that
    is glued in, and they neither stiffen the rim nor weigh anything.
    """
    wall, outer = mesh.surface_groups[cavity], mesh.surface_groups["outer"]
    sides = wall[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    inner = {tuple(side) for side in sides.tolist()}
    rim = np.array([(end, begin) for begin, end in sides.tolist() if (end, begin) not in inner], dtype=np.int32)
    caps = []
    for loop in rims(rim):
        try:
            caps.append(np.array(loop, dtype=np.int32)[cap_triangles(mesh.nodes[loop])])
        except ValueError as error:
            raise MeshError(f"{mesh.source}: {cavity}: {error}") from error
    groups = {"outer": np.concatenate([outer, *caps]), cavity: np.concatenate([wall, *caps])}
    return replace(mesh, surface_groups={**mesh.surface_groups, **groups})


def rims(edges: np.ndarray) -> list[list[int]]:
    """Closed loops of directed edges, shape (edge_count, 2), each as the nodes that it passes.

    Loops that touch in a node are parted there, and edges of no loop are left out.
    """
    following: dict[int, list[int]] = {}
    for begin, end in edges.tolist():
        following.setdefault(begin, []).append(end)
    loops = []
    for start in list(following):
        path = [start]
        while path:
            if not following.get(path[-1]):
                path.pop()  # the end of the loops through it, or of an edge of none
                continue
            node = following[path[-1]].pop()
            if node in path:
                at = path.index(node)
                loops.append(path[at:])
                del path[at + 1 :]
            else:
                path.append(node)
    return loops


def cap_triangles(rim: np.ndarray) -> np.ndarray:
    """Triangles between the corners of a polygon, which keep its sense: ears with the shortest sides are cut first.

    Args:
        rim: corners, flat or nearly so [mm], shape (count, 3).

    Returns:
        Indices of corners, shape (count - 2, 3).
    """
    middle = rim - rim.mean(axis=0)
    normal = np.cross(middle, np.roll(middle, -1, axis=0)).sum(axis=0)
    across = np.linalg.svd(normal[None])[2][1:]
    flat = middle @ across.T
    if np.dot(np.cross(across[0], across[1]), normal) < 0:
        flat = flat[:, ::-1]
    least = 1e-9 * np.ptp(flat, axis=0).max() ** 2
    ring, triangles = list(range(len(rim))), []
    while len(ring) > 2:
        ears = []
        for place, corner in enumerate(ring):
            before, after = ring[place - 1], ring[(place + 1) % len(ring)]
            ear = flat[[before, corner, after]]
            others = flat[[other for other in ring if other not in (before, corner, after)]]
            sides = np.roll(ear, -1, axis=0) - ear
            if sides[0, 0] * sides[1, 1] - sides[0, 1] * sides[1, 0] <= least:
                continue
            away = others[:, None] - ear
            left = sides[:, 0] * away[..., 1] - sides[:, 1] * away[..., 0]
            if not (left >= -least).all(axis=1).any():
                ears.append((round(float(np.linalg.norm(ear[2] - ear[0])), 9), place, (before, corner, after)))
        if not ears:
            raise ValueError("the rim of its opening crosses itself, so that no cap closes it")
        _, place, chosen = min(ears)
        triangles.append(chosen)
        del ring[place]
    return np.array(triangles, dtype=np.int32)


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
