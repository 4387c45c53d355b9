"""`taichisoft mesh mould`: a finger to be made, and what to cast it in."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from taichisoft.errors import MeshError
from taichisoft.terminal_text import say
from taichisoft_meshing.commands import mesh_options

WALL = 6.0
"""Thickness of the mould around the finger [mm], unless another is given."""


def mould(
    file: Annotated[str, mesh_options.FILE],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder of the files.")],
    wall: Annotated[float, typer.Option(help="Thickness of the mould around the finger \\[mm].")] = WALL,
    set_: mesh_options.Set = None,
) -> None:
    """Write a finger as STEP and STL, and its mould: two halves, and the core that leaves the cavity, as STL."""
    from taichisoft_meshing.mesh_set import prepare_folder

    if not 0.0 < wall < 1000.0:
        raise MeshError(f"--wall {wall:g}: must be positive, and below 1000 mm")
    job = mesh_options.geometry_job(file, set_, {})
    prepare_folder(output)
    for name, volume in write_parts(job.kind, job.tables, job.file, output, wall).items():
        say(f"{output / name}.stl: {volume:.1f} mm^3")


def write_parts(kind: Any, tables: Mapping[str, Any], file: Path, output: Path, wall: float) -> dict[str, float]:
    """Write the parts of a geometry; see `finger.mould.write_finger`.

    Raises:
        MeshError: the geometry is not valid, or of a kind without a mould.
    """
    from taichisoft_meshing.finger.finger_parts import write_finger
    from taichisoft_meshing.finger.pneunet_finger import PneunetFinger
    from taichisoft_meshing.geometry_file import make_geometry

    geometry = make_geometry(kind, tables, file)
    if not isinstance(geometry, PneunetFinger):
        raise MeshError(f"{file}: kind = {kind!r}: there is a mould of the kind pneunet_finger alone")
    return write_finger(geometry.table, output, file.stem, wall)
