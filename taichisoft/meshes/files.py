"""Meshes in files: tetrahedra as legacy VTK, VTU and gmsh's MSH."""

from pathlib import Path

from taichisoft.atomic_file import atomic_file
from taichisoft.errors import MeshError
from taichisoft.meshes.file_kind import existing_file, require_suffix, unreadable
from taichisoft.meshes.meshio_reader import read_with_meshio
from taichisoft.meshes.msh_reader import is_msh41, read_msh41
from taichisoft.meshes.volume_mesh import VolumeMesh
from taichisoft.meshes.writers import write_msh, write_vtk, write_vtu

VOLUME_SUFFIXES = (".msh", ".vtk", ".vtu")


def read_volume_mesh(path: str | Path) -> VolumeMesh:
    """Read tetrahedra of four or ten nodes from legacy VTK, VTU or MSH (2.2, 4.0, 4.1, text or binary).

    Nodes and tetrahedra keep the file's order, in MSH 4.1 that of their numbers, but ten nodes of a tetrahedron come in
    VTK's order; positions are in [mm]. Named groups of triangles (the physical groups of MSH, cell data called
    "group:NAME" in VTK and VTU) become the mesh's surface groups, with four triangles for one of six nodes; groups of
    tetrahedra become its element groups; the file's points, lines and other triangles are ignored. No tetrahedron is
    ever turned round, because the corotational frames depend on the order of its nodes: an inverted one is an error.

    Args:
        path: file whose suffix, .msh, .vtk or .vtu, says the format.

    Raises:
        MeshError: the file is missing, unreadable, of another kind, or its mesh is not fit to simulate.
    """
    return read_unchecked_mesh(path).check()


def read_unchecked_mesh(path: str | Path) -> VolumeMesh:
    """Read a mesh as `read_volume_mesh` does, without checking that it is fit to simulate.

    Raises:
        MeshError: the file is missing, unreadable or of another kind, or has other cells than tetrahedra.
    """
    path = existing_file(path, "volume mesh", VOLUME_SUFFIXES)
    try:
        content = read_msh41(path) if path.suffix.lower() == ".msh" and is_msh41(path) else read_with_meshio(path)
    # For a broken file the parsers raise exceptions of any kind, up to SystemExit.
    except (Exception, SystemExit) as error:
        raise unreadable(path, error) from error
    return content.mesh(str(path))


def write_volume_mesh(mesh: VolumeMesh, path: str | Path) -> None:
    """Write tetrahedra of four or ten nodes; reading them again gives equal nodes, bit for bit, and equal elements.

    MSH (4.1, as text) and VTU keep the groups: a triangle in several surface groups stands in the file once, and each
    group comes back in the order of the first that names its triangles. VTU has no place for a group of nothing.
    Triangles are written with three nodes, four of them on each side of a tetrahedron of ten nodes. Legacy VTK is for
    other programs: it has the tetrahedra alone. The file appears under its name when it is complete.

    Args:
        mesh: mesh of tetrahedra.
        path: file whose suffix, .msh, .vtu or .vtk, says the format.

    Raises:
        MeshError: the suffix is unknown, the file cannot be written, or a group cannot be kept.
    """
    path = require_suffix(path, "volume mesh", VOLUME_SUFFIXES)
    write = {".msh": write_msh, ".vtk": write_vtk, ".vtu": write_vtu}[path.suffix.lower()]
    with atomic_file(path, MeshError) as partial:
        write(mesh, partial)
