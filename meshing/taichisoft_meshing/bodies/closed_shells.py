"""A surface file taken apart into closed shells, each in one piece."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from taichisoft.errors import MeshError
from taichisoft.meshes.surface import enclosed_volume
from taichisoft.meshes.surface_files import read_surface
from taichisoft_meshing.bodies.surface_geometry import joined_sides, undirected_sides
from taichisoft_meshing.bodies.surface_repair import merge_near_vertices, replace_flat_triangles, wind_alike


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
    """Read a file of one or more closed surfaces; faults that can be mended are mended, with a warning.

    Args:
        path: path of an STL, OBJ or PLY file.
        scale: millimetres in one unit of the file.

    Raises:
        MeshError: the file is missing, empty, of another kind, has a NaN, or a surface in it is not closed or touches
            itself.
    """
    vertices, triangles = read_surface(path)
    return closed_shells(scale * vertices, triangles, str(path))


def closed_shells(vertices: np.ndarray, triangles: np.ndarray, source: str) -> list[Shell]:
    """Take a surface apart, in the order of its triangles.

    Args:
        vertices: positions [mm], shape (vertex_count, 3).
        triangles: vertex indices, shape (triangle_count, 3).
        source: begins every error and warning.

    Raises:
        MeshError: a part is not closed, has one side only, touches itself, or encloses nothing.
    """
    triangles = merge_near_vertices(vertices, triangles, source)
    first, second = _neighbours(vertices, triangles, source)
    graph = coo_matrix((np.ones(len(first)), (first, second)), shape=(len(triangles), len(triangles)))
    count, piece = connected_components(graph, directed=False)
    order = np.argsort(np.unique(piece, return_index=True)[1])
    names = [source] if count == 1 else [f"{source}, shell {number + 1} of {count}" for number in range(count)]
    return [
        _shell(vertices, triangles[piece == number], name) for number, name in zip(order.tolist(), names, strict=True)
    ]


def _neighbours(vertices: np.ndarray, triangles: np.ndarray, source: str) -> tuple[np.ndarray, np.ndarray]:
    """The two triangles at each edge.

    Raises:
        MeshError: an edge has fewer or more than two.
    """
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
    owners = np.argsort(edge.ravel(), kind="stable") // 3
    return owners[::2], owners[1::2]


def _shell(vertices: np.ndarray, triangles: np.ndarray, source: str) -> Shell:
    triangles = replace_flat_triangles(vertices, wind_alike(vertices, triangles, source), source)
    used, corners = np.unique(triangles, return_inverse=True)
    vertices, triangles = vertices[used], corners.reshape(-1, 3).astype(np.int32)
    _refuse_pinches(vertices, triangles, source)
    volume = enclosed_volume(vertices, triangles)
    extent = np.ptp(vertices, axis=0).max()
    if abs(volume) <= 1e-12 * extent**3:
        raise MeshError(f"{source}: encloses no volume")
    return Shell(source, vertices, triangles if volume > 0 else np.ascontiguousarray(triangles[:, ::-1]), volume < 0)


def _refuse_pinches(vertices: np.ndarray, triangles: np.ndarray, source: str) -> None:
    """Around each vertex the triangles must be one fan: two that meet in a tip only are a joint without strength."""
    _, sides = joined_sides(triangles)
    begin = sides  # a corner has the number of the side that begins at it
    end = sides - sides % 3 + (sides + 1) % 3
    # Neighbours pass their common edge in opposite directions.
    links = np.vstack([np.column_stack([begin[:, 0], end[:, 1]]), np.column_stack([end[:, 0], begin[:, 1]])])
    graph = coo_matrix((np.ones(len(links)), links.T), shape=(triangles.size, triangles.size))
    fan = connected_components(graph, directed=False)[1]
    fans = np.unique(np.column_stack([triangles.ravel(), fan]), axis=0)[:, 0]
    pinched = np.flatnonzero(np.bincount(fans) > 1)
    if len(pinched):
        place = np.round(vertices[pinched[0]], 3).tolist()
        raise MeshError(f"{source}: touches itself in a single point at {place} mm; widen the joint or part it")
