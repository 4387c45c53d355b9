"""A surface file taken apart into closed shells, each in one piece."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from taichisoft.base import warn_caller
from taichisoft.errors import MeshError
from taichisoft.mesh import enclosed_volume, read_surface

# Lengths, edges and angles of triangulated surfaces.

NEAR = 1e-6
"""Distance at which points count as one, as a share of the surface's diagonal [-]. Single precision, which STL has,
rounds coordinates to a tenth of it."""


def diagonal(vertices: np.ndarray) -> float:
    """Length of the diagonal of the box around the vertices [mm]."""
    return float(np.linalg.norm(np.ptp(vertices, axis=0)))


def area_vectors(corners: np.ndarray) -> np.ndarray:
    """Normals of triangles with these corners [mm], shape (count, 3, 3), as long as twice their areas [mm^2]."""
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def undirected_sides(triangles: np.ndarray) -> np.ndarray:
    """The sides of all triangles, the lower vertex first, shape (3 * triangle_count, 2)."""
    return np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)


def joined_sides(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The edges of a closed surface, and the two sides of triangles that each joins.

    Returns:
        Edges as vertex indices, the lower first, shape (edge_count, 2), and sides, shape (edge_count, 2): side s of
        triangle t, from its corner s to the next, has the number 3 * t + s; the lower number stands first.
    """
    edges, edge = np.unique(undirected_sides(triangles), axis=0, return_inverse=True)
    return edges, np.argsort(edge.ravel(), kind="stable").reshape(-1, 2)


def facing_sides(triangles: np.ndarray) -> np.ndarray:
    """The pairs of sides, numbered as in `joined_sides`, at edges of exactly two triangles, shape (pair_count, 2)."""
    _, edge, counts = np.unique(undirected_sides(triangles), axis=0, return_inverse=True, return_counts=True)
    edge = edge.ravel()
    two = np.flatnonzero(counts[edge] == 2)
    pairs: np.ndarray = two[np.argsort(edge[two], kind="stable")].reshape(-1, 2)
    return pairs


