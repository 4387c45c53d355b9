"""The commands `taichisoft mesh`, `mesh info`, `mould` and `mould check`."""

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from taichisoft.base import require
from taichisoft.errors import GoalMissed, MeshError, SceneError

if TYPE_CHECKING:
    from rich.console import Console

    from taichisoft.mesh import SectionPlane, VolumeMesh
    from taichisoft.scene import Material
    from taichisoft_meshing.mesh_job import MeshJob
    from taichisoft_meshing.mould_check import CheckedPart

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
Defeature = Annotated[
    float | None,
    typer.Option(metavar="MM", min=0.0, help="Drop fillets and holes of a STEP body of a radius up to this \\[mm]."),
]
Section = Annotated[
    str | None,
    typer.Option(
        metavar="PLANE", help="Plane that cuts the mesh open in pictures \\[mm]: y=0, z<12.5 (what is kept), x+2*y=30."
    ),
]
Force = Annotated[bool, typer.Option("--force", help="Write a mesh that misses a limit of \\[quality], too.")]


def geometry_job(name: str, overrides: Sequence[str] | None, request: Mapping[str, Any]) -> "MeshJob":
    """Prepare to mesh a geometry file, a STEP file or a shipped finger.

    Args:
        name: the path of the file, or the name of the finger.
        overrides: texts "key=value" for the tables of the file.
        request: the result of `requested_size`.
    """
    from taichisoft.mesh import SURFACE_SUFFIXES, VOLUME_SUFFIXES
    from taichisoft.scene import find_file
    from taichisoft_meshing.geometry_file import read_tables
    from taichisoft_meshing.mesh_job import MeshJob

    file = find_file(name, "fingers", (".toml",), error=MeshError)
    if file.suffix.lower() in SURFACE_SUFFIXES:
        raise MeshError(f"{name}: is not a geometry file (.toml); --surfaces meshes it as it is")
    if file.suffix.lower() in VOLUME_SUFFIXES:
        raise MeshError(
            f"{name}: is a mesh of tetrahedra already; a scene takes it as it is, mesh = '{name}', and the groups that "
            "`taichisoft mesh info` lists"
        )
    kind, tables = read_tables(file)
    return MeshJob(kind, overridden(tables, overrides), file, request)


def surfaces_job(names: Sequence[str], overrides: Sequence[str] | None, request: Mapping[str, Any]) -> "MeshJob":
    """Prepare to mesh surfaces as a geometry file beside the first one would.

    Args:
        names: paths of the outer surface, then of cavities.
        overrides: texts "key=value" for the tables of the geometry file.
        request: the result of `requested_size`.
    """
    from taichisoft_meshing.mesh_job import MeshJob

    first, *others = (Path(name).expanduser() for name in names)
    cavities = [os.path.relpath(cavity, first.parent) for cavity in others]
    tables = {"outer": first.name, "cavity": cavities}
    return MeshJob("surfaces", overridden(tables, overrides), first, request)


def with_options(
    job: "MeshJob",
    order: int | None,
    faces: Sequence[str] | None,
    solids: Sequence[str] | None,
    close_inlets: bool,
    defeature: float | None = None,
) -> "MeshJob":
    """A job with what the options of the same names say in its tables."""
    from taichisoft_meshing.mesh_job import merge_tables

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
    if defeature is not None:
        changes["defeature"] = defeature
    return replace(job, tables=merge_tables(job.tables, changes))


def section_plane(text: str | None) -> "SectionPlane | None":
    """The plane of the option `--section`."""
    from taichisoft.mesh import SectionPlane

    return None if text is None else SectionPlane.parse(text)


def requested_size(size: float | None, nodes: int | None, preset: str | None) -> dict[str, Any]:
    """The one of the three options that was given, by its name; empty when none was."""
    options = {"size": size, "nodes": nodes, "preset": preset}
    request = {name: value for name, value in options.items() if value is not None}
    if len(request) > 1:
        raise MeshError(f"{' and '.join(f'--{name}' for name in request)}: only one of them can be given")
    if size is not None and not 0.0 < size < math.inf:
        raise MeshError(f"--size {size:g}: must be a positive, finite number of millimetres")
    if nodes is not None:
        from taichisoft_meshing.body_tables import refuse_nodes

        refuse_nodes(nodes, f"--nodes {nodes}")
    return request


def overridden(tables: Mapping[str, Any], overrides: Sequence[str] | None) -> dict[str, Any]:
    """A copy of the tables with the values of "key=value" in their places."""
    import copy

    from taichisoft.scene import apply_override

    changed = copy.deepcopy(dict(tables))
    for override in overrides or ():
        try:
            apply_override(changed, override, "body.width=21", "the file")
        except SceneError as error:
            raise MeshError(str(error)) from error
    return changed


