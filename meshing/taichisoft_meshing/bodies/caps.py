"""Caps: triangles over the opening of a surface, whose corners are nodes of its rim."""

from dataclasses import replace

import numpy as np

from taichisoft.errors import MeshError
from taichisoft.meshes import VolumeMesh


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

    Raises:
        ValueError: the polygon, seen along its normal, crosses itself.
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
