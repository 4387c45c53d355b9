"""The options that say what is meshed and how fine, alike in `taichisoft mesh` and in sweeps of meshes."""

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from taichisoft.errors import MeshError, SceneError

if TYPE_CHECKING:
    from taichisoft.meshes import SectionPlane
    from taichisoft_meshing.mesh_job import MeshJob

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
    from taichisoft.meshes import SURFACE_SUFFIXES
    from taichisoft.scenes import find_file
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
    from taichisoft_meshing.scene_meshes import merge_tables

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
    from taichisoft.meshes import SectionPlane

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

    from taichisoft.scenes import apply_override

    changed = copy.deepcopy(dict(tables))
    for override in overrides or ():
        try:
            apply_override(changed, override, "body.width=21", "the file")
        except SceneError as error:
            raise MeshError(str(error)) from error
    return changed