def angles_between(normals: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Angles [rad] between the normals, shape (triangle_count, 3), of pairs of triangles, shape (pair_count, 2)."""
    one, other = normals[pairs[:, 0]], normals[pairs[:, 1]]
    return np.arctan2(np.linalg.norm(np.cross(one, other), axis=1), np.einsum("nd,nd->n", one, other))


@dataclass(frozen=True, eq=False)
class Shell:
    """A closed surface in one piece, which faces outward: it encloses a positive volume of silicone or air.

    Attributes:
        source: its file, and its number among the file's shells; errors begin with it.
        vertices: positions [mm], shape (vertex_count, 3).
        triangles: vertex indices, shape (triangle_count, 3).
        was_inward: whether it faces inward in its file.
    """

    source: str
    vertices: np.ndarray
    triangles: np.ndarray
    was_inward: bool

    @cached_property
    def volume(self) -> float:
        """Enclosed volume [mm^3]."""
        return enclosed_volume(self.vertices, self.triangles)


def read_shells(path: Path, scale: float = 1.0) -> list[Shell]:
    """Read an STL, OBJ or PLY file of closed surfaces; `scale` is the millimetres in one unit of the file."""
    vertices, triangles = read_surface(path)
    return closed_shells(scale * vertices, triangles, str(path))


def closed_shells(vertices: np.ndarray, triangles: np.ndarray, source: str) -> list[Shell]:
    """Take a surface apart, in the order of its triangles.

    Args:
        vertices: positions [mm], shape (vertex_count, 3).
        triangles: vertex indices, shape (triangle_count, 3).
        source: begins every error and warning.
    """
    triangles = _with_merged_vertices(vertices, triangles, source)
    piece = _pieces(len(triangles), _neighbours(vertices, triangles, source))
    order = np.argsort(np.unique(piece, return_index=True)[1]).tolist()
    names = [f"{source}, shell {number + 1} of {len(order)}" for number in range(len(order))]
    named = zip(order, names if len(order) > 1 else [source], strict=True)
    return [_shell(vertices, triangles[piece == number], name) for number, name in named]


def _with_merged_vertices(vertices: np.ndarray, triangles: np.ndarray, source: str) -> np.ndarray:
    """The triangles with one vertex for all at nearly the same place, without triangles that vanish so."""
    near = NEAR * diagonal(vertices)
    pairs = cKDTree(vertices).query_pairs(near, output_type="ndarray")
    if not len(pairs):
        return triangles
    cluster = _pieces(len(vertices), pairs)
    _, first = np.unique(cluster, return_index=True)
    merged = f"{len(vertices) - len(first)} vertices lie within {near:.2g} mm of another one and are merged with it"
    warn_caller(f"{source}: {merged}")
    triangles = first[cluster][triangles]
    kept: np.ndarray = triangles[(triangles != np.roll(triangles, 1, axis=1)).all(axis=1)]
    return kept


def _neighbours(vertices: np.ndarray, triangles: np.ndarray, source: str) -> np.ndarray:
    """The two triangles at each edge, shape (edge_count, 2)."""
    edges, edge, counts = np.unique(undirected_sides(triangles), axis=0, return_inverse=True, return_counts=True)
    for wrong, what, remedy in (
        (counts > 2, "edges of more than two triangles", "remove double triangles and walls inside"),
        (counts < 2, "edges of one triangle only", "fill the hole"),
    ):
        if wrong.any():
            begin, end = np.round(vertices[edges[np.argmax(wrong)]], 3).tolist()
            raise MeshError(
                f"{source}: is not a closed surface: it has {what} ({wrong.sum()}), "
                f"the first from {begin} to {end} mm; {remedy}"
            )
    owners: np.ndarray = np.argsort(edge.ravel(), kind="stable").reshape(-1, 2) // 3
    return owners


def _shell(vertices: np.ndarray, triangles: np.ndarray, source: str) -> Shell:
    triangles = _facing_one_side(vertices, triangles, source)
    used, corners = np.unique(triangles, return_inverse=True)
    vertices, triangles = vertices[used], corners.reshape(-1, 3).astype(np.int32)
    _refuse_flat_triangles(vertices, triangles, source)
    _refuse_pinches(vertices, triangles, source)
    volume = enclosed_volume(vertices, triangles)
    if abs(volume) <= 1e-12 * np.ptp(vertices, axis=0).max() ** 3:
        raise MeshError(f"{source}: encloses no volume")
    return Shell(source, vertices, triangles if volume > 0 else np.ascontiguousarray(triangles[:, ::-1]), volume < 0)


def _facing_one_side(vertices: np.ndarray, triangles: np.ndarray, source: str) -> np.ndarray:
    """The triangles, all of which face one side of a closed shell."""
    import trimesh  # takes long, and fingers do without

    mesh = trimesh.Trimesh(vertices, triangles, process=False)
    if mesh.is_winding_consistent:
        return triangles
    trimesh.repair.fix_winding(mesh)
    if not mesh.is_winding_consistent:
        raise MeshError(f"{source}: has one side only, like a Moebius strip or a Klein bottle; it encloses nothing")
    warn_caller(f"{source}: triangles that face the other way than their neighbours are turned round")
    return np.ascontiguousarray(mesh.faces, dtype=triangles.dtype)


def _refuse_flat_triangles(vertices: np.ndarray, triangles: np.ndarray, source: str) -> None:
    corners = vertices[triangles]
    longest = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).max(axis=1)
    flat = np.flatnonzero(np.linalg.norm(area_vectors(corners), axis=1) <= NEAR * diagonal(vertices) * longest)
    if len(flat):
        place = np.round(corners[flat[0]].mean(axis=0), 3).tolist()
        raise MeshError(
            f"{source}: triangle {flat[0]} at {place} mm has no area ({len(flat)} such triangles); "
            "remove them in the program that the surface comes from"
        )


def _refuse_pinches(vertices: np.ndarray, triangles: np.ndarray, source: str) -> None:
    """Around each vertex the triangles must be one fan: two that meet in a tip only are a joint without strength."""
    _, begin = joined_sides(triangles)  # a corner has the number of the side that begins at it
    end = begin - begin % 3 + (begin + 1) % 3
    # Neighbours pass their common edge in opposite directions.
    fan = _pieces(triangles.size, np.vstack([np.column_stack([begin[:, i], end[:, 1 - i]]) for i in (0, 1)]))
    fans = np.unique(np.column_stack([triangles.ravel(), fan]), axis=0)[:, 0]
    pinched = np.flatnonzero(np.bincount(fans) > 1)
    if len(pinched):
        place = np.round(vertices[pinched[0]], 3).tolist()
        raise MeshError(f"{source}: touches itself in a single point at {place} mm; widen the joint or part it")


def _pieces(count: int, pairs: np.ndarray) -> np.ndarray:
    """Number of the piece of each of `count` things, of which pairs, shape (pair_count, 2), are joined."""
    graph = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(count, count))
    found: np.ndarray = connected_components(graph, directed=False)[1]
    return found