# `taichisoft mesh info`: the figures of any mesh or surface that can be read, and the faces of a STEP body.


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
    section: Section = None,
    defeature: Defeature = None,
) -> None:
    """Show the figures of a mesh or surface (exit code 1 when it is not fit), or the faces of a STEP body."""
    from rich.console import Console  # --help need not wait for any of these

    from taichisoft.errors import MeshError
    from taichisoft.mesh import SURFACE_SUFFIXES, VOLUME_SUFFIXES, require_suffix
    from taichisoft.running import print_line
    from taichisoft.scene import find_file
    from taichisoft_meshing.geometry_file import STEP_SUFFIXES
    from taichisoft_meshing.mesh_quality import summary
    from taichisoft_meshing.mesh_set import prepare_folder

    suffixes = (*VOLUME_SUFFIXES, *SURFACE_SUFFIXES, *STEP_SUFFIXES)
    path = require_suffix(find_file(file, "meshes", suffixes, error=MeshError), "mesh or surface", suffixes)
    plane = section_plane(section)
    if plane is not None and path.suffix.lower() not in VOLUME_SUFFIXES:
        raise MeshError(f"--section {section}: has no effect on {path}; only meshes (.msh, .vtk, .vtu) are cut open")
    if defeature is not None and path.suffix.lower() not in STEP_SUFFIXES:
        raise MeshError(f"--defeature {defeature:g}: has no effect on {path}; only STEP bodies have faces to drop")
    surface = path.suffix.lower() in SURFACE_SUFFIXES
    if output is not None:
        require_suffix(output, "report", (".json",) if surface else (".json", ".png"))
        prepare_folder(output.parent, output)
    console = Console()
    if path.suffix.lower() in STEP_SUFFIXES:
        problems = _show_body(console, path, output, defeature or 0.0)
    else:
        problems = _show_surface(console, path, output) if surface else _show_mesh(console, path, output, plane)
    if output is not None:
        print_line(console, f"written to {output}")
    if problems:
        raise GoalMissed(f"{path}: {summary(problems)}")


def _show_mesh(console: "Console", path: Path, output: Path | None, section: "SectionPlane | None") -> list[str]:
    """Print and write the figures of a mesh; returns its problems."""
    from taichisoft.errors import MeshError
    from taichisoft.mesh import read_unchecked_mesh
    from taichisoft.running import print_warning
    from taichisoft_meshing.mesh_quality import QualityLimits, cautions, faults, measure, mesh_tables, missed_limits
    from taichisoft_meshing.mesh_set import mesh_figures, write_record
    from taichisoft_meshing.report_picture import draw_report

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

    from taichisoft.mesh import LARGEST

    inside = (mesh.elements >= 0).all() and (mesh.elements < len(mesh.nodes)).all()
    return bool(mesh.elements.size and inside and (np.abs(mesh.nodes) <= LARGEST).all())


def _show_surface(console: "Console", path: Path, output: Path | None) -> list[str]:
    """Print and write the figures of a surface, which is judged as meshing it would; returns its problems."""
    import warnings

    import numpy as np

    from taichisoft.base import SIZE, implausible
    from taichisoft.mesh import connected_pieces, read_surface
    from taichisoft.running import print_warning
    from taichisoft_meshing.closed_shells import closed_shells, hollow_body
    from taichisoft_meshing.mesh_quality import surface_table
    from taichisoft_meshing.mesh_set import surface_figures, write_record
    from taichisoft_meshing.wall_quality import measure_surface

    vertices, triangles = read_surface(path)
    problems = []
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        try:
            shells = closed_shells(vertices, triangles, str(path))
            # as in the file, but for triangles that face the other way than their neighbours
            facing = [shell.triangles[:, ::-1] if shell.was_inward else shell.triangles for shell in shells]
            starts = np.cumsum([0, *(len(shell.vertices) for shell in shells)])
            vertices = np.vstack([shell.vertices for shell in shells])
            triangles = np.vstack([its + start for its, start in zip(facing, starts, strict=False)])
            hollow_body(shells)
        except MeshError as error:
            problems = [str(error).removeprefix(f"{path}: ").replace(f"{path}, ", "")]
    surface = measure_surface(path.stem, vertices, triangles)
    pieces, extent = len(connected_pieces(triangles, len(vertices))), np.ptp(vertices, axis=0)
    console.print(surface_table(path.name, surface, pieces, extent))
    for warning in warned:
        print_warning(console, str(warning.message).removeprefix(f"{path}: ").replace(f"{path}, ", ""))
    if caution := implausible("its longest side", float(extent.max()), SIZE):
        print_warning(console, f"{caution}; `--set scale=1000` meshes a file in metres")
    if output is not None:
        figures = {**surface_figures(surface), "volume_mm3": surface.volume, "pieces": pieces}
        record = {"file": path.name, **figures, "extent_mm": extent.tolist(), "problems": problems}
        write_record(record, output)
    return problems


