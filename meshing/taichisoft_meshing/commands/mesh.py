"""`taichisoft mesh`: from a geometry file, a STEP file or surfaces to a mesh."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from taichisoft.errors import MeshError
from taichisoft.optional_packages import require
from taichisoft_meshing.commands import mesh_options

if TYPE_CHECKING:
    from rich.console import Console

STAGES = ("meshing", "measuring", "writing")


def mesh(
    files: Annotated[list[str], mesh_options.FILE],
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            help="Folder for the whole set: meshes (.msh, .vtu, .vtk), surfaces (.stl), mesh.json and mesh-report.png; "
            "or one mesh file of those kinds.",
        ),
    ],
    surfaces: Annotated[
        bool, typer.Option("--surfaces", help="FILEs are surfaces (STL, OBJ, PLY): the outer one, then cavities.")
    ] = False,
    size: mesh_options.Size = None,
    nodes: mesh_options.Nodes = None,
    preset: mesh_options.Preset = None,
    order: mesh_options.Order = None,
    set_: mesh_options.Set = None,
    face: mesh_options.Face = None,
    solid: mesh_options.Solid = None,
    close_inlets: mesh_options.CloseInlets = False,
    section: mesh_options.Section = None,
    force: mesh_options.Force = False,
) -> None:
    """Mesh a finger, a body from CAD, or what a plug-in knows of another kind, with tetrahedra."""
    from rich.console import Console  # --help need not wait for any of these

    from taichisoft.running import print_line, print_warning
    from taichisoft_meshing.mesh_job import require_fit
    from taichisoft_meshing.mesh_process import make_mesh_apart
    from taichisoft_meshing.mesh_set import prepare, write_output
    from taichisoft_meshing.quality.quality_tables import mesh_tables

    require("taichisoft mesh", "gmsh", "matplotlib")
    if len(files) > 1 and not surfaces:
        raise MeshError(f"{files[1]}: one file is meshed at a time; several need --surfaces")
    asked = mesh_options.asked_size(size, nodes, preset)
    if surfaces:
        job = mesh_options.surfaces_job(files, set_, asked)
    else:
        job = mesh_options.geometry_job(files[0], set_, asked)
    job = mesh_options.with_options(job, order, face, solid, close_inlets)
    plane = mesh_options.section_plane(section)
    prepare(output)
    console = Console()
    with stages_bar(console, job.file.name) as stage:
        made = make_mesh_apart(job, stage)
        written = force or not made.problems
        if written:
            stage("writing")
            write_output(made, output, plane)
    console.print(mesh_tables(str(output), made.quality, made.limits, made.seconds))
    print_line(console, f"written to {output}" if written else "not written")
    for remark in (*made.remarks, *(made.problems if force else ())):
        print_warning(console, remark)
    if not force:
        require_fit(made, "--force writes the mesh all the same")


@contextmanager
def stages_bar(console: "Console", title: str) -> Iterator[Callable[[str], None]]:
    """Show a bar that vanishes in the end; the yielded function moves it on to one of STAGES."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = TextColumn("{task.description}", markup=False), BarColumn(), TextColumn("{task.fields[stage]}")
    with Progress(
        *columns, TimeElapsedColumn(), console=console, transient=True, disable=not console.is_terminal
    ) as progress:
        task = progress.add_task(title, total=len(STAGES), stage="")

        def begin(stage: str) -> None:
            progress.update(task, completed=STAGES.index(stage), stage=stage)

        yield begin
