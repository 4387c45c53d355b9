"""Meshes of tetrahedra from dimensions, CAD or surfaces, made by gmsh."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import lazy_loader

from taichisoft.running import Imported, hookimpl

if TYPE_CHECKING:
    import typer

    from taichisoft.mesh import VolumeMesh
    from taichisoft.running import Geometry
    from taichisoft_meshing.body_tables import BasePlane, FittedSizes, set_sizes, with_base
    from taichisoft_meshing.geometry_file import checked
    from taichisoft_meshing.gmsh_session import meshed_body, shells_of_solid

__all__ = ["BasePlane", "FittedSizes", "checked", "meshed_body", "set_sizes", "shells_of_solid", "with_base"]
# Names for geometries of one's own, such as data/plugins/tube.py.
__getattr__, *_ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "gmsh_session": ["meshed_body", "shells_of_solid"],
        "body_tables": ["BasePlane", "FittedSizes", "set_sizes", "with_base"],
        "geometry_file": ["checked"],
    },
)


@hookimpl
def taichisoft_geometry_kinds() -> "Mapping[str, Callable[..., Geometry]]":
    """The built-in kinds of bodies."""
    places = {
        "pneunet_finger": "pneunet_finger:PneunetFinger",
        "step": "file_bodies:StepBody",
        "surfaces": "file_bodies:SurfacesBody",
        "tendon_finger": "tendon_finger:TendonFinger",
    }
    return Imported(__name__, places)


@hookimpl
def taichisoft_mesh_makers() -> "Mapping[str, Callable[..., VolumeMesh]]":
    """The function that meshes geometry files of every kind that a plug-in knows, and STEP files as they are."""
    return Imported(__name__, dict.fromkeys((".toml", ".step", ".stp"), "mesh_job:mesh_for_scene"))


@hookimpl
def taichisoft_commands(application: "typer.Typer") -> None:
    """Add `taichisoft mesh`, `mesh info`, `mesh cache`, `mould`, `mould check` and `new gripper`."""
    import typer

    from taichisoft.running import group_with_default
    from taichisoft_meshing.mesh_commands import mesh, mesh_cache, mesh_info, mould, mould_check
    from taichisoft_meshing.new_gripper import gripper

    group = group_with_default(mesh)
    group.command("info")(mesh_info)
    group.command("cache")(mesh_cache)
    application.add_typer(group, name="mesh")
    moulds = group_with_default(mould)
    moulds.command("check")(mould_check)
    application.add_typer(moulds, name="mould")
    new = typer.Typer(no_args_is_help=True, help="Write something to start from.")
    new.callback()(lambda: None)
    new.command("gripper")(gripper)
    application.add_typer(new, name="new")
