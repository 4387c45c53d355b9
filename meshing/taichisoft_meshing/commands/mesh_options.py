"""The options that say what is meshed and how fine, alike in `taichisoft mesh` and in sweeps of meshes."""

import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from taichisoft.errors import MeshError, SceneError

if TYPE_CHECKING:
    from taichisoft_meshing.mesh_job import MeshJob

FILE = typer.Argument(metavar="FILE", help="Geometry file (TOML), or the name of a shipped finger such as tutorial.")
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
Force = Annotated[bool, typer.Option("--force", help="Write a mesh that misses a limit of \\[quality], too.")]

# The option that meshes files of each suffix.
OPTIONS = {".step": "--step", ".stp": "--step", ".stl": "--surfaces", ".obj": "--surfaces", ".ply": "--surfaces"}


def geometry_job(name: str, overrides: Sequence[str] | None, asked: Mapping[str, Any]) -> "MeshJob":
    """Prepare to mesh a geometry file or a shipped finger.

    Args:
        name: the path of the file, or the name of the finger.
        overrides: texts "key=value" for the tables of the file.
        asked: the result of `asked_size`.

    Raises:
        MeshError: the file does not exist, or an override is not valid.
    """
    from taichisoft.scenes import find_file
    from taichisoft_meshing.geometry_file import read_tables
    from taichisoft_meshing.mesh_job import MeshJob

    file = find_file(name, "fingers", (".toml",), error=MeshError)
    option = OPTIONS.get(file.suffix.lower())
    if option is not None:
        raise MeshError(f"{name}: is not a geometry file (.toml); {option} meshes it as it is")
    kind, tables = read_tables(file)
    return MeshJob(kind, overridden(tables, overrides), file, asked)


def cad_job(kind: str, names: Sequence[str], overrides: Sequence[str] | None, asked: Mapping[str, Any]) -> "MeshJob":
    """Prepare to mesh files of CAD as a geometry file beside the first one would.

    Args:
        kind: "step" or "surfaces".
        names: paths of the STEP file; or of the outer surface, then of cavities.
        overrides: texts "key=value" for the tables of the geometry file.
        asked: the result of `asked_size`.
    """
    from taichisoft_meshing.mesh_job import MeshJob

    first, *others = (Path(name).expanduser() for name in names)
    tables: dict[str, Any] = {"file": first.name}
    if kind == "surfaces":
        cavities = [os.path.relpath(cavity, first.parent) for cavity in others]
        tables = {"outer": first.name, "cavity": cavities}
    return MeshJob(kind, overridden(tables, overrides), first, asked)


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
