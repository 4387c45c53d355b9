"""`taichisoft mesh`: from a geometry file, a STEP file or surfaces to a mesh."""

import logging
import math
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from taichisoft.base import require, warn_caller
from taichisoft.errors import MeshError, SceneError
from taichisoft.mesh import VolumeMesh
from taichisoft_meshing import mesh_command
from taichisoft_meshing.geometry_file import read_tables
from taichisoft_meshing.mesh_job import MeshJob, require_fit
from taichisoft_meshing.mesh_process import make_mesh_apart
from taichisoft_meshing.mesh_record import cache_folder, keep_mesh, kept_mesh

if TYPE_CHECKING:
    from rich.console import Console

    from taichisoft.mesh import SectionPlane

# The options that say what is meshed and how fine, alike in `taichisoft mesh` and in sweeps of meshes.

FILE = typer.Argument(
    metavar="FILE", help="Geometry file (TOML), STEP file, or the name of a shipped finger such as tutorial."
)
Size = Annotated[
    float | None, typer.Option(metavar="MM", help="Largest element size, instead of the file's mesh.largest.")
]
Nodes = Annotated[
    int | None, typer.Option(metavar="N", help="Choose the size so that there are about so many nodes (within 15 %).")
]
Preset = Annotated[str | None, typer.Option(metavar="NAME", help="A size by name: coarse, medium or fine.")]
Set = Annotated[
    list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Override a value of the file (repeatable).")
]
Order = Annotated[
    int | None, typer.Option(metavar="1|2", help="2: tetrahedra of ten nodes, whose sides follow curved surfaces.")
]
Face = Annotated[
    list[str] | None,
    typer.Option(metavar="N=NAME", help="Face N of a STEP body is in the surface group NAME (repeatable)."),
]
Solid = Annotated[
    list[str] | None,
    typer.Option(metavar="N=NAME", help="Solid N of a STEP body is the element group NAME."),
]
CloseInlets = Annotated[
    bool, typer.Option("--close-inlets", help="Close the chambers of a STEP body that are open to the outside.")
]
Section = Annotated[
    str | None,
    typer.Option(
        metavar="PLANE", help="Plane that cuts the mesh open in pictures \\[mm]: y=0, z<12.5 (what is kept), x+2*y=30."
    ),
]
Force = Annotated[bool, typer.Option("--force", help="Write a mesh that misses a limit of \\[quality], too.")]


def geometry_job(name: str, overrides: Sequence[str] | None, asked: Mapping[str, Any]) -> "MeshJob":
    """Prepare to mesh a geometry file, a STEP file or a shipped finger.

    Args:
        name: the path of the file, or the name of the finger.
        overrides: texts "key=value" for the tables of the file.
        asked: the result of `asked_size`.

    Raises:
        MeshError: the file does not exist, or an override is not valid.
    """
    from taichisoft.mesh import SURFACE_SUFFIXES
    from taichisoft.scene import find_file
    from taichisoft_meshing.geometry_file import read_tables
    from taichisoft_meshing.mesh_job import MeshJob

    file = find_file(name, "fingers", (".toml",), error=MeshError)
    if file.suffix.lower() in SURFACE_SUFFIXES:
        raise MeshError(f"{name}: is not a geometry file (.toml); --surfaces meshes it as it is")
    kind, tables = read_tables(file)
    return MeshJob(kind, overridden(tables, overrides), file, asked)


def surfaces_job(names: Sequence[str], overrides: Sequence[str] | None, asked: Mapping[str, Any]) -> "MeshJob":
    """Prepare to mesh surfaces as a geometry file beside the first one would.

    Args:
        names: paths of the outer surface, then of cavities.
        overrides: texts "key=value" for the tables of the geometry file.
        asked: the result of `asked_size`.
    """
    from taichisoft_meshing.mesh_job import MeshJob

    first, *others = (Path(name).expanduser() for name in names)
    cavities = [os.path.relpath(cavity, first.parent) for cavity in others]
    tables = {"outer": first.name, "cavity": cavities}
    return MeshJob("surfaces", overridden(tables, overrides), first, asked)


def with_options(
    job: "MeshJob", order: int | None, faces: Sequence[str] | None, solids: Sequence[str] | None, close_inlets: bool
) -> "MeshJob":
    """A job with what the options of the same names say in its tables.

    Raises:
        MeshError: a face or solid is not of the form NUMBER=NAME.
    """

    changes: dict[str, Any] = {}
    for key, numbered in (("faces", faces), ("solids", solids)):
        for text in numbered or ():
            number, _, name = text.partition("=")
            if not number.strip().isdecimal() or not name.strip():
                raise MeshError(f"--{key[:-1]} {text}: must look like 7=base: a number and the name of its group")
            groups = changes.setdefault(key, {})
            if key == "faces":
                groups.setdefault(name.strip(), []).append(int(number))
            else:
                groups[name.strip()] = int(number)
    if order is not None:
        changes["mesh"] = {"order": order}
    if close_inlets:
        changes["close_inlets"] = True
    return replace(job, tables=merge_tables(job.tables, changes))


def section_plane(text: str | None) -> "SectionPlane | None":
    """The plane of the option `--section`.

    Raises:
        MeshError: it is not written as a plane.
    """
    from taichisoft.mesh import SectionPlane

    return None if text is None else SectionPlane.parse(text)


