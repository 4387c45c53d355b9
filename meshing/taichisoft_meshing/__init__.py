"""Meshes of tetrahedra from dimensions, CAD or surfaces, made by gmsh."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from taichisoft.plugin_system.hookspecs import hookimpl

if TYPE_CHECKING:
    import typer

    from taichisoft.meshes.volume_mesh import VolumeMesh
    from taichisoft.plugin_system.geometry import Geometry


@hookimpl
def taichisoft_geometry_kinds() -> "Mapping[str, Callable[..., Geometry]]":
    """The built-in kinds of bodies."""
    from taichisoft_meshing.bodies.kinds import StepBody, SurfacesBody
    from taichisoft_meshing.finger.kind import PneunetFinger
    from taichisoft_meshing.tendon_finger.kind import TendonFinger

    return {
        "pneunet_finger": PneunetFinger,
        "step": StepBody,
        "surfaces": SurfacesBody,
        "tendon_finger": TendonFinger,
    }


@hookimpl
def taichisoft_mesh_makers() -> "Mapping[str, Callable[..., VolumeMesh]]":
    """The function that meshes geometry files of every kind that a plug-in knows."""
    from taichisoft_meshing.scene_meshes import mesh_for_scene

    return {".toml": mesh_for_scene}


@hookimpl
def taichisoft_commands(application: "typer.Typer") -> None:
    """Add `taichisoft mesh`, `mesh-info`, `mesh-cache` and `mould`."""
    from taichisoft_meshing.commands.mesh import mesh
    from taichisoft_meshing.commands.mesh_info import mesh_info
    from taichisoft_meshing.commands.mould import mould
    from taichisoft_meshing.mesh_cache import mesh_cache

    application.command("mesh")(mesh)
    application.command("mesh-info")(mesh_info)
    application.command("mesh-cache")(mesh_cache)
    application.command("mould")(mould)