def _show_body(console: "Console", path: Path, output: Path | None, defeature: float) -> list[str]:
    """Print the solids, faces and openings of a STEP body, and write or draw them."""
    from taichisoft.running import print_warning
    from taichisoft_meshing.body_pictures import body_tables, draw_faces
    from taichisoft_meshing.mesh_job import read_step_apart
    from taichisoft_meshing.mesh_set import body_figures, write_record

    body = read_step_apart(path, defeature)
    console.print(body_tables(body))
    if body.doubt:
        print_warning(console, body.doubt)
    if output is not None and output.suffix.lower() == ".png":
        draw_faces(body, output)
    elif output is not None:
        write_record({"file": path.name, **body_figures(body)}, output)
    return []


def mesh_cache(
    clear: Annotated[bool, typer.Option("--clear", help="Delete them all; scenes make again what they need.")] = False,
) -> None:
    """Show where the meshes made for scenes are kept, and how large they are."""
    from taichisoft.base import SUFFIX, say
    from taichisoft_meshing.mesh_job import cache_folder

    folder = cache_folder()
    kept = sorted(folder.glob("*.msh"))
    size = sum(path.stat().st_size for path in kept)
    about = f"{len(kept)} mesh{'es' * (len(kept) != 1)}, {size / 1e6:.1f} MB, in {folder}"
    if clear:
        try:
            for path in [*kept, *folder.glob(f"*{SUFFIX}"), *folder.glob(".*.partial")]:
                path.unlink(missing_ok=True)
        except OSError as error:
            raise MeshError(f"{folder}: cannot be cleared: {error.strerror or error}") from error
    say(f"{'deleted ' * clear}{about}")


# `taichisoft mould`: what to cast a finger in, and whether it can be printed and opened.

Silicone = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="Material of which mass and mixing are said: see `taichisoft materials`."),
]
Stiff = Annotated[
    str | None, typer.Option(metavar="NAME", help="Material of the stiff layer; that of --silicone if not given.")
]


def mould(
    files: Annotated[list[str], FILE],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder of the files.")],
    surfaces: Annotated[
        bool, typer.Option("--surfaces", help="FILEs are surfaces (STL, OBJ, PLY): the outer one, then cavities.")
    ] = False,
    wall: Annotated[float | None, typer.Option(help="Thickness around the silicone \\[mm]: 6.")] = None,
    draft: Annotated[float | None, typer.Option(help="Angle by which faces lean \\[degrees]: 1.")] = None,
    printable: Annotated[float | None, typer.Option(help="Least thickness that prints \\[mm]: 1.")] = None,
    skin: Annotated[float | None, typer.Option(help="Least thickness of silicone that fills \\[mm]: 0.5.")] = None,
    chord: Annotated[float | None, typer.Option(help="Most that facets miss curved faces by \\[mm]: 0.02.")] = None,
    parting: Annotated[
        str | None,
        typer.Option(metavar="z=0", help="Direction in which outer parts come off, and the parting plane: z, 0,1,2=5."),
    ] = None,
    whole: Annotated[bool, typer.Option("--whole", help="Cast in one, with lost cores rather than glued.")] = False,
    silicone: Silicone = None,
    stiff: Stiff = None,
    set_: Set = None,
) -> None:
    """Write the mould of a finger or of any closed body as STL (a finger's as STEP too), and check it.

    Cores hang on a lid where they can be drawn out, in one casting or in two that are glued; others are lost. The exit
    code is 1 where a part does not come off, cannot be printed, or does not fit, or where silicone is too thin.
    """
    from taichisoft_meshing.mesh_set import prepare_folder
    from taichisoft_meshing.mould_parts import write_mould_apart

    if surfaces:
        job = surfaces_job(files, set_, {})
    elif len(files) == 1:
        job = geometry_job(files[0], set_, {})
    else:
        raise MeshError(f"{files[1]}: one file is taken at a time; several need --surfaces")
    materials = _materials(silicone, stiff)
    prepare_folder(output)
    form = {"wall": wall, "draft": draft, "printable": printable, "skin": skin, "chord": chord, "parting": parting}
    write_mould_apart(job, output, {"whole": whole} | {key: its for key, its in form.items() if its is not None})
    _report(output, materials)


def mould_check(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Folder that `taichisoft mould` wrote.")],
    silicone: Silicone = None,
    stiff: Stiff = None,
) -> None:
    """Check a mould as its STL files are now, and draw each part; the exit code is 1 when something is wrong.

    Every part comes off in its direction, parts and silicone fill the block, and walls are thick enough to print.
    """
    _report(folder, _materials(silicone, stiff))


