"""`taichisoft mesh`: from a finger file to a mesh file."""

import time
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from taichisoft.errors import MeshError
from taichisoft.mapped_surface import enclosed_volume
from taichisoft.mesh import VolumeMesh, tetrahedron_volumes
from taichisoft.mesh_files import VOLUME_SUFFIXES, require_suffix, write_volume_mesh
from taichisoft.shipped import find_file
from taichisoft_meshing.finger_file import read_finger
from taichisoft_meshing.gmsh_mesher import mesh_finger
from taichisoft_meshing.quality import longest_edges, radius_ratios


def mesh(
    finger: Annotated[str, typer.Argument(metavar="FINGER.toml", help="Finger file, or the name of a shipped one.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Mesh file to write: .msh, .vtk or .vtu.")],
    size: Annotated[
        float | None,
        typer.Option(metavar="MM", help="Largest element size, instead of the file's mesh.largest."),
    ] = None,
) -> None:
    """Mesh a finger with tetrahedra."""
    require_suffix(output, "volume mesh", VOLUME_SUFFIXES)  # before the work, not after it
    parameters = read_finger(find_file(finger, "fingers", (".toml",), error=MeshError), size)
    try:
        output.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise MeshError(f"--output {output}: its folder cannot be made: {error.strerror or error}") from error
    start = time.perf_counter()
    meshed = mesh_finger(parameters)
    seconds = time.perf_counter() - start
    write_volume_mesh(meshed, output)
    Console().print(_report(meshed, str(output), seconds))


def _report(meshed: VolumeMesh, title: str, seconds: float) -> Table:
    ratios = radius_ratios(meshed.nodes, meshed.elements)
    air = enclosed_volume(meshed.nodes, meshed.surface_groups["cavity"])
    table = Table(title=Text(title), show_header=False)
    table.add_column()
    table.add_column(justify="right")
    table.add_column()
    for label, value, unit in (
        ("nodes", f"{len(meshed.nodes)}", ""),
        ("tetrahedra", f"{len(meshed.elements)}", ""),
        ("silicone", f"{tetrahedron_volumes(meshed.nodes, meshed.elements).sum():.1f}", "mm³"),
        ("cavity", f"{air:.1f}", "mm³"),
        ("radius ratio, smallest", f"{ratios.min():.3f}", ""),
        ("radius ratio, median", f"{np.median(ratios):.3f}", ""),
        ("longest edge", f"{longest_edges(meshed.nodes, meshed.elements).max():.1f}", "mm"),
        ("time", f"{seconds:.2f}", "s"),
    ):
        table.add_row(label, value, unit)
    return table
