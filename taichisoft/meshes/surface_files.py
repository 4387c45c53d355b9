"""Surfaces in files: triangles as STL, OBJ and PLY."""

import re
from pathlib import Path

import numpy as np

from taichisoft.atomic_file import atomic_file
from taichisoft.errors import MeshError
from taichisoft.kept_files import kept_arrays, source_of
from taichisoft.meshes.coordinates import refuse_coordinates
from taichisoft.meshes.file_kind import existing_file, unreadable

SURFACE_SUFFIXES = (".stl", ".obj", ".ply")


def read_surface(path: str | Path) -> tuple[np.ndarray, np.ndarray]:
    """Read a triangulated surface from STL, OBJ or PLY; polygons are cut into triangles.

    Vertices at exactly the same place become one (STL repeats them for every triangle), those in no triangle
    are dropped, and so are triangles with two equal corners. What was read is kept for the next process.

    Returns:
        Vertices [mm], shape (vertex_count, 3), and triangles of vertex indices, shape (triangle_count, 3).

    Raises:
        MeshError: the file is missing, unreadable or of another kind, or has no triangle or a NaN.
    """
    path = existing_file(path, "surface", SURFACE_SUFFIXES)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise unreadable(path, error) from error
    depends_on = [source_of(__file__), path.suffix.lower().encode(), content]
    vertices, triangles = kept_arrays("surfaces", depends_on, lambda: _parsed(path))
    return vertices, triangles


def _parsed(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """What trimesh reads from a file, which takes half a second to import."""
    import trimesh

    try:
        if path.suffix.lower() == ".ply":
            _refuse_truncated_ply(path.read_bytes())
        surface = trimesh.load_mesh(path, process=False)
        if not isinstance(surface, trimesh.Trimesh):
            raise ValueError("no faces")
        vertices = np.array(surface.vertices, dtype=np.float64)
        triangles = np.array(surface.faces, dtype=np.int64)
    except Exception as error:  # trimesh's parsers raise exceptions of any kind for a broken file
        raise unreadable(path, error) from error
    if len(triangles) == 0:
        raise MeshError(f"{path}: has no faces; a surface of triangles is needed")
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        raise MeshError(f"{path}: a face names a vertex outside 0..{len(vertices) - 1}")
    refuse_coordinates(vertices, path, "vertex")
    return _merge_equal_vertices(vertices, triangles, path)


def write_stl(vertices: np.ndarray, triangles: np.ndarray, path: Path) -> None:
    """Write a surface as STL in text, every digit of its vertices kept; it appears under its name when complete.

    Args:
        vertices: positions [mm], shape (vertex_count, 3).
        triangles: vertex indices, shape (triangle_count, 3).
        path: file to write.

    Raises:
        MeshError: the file cannot be written.
    """
    a, b, c = np.moveaxis(vertices[triangles], 1, 0)
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)
    with atomic_file(path, MeshError) as partial, partial.open("w", encoding="ascii", newline="\n") as file:
        file.write(f"solid {path.stem}\n")
        for normal, corners in zip(normals.tolist(), vertices[triangles].tolist(), strict=True):
            file.write("facet normal {!r} {!r} {!r}\n outer loop\n".format(*normal))
            for corner in corners:
                file.write("  vertex {!r} {!r} {!r}\n".format(*corner))
            file.write(" endloop\nendfacet\n")
        file.write(f"endsolid {path.stem}\n")


def _refuse_truncated_ply(content: bytes) -> None:
    """Refuse a truncated PLY file in text: trimesh silently drops the missing end."""
    head, _, body = content.partition(b"end_header")
    if b"format ascii" in head:
        announced = sum(map(int, re.findall(rb"^element\s+\S+\s+(\d+)", head, re.MULTILINE)))
        there = sum(bool(line.strip()) for line in body.splitlines())
        if there < announced:
            raise ValueError(f"it says that it has {announced} vertices and faces, but only {there} are there")


def _merge_equal_vertices(vertices: np.ndarray, triangles: np.ndarray, path: Path) -> tuple[np.ndarray, np.ndarray]:
    _, first, same = np.unique(vertices, axis=0, return_index=True, return_inverse=True)
    triangles = first[same.ravel()][triangles]
    whole = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
    if not whole.any():
        raise MeshError(f"{path}: every face has two equal corners; a surface of triangles is needed")
    used, corners = np.unique(triangles[whole], return_inverse=True)
    return vertices[used], corners.reshape(-1, 3).astype(np.int32)