def _materials(silicone: str | None, stiff: str | None) -> dict[str, "Material | None"]:
    from taichisoft_outputs.material_files import find_material

    soft = None if silicone is None else find_material(silicone)
    return {"soft": soft, "stiff": soft if stiff is None else find_material(stiff)}


def _report(folder: Path, materials: dict[str, "Material | None"]) -> None:
    """Check, draw and print a mould."""
    from rich.console import Console
    from rich.table import Table

    from taichisoft.running import print_line, print_warning
    from taichisoft_meshing.body_pictures import draw_parts
    from taichisoft_meshing.mesh_quality import summary
    from taichisoft_meshing.mould_check import check_mould, read_mould_record

    console, record = Console(), read_mould_record(folder)
    casts = check_mould(folder)
    table = Table(title=f"{record['name']}: mould", title_justify="left")
    for heading in ("part", "comes off", "volume cm^3", "least wall mm", "undercuts"):
        table.add_column(heading, justify="left" if heading in ("part", "comes off") else "right")
    for cast in casts:
        for part in cast.parts:
            wall = "" if part.thickness == float("inf") else f"{part.thickness:.2f}"
            undercuts = str(len(part.undercuts)) if part.comes_off is not None else ""
            table.add_row(part.file.stem, _direction(part), f"{part.volume / 1000:.2f}", wall, undercuts)
    console.print(table)
    for cast, written in zip(casts, record["casts"], strict=True):
        print_line(console, f"{cast.name}: parts and silicone fill the block to {abs(cast.unfilled):.1e}")
        for pour in written["pours"]:
            print_line(console, f"  pour {pour_line(pour, materials[pour['silicone']])}")
    draw_parts([part for cast in casts for part in cast.parts])
    print_line(console, f"written to {folder}, with a picture of each part")
    problems = [problem for cast in casts for problem in cast.problems]
    for problem in problems:
        print_warning(console, problem)
    if problems:
        raise GoalMissed(f"{folder}: {summary(problems)}")


def pour_line(pour: dict[str, Any], material: "Material | None") -> str:
    """What to weigh for one pour, in words."""
    volume = pour["mm3"]
    line = f"{pour['what']}: {volume / 1000:.1f} cm^3"
    if material is None:
        return f"{line} of {pour['silicone']} silicone"
    grams = 1000 * material.density * volume
    line += f" of {material.name}, {grams:.1f} g"
    mixing = material.mixing
    if mixing is None:
        return f"{line}; its file has no mixing ratio: see the maker's data sheet"
    whole, unit = (volume / 1000, "cm^3") if mixing.by == "volume" else (grams, "g")
    share = mixing.a / (mixing.a + mixing.b)
    return f"{line}: {whole * share:.1f} {unit} of A and {whole * (1 - share):.1f} {unit} of B, by {mixing.by}"


def _direction(part: "CheckedPart") -> str:
    """The direction in which a part comes off, in words: "+y"."""
    if part.comes_off is None:
        return "lost" if part.lost else "stays"
    axis = int(abs(part.comes_off).argmax())
    if abs(part.comes_off[axis]) > 1 - 1e-9:
        return f"{'+' if part.comes_off[axis] > 0 else '-'}{'xyz'[axis]}"
    return ", ".join(f"{share:.2f}" for share in part.comes_off)


# `taichisoft mesh`: from a geometry file, a STEP file or surfaces to a mesh.


def mesh(
    files: Annotated[list[str], FILE],
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
    size: Size = None,
    nodes: Nodes = None,
    preset: Preset = None,
    order: Order = None,
    set_: Set = None,
    face: Face = None,
    solid: Solid = None,
    close_inlets: CloseInlets = False,
    defeature: Defeature = None,
    section: Section = None,
    force: Force = False,
) -> None:
    """Mesh a finger, a body from CAD, or what a plug-in knows of another kind, with tetrahedra."""
    from rich.console import Console  # --help need not wait for any of these

    from taichisoft.running import print_line, print_warning, progress_bar
    from taichisoft_meshing.mesh_job import make_mesh_apart, require_fit
    from taichisoft_meshing.mesh_quality import mesh_tables
    from taichisoft_meshing.mesh_set import prepare, write_output

    require("taichisoft mesh", "gmsh", "matplotlib")
    if len(files) > 1 and not surfaces:
        raise MeshError(f"{files[1]}: one file is meshed at a time; several need --surfaces")
    request = requested_size(size, nodes, preset)
    job = surfaces_job(files, set_, request) if surfaces else geometry_job(files[0], set_, request)
    job = with_options(job, order, face, solid, close_inlets, defeature)
    plane = section_plane(section)
    prepare(output)
    console = Console()
    with progress_bar(console, job.file.name) as count:

        def stage(name: str) -> None:
            count(state=name)

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