def asked_size(size: float | None, nodes: int | None, preset: str | None) -> dict[str, Any]:
    """The one of the three options that was given, by its name; empty when none was.

    Raises:
        MeshError: the value is out of range, or two options were given.
    """
    asked = {name: value for name, value in (("size", size), ("nodes", nodes), ("preset", preset)) if value is not None}
    if len(asked) > 1:
        raise MeshError(f"{' and '.join(f'--{name}' for name in asked)}: only one of them can be given")
    if size is not None and not 0.0 < size < math.inf:
        raise MeshError(f"--size {size:g}: must be a positive, finite number of millimetres")
    if nodes is not None:
        from taichisoft_meshing.size_search import refuse_nodes

        refuse_nodes(nodes, f"--nodes {nodes}")
    return asked


def overridden(tables: Mapping[str, Any], overrides: Sequence[str] | None) -> dict[str, Any]:
    """A copy of the tables with the values of "key=value" in their places.

    Raises:
        MeshError: an override has no "=", or leads to no place.
    """
    import copy

    from taichisoft.scene import apply_override

    changed = copy.deepcopy(dict(tables))
    for override in overrides or ():
        try:
            apply_override(changed, override, "body.width=21", "the file")
        except SceneError as error:
            raise MeshError(str(error)) from error
    return changed


# Meshes for scenes that name a geometry file: made when they are first needed, and kept.

LOGGER = logging.getLogger("taichisoft.meshing")
DIGITS = 16  # of the hash, in the file name of a kept mesh


def mesh_for_scene(
    file: Path,
    size: float | None = None,
    preset: str | None = None,
    nodes: int | None = None,
    order: int | None = None,
    set: Mapping[str, Any] | None = None,
) -> VolumeMesh:
    """The mesh for a scene; the same request gives the same mesh, whether it is made now or was made before.

    Args:
        file: the geometry file.
        size: length of the largest element [mm].
        preset: name of one of the geometry's sizes.
        nodes: approximate number of nodes.
        order: 1 or 2, instead of the geometry's `mesh.order`.
        set: tables that replace the file's, key by key.

    Raises:
        MeshError: the file, the request or the mesh is not valid.
        PluginError: the plug-in of its kind failed.
    """
    kind, tables = read_tables(file)
    possible = {"size": size, "preset": preset, "nodes": nodes}
    asked: dict[str, Any] = {key: value for key, value in possible.items() if value is not None}
    wish = "".join(f", {key} {value}" for key, value in asked.items())
    tables = merge_tables(tables, set or {})
    if order is not None:
        tables = merge_tables(tables, {"mesh": {"order": order}})
    job = MeshJob(kind, tables, file, asked)
    path = _cache_path(job)
    mesh = kept_mesh(path)
    if mesh is not None:
        LOGGER.info("mesh of %s%s: %d nodes, made before (%s)", file, wish, len(mesh.nodes), path)
    else:
        LOGGER.info("meshing %s%s", file, wish)
        start = time.perf_counter()
        made = make_mesh_apart(job)
        require_fit(made, "other limits in its [quality]")
        for remark in made.remarks:
            warn_caller(f"mesh of {file}: {remark}")
        mesh = keep_mesh(made.mesh, path)
        LOGGER.info("meshed %s%s: %d nodes in %.1f s", file, wish, len(mesh.nodes), time.perf_counter() - start)
    return replace(mesh, source=str(file))


def merge_tables(tables: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """The tables with all values of `changes` in their places, in tables within tables, too."""
    merged = dict(tables)
    for key, value in changes.items():
        below = merged.get(key)
        merged[key] = merge_tables(below, value) if isinstance(below, Mapping) and isinstance(value, Mapping) else value
    return merged


def _cache_path(job: MeshJob) -> Path | None:
    """The path of the kept mesh; None, with a warning, when its inputs cannot all be read."""
    try:
        return cache_folder() / f"{job.file.stem}-{job.fingerprint()[:DIGITS]}.msh"
    except OSError as error:
        warn_caller(f"{job.file}: the mesh is made again every time: {error}")
        return None


STAGES = ("meshing", "measuring", "writing")


def mesh(
    files: Annotated[list[str], mesh_command.FILE],
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
    size: mesh_command.Size = None,
    nodes: mesh_command.Nodes = None,
    preset: mesh_command.Preset = None,
    order: mesh_command.Order = None,
    set_: mesh_command.Set = None,
    face: mesh_command.Face = None,
    solid: mesh_command.Solid = None,
    close_inlets: mesh_command.CloseInlets = False,
    section: mesh_command.Section = None,
    force: mesh_command.Force = False,
) -> None:
    """Mesh a finger, a body from CAD, or what a plug-in knows of another kind, with tetrahedra."""
    from rich.console import Console  # --help need not wait for any of these

    from taichisoft.running import print_line, print_warning
    from taichisoft_meshing.mesh_job import require_fit
    from taichisoft_meshing.mesh_process import make_mesh_apart
    from taichisoft_meshing.mesh_quality import mesh_tables
    from taichisoft_meshing.mesh_set import prepare, write_output

    require("taichisoft mesh", "gmsh", "matplotlib")
    if len(files) > 1 and not surfaces:
        raise MeshError(f"{files[1]}: one file is meshed at a time; several need --surfaces")
    asked = mesh_command.asked_size(size, nodes, preset)
    if surfaces:
        job = mesh_command.surfaces_job(files, set_, asked)
    else:
        job = mesh_command.geometry_job(files[0], set_, asked)
    job = mesh_command.with_options(job, order, face, solid, close_inlets)
    plane = mesh_command.section_plane(section)
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
