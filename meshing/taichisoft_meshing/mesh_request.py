"""A mesh of the size that somebody asks for: a length, the name of a preset, or a number of nodes."""

from pathlib import Path

from taichisoft.errors import MeshError, nearest
from taichisoft.meshes.volume_mesh import VolumeMesh
from taichisoft.plugin_system.geometry import Geometry
from taichisoft_meshing.geometry_file import mesh_geometry


def mesh_as_asked(
    geometry: Geometry, file: Path, size: float | None = None, preset: str | None = None, nodes: int | None = None
) -> VolumeMesh:
    """Mesh what was read from `file`, at its own size when nothing else is asked for.

    Args:
        geometry: what is meshed.
        file: begins every error.
        size: largest element [mm].
        preset: name of one of the geometry's sizes, instead of `size`.
        nodes: how many to come near to, instead of `size`.

    Raises:
        MeshError: there is no such preset, the number of nodes is not reached, or the mesh is not fit to simulate.
        PluginError: the plug-in of its kind failed.
    """
    if nodes is not None:
        from taichisoft_meshing.size_search import size_for_nodes

        return size_for_nodes(geometry, nodes)[1]
    return mesh_geometry(geometry, size if preset is None else preset_size(geometry, preset, file), file)


def preset_size(geometry: Geometry, preset: str, file: Path) -> float:
    """The size [mm] behind the name of a preset.

    Raises:
        MeshError: the geometry has no such preset.
    """
    presets = geometry.presets
    if preset not in presets:
        raise MeshError(f"{file}: preset '{preset}': unknown; {nearest(preset, list(presets), 'there are')}")
    return presets[preset]
