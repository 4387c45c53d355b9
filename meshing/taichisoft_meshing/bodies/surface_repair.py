"""Small faults of a triangulated surface that have one sensible repair: each is mended, with a warning."""

import warnings
from collections.abc import Iterator

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from taichisoft.errors import MeshError
from taichisoft_meshing.bodies.surface_geometry import NEAR, area_vectors, diagonal

FLIP_ROUNDS = 20


def merge_near_vertices(vertices: np.ndarray, triangles: np.ndarray, source: str) -> np.ndarray:
    """Merge vertices at nearly the same place, and leave out triangles that vanish so or are repeated.

    Args:
        vertices: positions [mm], shape (vertex_count, 3).
        triangles: vertex indices, shape (triangle_count, 3).
        source: begins the warning.

    Returns:
        The triangles that remain; no vertex is taken away.
    """
    near = NEAR * diagonal(vertices)
    pairs = cKDTree(vertices).query_pairs(near, output_type="ndarray")
    if len(pairs):
        count = len(vertices)
        graph = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(count, count))
        cluster = connected_components(graph, directed=False)[1]
        _, first = np.unique(cluster, return_index=True)
        triangles = first[cluster][triangles]
        vanished = (triangles == np.roll(triangles, 1, axis=1)).any(axis=1)
        triangles = triangles[~vanished]
        warnings.warn(
            f"{source}: {count - len(first)} vertices lie within {near:.2g} mm of another one and are merged with it",
            stacklevel=2,
        )
    turned = np.argmin(triangles, axis=1)[:, None]
    smallest_first = np.take_along_axis(triangles, (turned + np.arange(3)) % 3, axis=1)
    _, first = np.unique(smallest_first, axis=0, return_index=True)
    if len(first) < len(triangles):
        warnings.warn(f"{source}: {len(triangles) - len(first)} repeated triangles are left out", stacklevel=2)
    return triangles[np.sort(first)]


def wind_alike(vertices: np.ndarray, triangles: np.ndarray, source: str) -> np.ndarray:
    """Turn the triangles of a closed shell so that all face the side that most of them face.

    Raises:
        MeshError: the surface has one side only.
    """
    import trimesh

    if not _repeated_edges(triangles):
        return triangles
    mesh = trimesh.Trimesh(vertices, triangles, process=False)
    trimesh.repair.fix_winding(mesh)
    wound = np.asarray(mesh.faces, dtype=triangles.dtype)
    if _repeated_edges(wound):
        raise MeshError(f"{source}: has one side only, like a Moebius strip or a Klein bottle; it encloses nothing")
    turned = ~_same_winding(wound, triangles)
    if 2 * turned.sum() > len(turned):
        wound, turned = wound[:, ::-1], ~turned
    warnings.warn(
        f"{source}: {turned.sum()} of {len(turned)} triangles face the other way than their neighbours "
        "and are turned round",
        stacklevel=2,
    )
    return np.ascontiguousarray(wound)


def replace_flat_triangles(vertices: np.ndarray, triangles: np.ndarray, source: str) -> np.ndarray:
    """Replace the triangles of no area in a closed shell by flipping their long edges.

    The middle corner of such a triangle lies on the edge between the other two. The triangle behind that edge is cut in
    two there instead, so no vertex moves and none is lost.

    Raises:
        MeshError: some remain.
    """
    near = NEAR * diagonal(vertices)
    triangles = triangles.copy()
    flipped = 0
    for _ in range(FLIP_ROUNDS):
        flat = np.flatnonzero(_heights(vertices, triangles) <= near)
        if not len(flat):
            break
        flipped += sum(_flips(vertices, triangles, flat))
    else:
        place = np.round(vertices[triangles[flat[0]]].mean(axis=0), 3).tolist()
        raise MeshError(
            f"{source}: triangle {flat[0]} at {place} mm has no area ({len(flat)} such triangles) and cannot be "
            "left out; remove them in the program that the surface comes from"
        )
    if flipped:
        warnings.warn(
            f"{source}: {flipped} triangles of no area are replaced by cutting their neighbours", stacklevel=2
        )
    return triangles


def _heights(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Distance [mm] of each triangle's middle corner from its longest edge."""
    corners = vertices[triangles]
    return np.linalg.norm(area_vectors(corners), axis=1) / _edge_lengths(corners).max(axis=1)


def _edge_lengths(corners: np.ndarray) -> np.ndarray:
    """Lengths of the edges that begin at each corner [mm], shape (triangle_count, 3)."""
    return np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)


def _flips(vertices: np.ndarray, triangles: np.ndarray, flat: np.ndarray) -> Iterator[bool]:
    """Flip the longest edge of each flat triangle, in place; false where a neighbour has just been changed."""
    owner = {edge: number for number, corners in enumerate(triangles.tolist()) for edge in _directed(corners)}
    longest = _edge_lengths(vertices[triangles[flat]]).argmax(axis=1)
    changed: set[int] = set()
    for number, at in zip(flat.tolist(), longest.tolist(), strict=True):
        begin, end, middle = np.roll(triangles[number], -at).tolist()
        behind = owner[end, begin]
        (apex,) = set(triangles[behind].tolist()) - {begin, end}
        if {number, behind} & changed or (apex, middle) in owner or (middle, apex) in owner:
            yield False
            continue
        triangles[number], triangles[behind] = (apex, end, middle), (middle, begin, apex)
        changed |= {number, behind}
        yield True


def _directed(corners: list[int]) -> Iterator[tuple[int, int]]:
    return zip(corners, corners[1:] + corners[:1], strict=True)


def _repeated_edges(triangles: np.ndarray) -> bool:
    edges = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    return len(np.unique(edges, axis=0)) < len(edges)


def _same_winding(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Whether triangles with the same corners have them in the same cyclic order."""
    return np.any([(np.roll(first, turn, axis=1) == second).all(axis=1) for turn in range(3)], axis=0)
