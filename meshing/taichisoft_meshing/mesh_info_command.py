"""`taichisoft mesh-info`: the figures of any mesh or surface that can be read."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from taichisoft.errors import GoalMissed

if TYPE_CHECKING:
    from rich.console import Console

    from taichisoft.meshes.volume_mesh import VolumeMesh


def mesh_info(
    file: Annotated[
        str,
        typer.Argument(
            metavar="FILE", help="Mesh (.msh, .vtk, .vtu) or surface (.stl, .obj, .ply), or a shipped mesh."
        ),
    ],
) -> None:
    """Show the figures of a mesh or a surface; the exit code is 1 when it is not fit to simulate."""
    from rich.console import Console  # --help need not wait for any of these

    from taichisoft.errors import MeshError
    from taichisoft.meshes.file_kind import require_suffix
    from taichisoft.meshes.files import VOLUME_SUFFIXES
    from taichisoft.meshes.surface_files import SURFACE_SUFFIXES
    from taichisoft.scenes.shipped import find_file

    suffixes = (*VOLUME_SUFFIXES, *SURFACE_SUFFIXES)
    path = require_suffix(find_file(file, "meshes", suffixes, error=MeshError), "mesh or surface", suffixes)
    show = _show_surface if path.suffix.lower() in SURFACE_SUFFIXES else _show_mesh
    problems = show(Console(), path)
    if problems:
        more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
        raise GoalMissed(f"{path}: {problems[0]}{more}")


def _show_mesh(console: "Console", path: Path) -> list[str]:
    """Print; returns what speaks against the mesh."""
    from taichisoft.errors import MeshError
    from taichisoft.meshes.files import read_unchecked_mesh
    from taichisoft_meshing.mesh_display import print_remark
    from taichisoft_meshing.quality.check import cautions, faults, missed_limits
    from taichisoft_meshing.quality.limits import QualityLimits
    from taichisoft_meshing.quality.mesh_quality import measure
    from taichisoft_meshing.quality.table import mesh_tables

    mesh = read_unchecked_mesh(path)
    refused = []
    try:
        mesh.check()
    except MeshError as error:
        if not _can_be_measured(mesh):
            raise
        refused = [str(error).removeprefix(f"{path}: ")]
    quality, limits = measure(mesh), QualityLimits()
    console.print(mesh_tables(path.name, quality, limits))
    for remark in cautions(quality) + missed_limits(quality, limits):
        print_remark(console, remark)
    return refused + faults(quality)


def _can_be_measured(mesh: "VolumeMesh") -> bool:
    import numpy as np

    inside = (mesh.elements >= 0).all() and (mesh.elements < len(mesh.nodes)).all()
    return bool(mesh.elements.size and inside and np.isfinite(mesh.nodes).all())


def _show_surface(console: "Console", path: Path) -> list[str]:
    """Print; returns what speaks against the surface."""
    import numpy as np

    from taichisoft.meshes.surface_files import read_surface
    from taichisoft_meshing.quality.shells import connected_triangles
    from taichisoft_meshing.quality.surfaces import measure_surface
    from taichisoft_meshing.quality.table import surface_table

    vertices, triangles = read_surface(path)
    surface = measure_surface(path.stem, vertices, triangles)
    pieces = len(connected_triangles(triangles, len(vertices)))
    console.print(surface_table(path.name, surface, pieces, np.ptp(vertices, axis=0)))
    return [f"is not closed: {surface.open_edges} edges do not join two triangles"] if surface.open_edges else []
