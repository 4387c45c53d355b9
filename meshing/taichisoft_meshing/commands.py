"""`taichisoft mesh`: from a geometry file to a mesh file."""

import math
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from taichisoft.errors import MeshError

if TYPE_CHECKING:
    from rich.table import Table

    from taichisoft.mesh import VolumeMesh


def mesh(
    finger: Annotated[str, typer.Argument(metavar="FINGER.toml", help="Finger file, or the name of a shipped one.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Mesh file to write: .msh, .vtk or .vtu.")],
    size: Annotated[
        float | None,
        typer.Option(metavar="MM", help="Largest element size, instead of the file's mesh.largest."),
    ] = None,
) -> None:
    """Mesh a finger, or what a plug-in knows of another kind, with tetrahedra."""
    from rich.console import Console  # --help need not wait for any of these

    from taichisoft.mesh_files import VOLUME_SUFFIXES, require_suffix, write_volume_mesh
    from taichisoft.shipped import find_file
    from taichisoft_meshing.geometry_file import mesh_geometry, read_geometry

    require_suffix(output, "volume mesh", VOLUME_SUFFIXES)  # before the work, not after it
    if size is not None and not 0.0 < size < math.inf:
        raise MeshError(f"--size {size:g}: must be a positive, finite number of millimetres")
    file = find_file(finger, "fingers", (".toml",), error=MeshError)
    geometry = read_geometry(file)
    try:
        output.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise MeshError(f"--output {output}: its folder cannot be made: {error.strerror or error}") from error
    start = time.perf_counter()
    meshed = mesh_geometry(geometry, size, file)
    seconds = time.perf_counter() - start
    write_volume_mesh(meshed, output)
    Console().print(_report(meshed, str(output), seconds))


def _report(meshed: "VolumeMesh", title: str, seconds: float) -> "Table":
    import numpy as np
    from rich.table import Table
    from rich.text import Text

    from taichisoft.mapped_surface import enclosed_volume
    from taichisoft.mesh import tetrahedron_volumes
    from taichisoft_meshing.quality import longest_edges, radius_ratios

    ratios = radius_ratios(meshed.nodes, meshed.elements)
    cavities = {name: group for name, group in meshed.surface_groups.items() if name.startswith("cavity")}
    table = Table(title=Text(title), show_header=False)
    table.add_column()
    table.add_column(justify="right")
    table.add_column()
    for label, value, unit in (
        ("nodes", f"{len(meshed.nodes)}", ""),
        ("tetrahedra", f"{len(meshed.elements)}", ""),
        ("silicone", f"{tetrahedron_volumes(meshed.nodes, meshed.elements).sum():.1f}", "mm³"),
        *((name, f"{enclosed_volume(meshed.nodes, group):.1f}", "mm³") for name, group in cavities.items()),
        ("radius ratio, smallest", f"{ratios.min():.3f}", ""),
        ("radius ratio, median", f"{np.median(ratios):.3f}", ""),
        ("longest edge", f"{longest_edges(meshed.nodes, meshed.elements).max():.1f}", "mm"),
        ("time", f"{seconds:.2f}", "s"),
    ):
        table.add_row(label, value, unit)
    return table
