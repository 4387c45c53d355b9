"""From a finger's dimensions to tetrahedra (gmsh)."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

from taichisoft.hookspecs import hookimpl

if TYPE_CHECKING:
    import typer

    from taichisoft.geometry import GeometryKind


@hookimpl
def taichisoft_geometry_kinds() -> "Mapping[str, GeometryKind]":
    """The built-in kinds of bodies."""
    from taichisoft_meshing.finger_file import PneunetFinger

    return {"pneunet_finger": PneunetFinger}


@hookimpl
def taichisoft_commands(application: "typer.Typer") -> None:
    """Add `taichisoft mesh`."""
    from taichisoft_meshing.commands import mesh

    application.command("mesh")(mesh)
