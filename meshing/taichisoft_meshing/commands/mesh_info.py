"""`taichisoft mesh info`: the figures of any mesh or surface that can be read, and the faces of a STEP body."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from taichisoft.errors import GoalMissed
from taichisoft_meshing.commands import mesh_options

if TYPE_CHECKING:
    from rich.console import Console

    from taichisoft.meshes import SectionPlane, VolumeMesh


def mesh_info(
    file: Annotated[
        str,
        typer.Argument(
            metavar="FILE",
            help="Mesh (.msh, .vtk, .vtu), surface (.stl, .obj, .ply), STEP body (.step, .stp), or a shipped mesh.",
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="File for the figures (.json), or for a picture of a mesh or of a body's faces (.png).",
        ),
    ] = None,
    section: mesh_options.Section = None,
) -> None:
    """Show the figures of a mesh or surface (exit code 1 when it is not fit), or the faces of a STEP body."""
    from rich.console import Console  # --help need not wait for any of these

    from taichisoft.errors import MeshError
    from taichisoft.meshes import SURFACE_SUFFIXES, VOLUME_SUFFIXES, require_suffix
    from taichisoft.running import print_line
    from taichisoft.scenes import find_file
    from taichisoft_meshing.geometry_file import STEP_SUFFIXES
    from taichisoft_meshing.mesh_set import prepare_folder
    from taichisoft_meshing.quality.quality_limits import summary

    suffixes = (*VOLUME_SUFFIXES, *SURFACE_SUFFIXES, *STEP_SUFFIXES)
    path = require_suffix(find_file(file, "meshes", suffixes, error=MeshError), "mesh or surface", suffixes)
    plane = mesh_options.section_plane(section)
    if plane is not None and path.suffix.lower() not in VOLUME_SUFFIXES:
        raise MeshError(f"--section {section}: has no effect on {path}; only meshes (.msh, .vtk, .vtu) are cut open")
    surface = path.suffix.lower() in SURFACE_SUFFIXES
    if output is not None:
        require_suffix(output, "report", (".json",) if surface else (".json", ".png"))
        prepare_folder(output.parent, output)
    console = Console()
    if path.suffix.lower() in STEP_SUFFIXES:
        problems = _show_body(console, path, output)
    else:
        problems = _show_surface(console, path, output) if surface else _show_mesh(console, path, output, plane)
    if output is not None:
        print_line(console, f"written to {output}")
    if problems:
        raise GoalMissed(f"{path}: {summary(problems)}")


def _show_mesh(console: "Console", path: Path, output: Path | None, section: "SectionPlane | None") -> list[str]:
    """Print and write the figures of a mesh; returns its problems."""
    from taichisoft.errors import MeshError
    from taichisoft.meshes import read_unchecked_mesh
    from taichisoft.running import print_warning
    from taichisoft_meshing.mesh_record import mesh_figures, write_record
    from taichisoft_meshing.quality.mesh_quality import measure
    from taichisoft_meshing.quality.quality_limits import QualityLimits, cautions, faults, missed_limits
    from taichisoft_meshing.quality.quality_tables import mesh_tables
    from taichisoft_meshing.quality.report_picture import draw_report

    mesh = read_unchecked_mesh(path)
    refused = []
    try:
        mesh.check()
    except MeshError as error:
        if not _can_be_measured(mesh):
            raise
        refused = [str(error).removeprefix(f"{path}: ")]
    quality, limits = measure(mesh), QualityLimits()
    problems, remarks = refused + faults(quality), cautions(quality) + missed_limits(quality, limits)
    console.print(mesh_tables(path.name, quality, limits))
    for remark in remarks:
        print_warning(console, remark)
    if output is not None and output.suffix.lower() == ".png":
        draw_report(mesh, quality, limits, path.name, output, section)
    elif output is not None:
        figures = mesh_figures(mesh, quality)
        write_record({"file": path.name, **figures, "problems": problems, "remarks": remarks}, output)
    return problems


def _can_be_measured(mesh: "VolumeMesh") -> bool:
    import numpy as np

    from taichisoft.meshes import LARGEST

    inside = (mesh.elements >= 0).all() and (mesh.elements < len(mesh.nodes)).all()
    return bool(mesh.elements.size and inside and (np.abs(mesh.nodes) <= LARGEST).all())


def _show_surface(console: "Console", path: Path, output: Path | None) -> list[str]:
    """Print and write the figures of a surface; returns its problems."""
    import numpy as np

    from taichisoft.meshes import read_surface
    from taichisoft.plausible import SIZE, implausible
    from taichisoft.running import print_warning
    from taichisoft_meshing.mesh_record import surface_figures, write_record
    from taichisoft_meshing.quality.mesh_surfaces import connected_pieces, measure_surface
    from taichisoft_meshing.quality.quality_tables import surface_table

    vertices, triangles = read_surface(path)
    surface = measure_surface(path.stem, vertices, triangles)
    pieces, extent = len(connected_pieces(triangles, len(vertices))), np.ptp(vertices, axis=0)
    problems = [f"is not closed: {surface.open_edges} edges do not join two triangles"] if surface.open_edges else []
    console.print(surface_table(path.name, surface, pieces, extent))
    if caution := implausible("its longest side", float(extent.max()), SIZE):
        print_warning(console, caution)
    if output is not None:
        figures = {**surface_figures(surface), "volume_mm3": surface.volume, "pieces": pieces}
        record = {"file": path.name, **figures, "extent_mm": extent.tolist(), "problems": problems}
        write_record(record, output)
    return problems


def _show_body(console: "Console", path: Path, output: Path | None) -> list[str]:
    """Print the solids, faces and openings of a STEP body, and write or draw them."""
    from taichisoft.running import print_warning
    from taichisoft_meshing.bodies.body_tables import body_tables
    from taichisoft_meshing.bodies.face_picture import draw_faces
    from taichisoft_meshing.mesh_process import read_step_apart
    from taichisoft_meshing.mesh_record import body_figures, write_record

    body = read_step_apart(path)
    console.print(body_tables(body))
    if body.doubt:
        print_warning(console, body.doubt)
    if output is not None and output.suffix.lower() == ".png":
        draw_faces(body, output)
    elif output is not None:
        write_record({"file": path.name, **body_figures(body)}, output)
    return []
