"""From a finger's dimensions to tetrahedra (gmsh)."""

from typing import TYPE_CHECKING

from taichisoft.hookspecs import hookimpl

if TYPE_CHECKING:
    import typer


@hookimpl
def taichisoft_commands(application: "typer.Typer") -> None:
    """Add `taichisoft mesh`."""
    from taichisoft_meshing.commands import mesh

    application.command("mesh")(mesh)
