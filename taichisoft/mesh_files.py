"""Meshes in files: tetrahedra as legacy VTK, VTU and gmsh's MSH; surfaces as STL, OBJ and PLY."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from taichisoft.errors import MeshError
from taichisoft.mesh import VolumeMesh
from taichisoft.physical_groups import cells_and_groups, with_physical_groups

VOLUME_SUFFIXES = (".msh", ".vtk", ".vtu")
SURFACE_SUFFIXES = (".stl", ".obj", ".ply")


def read_volume_mesh(path: str | Path) -> VolumeMesh:
    """Read linear tetrahedra from legacy VTK, VTU or MSH (2.2, 4.0, 4.1, text or binary).

    Nodes and tetrahedra keep the file's order, positions are in [mm]. The file's points, lines and triangles
    are ignored, except that the named physical groups of an MSH file become the mesh's groups: those of
    triangles its surface groups, those of tetrahedra its element groups. No tetrahedron is ever turned round,
    because the corotational frames depend on the order of its nodes: an inverted one is an error.

    Raises:
        MeshError: the file is missing, unreadable, of another kind, or its mesh is not fit to simulate.
    """
    path = _existing_file(path, "volume mesh", VOLUME_SUFFIXES)
    content = _parse_volume(path)
    if any(block.type == "tetra10" for block in content.cells):
        raise MeshError(f"{path}: has quadratic tetrahedra; mesh again with linear ones (element order 1)")
    elements, members = cells_and_groups(content, "tetra")
    element_groups = {name: np.sort(group).astype(np.int32) for name, group in members.items()}
    triangles, members = cells_and_groups(content, "triangle")
    surface_groups = {name: triangles[group].astype(np.int32) for name, group in members.items()}
    return VolumeMesh(str(path), content.points, elements, surface_groups, element_groups).check()


def write_volume_mesh(mesh: VolumeMesh, path: str | Path) -> None:
    """Write linear tetrahedra; reading them again gives equal nodes, bit for bit, and equal elements.

    MSH is written as text in version 2.2 and keeps the groups: there each cell names its own physical group,
    so groups may overlap and elements keep their order, which meshio's version 4.1 cannot do. VTK and VTU
    have no names: groups are not written. The file appears under its name when it is complete.

    Raises:
        MeshError: the suffix is unknown, the file cannot be written, or a group's name cannot be kept.
    """
    import meshio

    path = require_suffix(path, "volume mesh", VOLUME_SUFFIXES)
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        match path.suffix.lower():
            case ".msh":
                meshio.gmsh.write(partial, with_physical_groups(mesh), fmt_version="2.2", binary=False)
            case ".vtk":
                meshio.vtk.write(partial, meshio.Mesh(mesh.nodes, [("tetra", mesh.elements)]))
            case ".vtu":
                meshio.vtu.write(partial, meshio.Mesh(mesh.nodes, [("tetra", mesh.elements)]))
        partial.replace(path)
    except OSError as error:
        raise MeshError(f"{path}: cannot be written: {error.strerror or error}") from error
    finally:
        partial.unlink(missing_ok=True)


def read_surface(path: str | Path) -> tuple[np.ndarray, np.ndarray]:
    """Read a triangulated surface from STL, OBJ or PLY; polygons are cut into triangles.

    Vertices at exactly the same place become one (STL repeats them for every triangle), those in no triangle
    are dropped, and so are triangles with two equal corners.

    Returns:
        Vertices [mm], shape (vertex_count, 3), and triangles of vertex indices, shape (triangle_count, 3).

    Raises:
        MeshError: the file is missing, unreadable or of another kind, or has no triangle or a NaN.
    """
    import trimesh

    path = _existing_file(path, "surface", SURFACE_SUFFIXES)
    try:
        surface = trimesh.load_mesh(path, process=False)
        if not isinstance(surface, trimesh.Trimesh):
            raise ValueError("no faces")
        vertices = np.array(surface.vertices, dtype=np.float64)
        triangles = np.array(surface.faces, dtype=np.int64)
    except Exception as error:  # trimesh's parsers raise whatever a broken file makes them stumble over
        raise _unreadable(path, error) from error
    if len(triangles) == 0:
        raise MeshError(f"{path}: has no faces; a surface of triangles is needed")
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        raise MeshError(f"{path}: a face names a vertex outside 0..{len(vertices) - 1}")
    not_finite = ~np.isfinite(vertices).all(axis=1)
    if not_finite.any():
        raise MeshError(f"{path}: vertex {int(np.argmax(not_finite))} has a coordinate that is not finite")
    return _merge_equal_vertices(vertices, triangles, path)


def require_suffix(path: str | Path, what: str, suffixes: Sequence[str]) -> Path:
    """The path, when its suffix is one of those.

    Raises:
        MeshError: it is not; the message says what kind of file is meant and lists them.
    """
    path = Path(path)
    if path.suffix.lower() not in suffixes:
        raise MeshError(f"{path}: '{path.suffix}' is not a kind of {what} file; valid: {', '.join(suffixes)}")
    return path


def _existing_file(path: str | Path, what: str, suffixes: Sequence[str]) -> Path:
    path = require_suffix(path, what, suffixes)
    if not path.is_file():
        raise MeshError(f"{path}: no such file; a {what} ({', '.join(suffixes)}) is needed")
    return path


def _parse_volume(path: Path) -> Any:
    import meshio

    parsers = {".msh": meshio.gmsh.read, ".vtk": meshio.vtk.read, ".vtu": meshio.vtu.read}
    try:
        if path.suffix.lower() == ".msh":
            _refuse_truncated(path)
        content = parsers[path.suffix.lower()](path)
        if np.ndim(content.points) != 2 or content.points.shape[1] != 3:
            raise ValueError("its points do not have three coordinates")
        return content
    # The parsers raise whatever a broken file makes them stumble over, up to SystemExit.
    except (Exception, SystemExit) as error:
        raise _unreadable(path, error) from error


def _refuse_truncated(path: Path) -> None:
    """Sections of MSH close with $End...; meshio only warns when the file stops before."""
    with path.open("rb") as file:
        file.seek(max(path.stat().st_size - 200, 0))
        if not file.read().rstrip().rpartition(b"\n")[2].startswith(b"$End"):
            raise ValueError("the file stops in the middle of a section")


def _unreadable(path: Path, error: BaseException) -> MeshError:
    why = " ".join(str(error).split()) or "broken, or another kind of file"
    if "gmsh:physical" in why:  # meshio's limit: MSH 4 with all elements saved, only some of them in a group
        why = "some elements are in no physical group; save it from gmsh without 'Save all elements'"
    return MeshError(f"{path}: not readable as {path.suffix[1:].upper()}: {why}")


def _merge_equal_vertices(vertices: np.ndarray, triangles: np.ndarray, path: Path) -> tuple[np.ndarray, np.ndarray]:
    _, first, same = np.unique(vertices, axis=0, return_index=True, return_inverse=True)
    triangles = first[same.ravel()][triangles]
    whole = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
    if not whole.any():
        raise MeshError(f"{path}: every face has two equal corners; a surface of triangles is needed")
    used, corners = np.unique(triangles[whole], return_inverse=True)
    return vertices[used], corners.reshape(-1, 3).astype(np.int32)
