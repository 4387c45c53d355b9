"""From a finger's dimensions to tetrahedra: gmsh builds the solid and fills it."""

from typing import Any

import numpy as np

from taichisoft.errors import MeshError
from taichisoft.meshes.surface import enclosed_volume
from taichisoft.meshes.volume_mesh import VolumeMesh, tetrahedron_volumes
from taichisoft_meshing.finger.element_sizes import mesh_with_sizes
from taichisoft_meshing.finger.groups import element_groups
from taichisoft_meshing.finger.parameters import FingerParameters
from taichisoft_meshing.finger.skin import name_surfaces
from taichisoft_meshing.finger.solid import build_finger
from taichisoft_meshing.gmsh_session import GmshFailure, gmsh_session

TETRAHEDRON = 4  # gmsh's number for the linear tetrahedron

# Of the volume asked for; between flat faces only rounding may be missing from the volume meshed.
VOLUME_TOLERANCE = 1e-6

# Likewise where there are fillets or an inlet: flat triangles cut corners there, or fill them.
CURVED_TOLERANCE = 0.02


def mesh_finger(parameters: FingerParameters, source: str = "finger") -> VolumeMesh:
    """Mesh a finger with linear tetrahedra; the same parameters give the same mesh, node for node.

    Surface groups: "outer", the closed outer skin; "base", its part in the plane x = 0; "cavity", the wall of
    the air, closed, pointing into the silicone so that the volume that it encloses is positive. Element
    groups: "silicone", all of it, "stiff_layer" and "base_block", see `finger_groups`.

    Args:
        parameters: every dimension.
        source: what errors call it, for example its file.

    Raises:
        MeshError: gmsh cannot be loaded, fails, or gives a body of another volume.
    """
    with gmsh_session(source) as gmsh:
        build_finger(gmsh, parameters)
        mesh_with_sizes(gmsh, parameters)
        nodes, elements = _tetrahedra(gmsh.model.mesh)
    try:
        groups = element_groups(parameters, nodes, elements)
    except ValueError as error:
        raise MeshError(f"{source}: {error}") from error
    mesh = VolumeMesh(f"{source} meshed by gmsh", nodes, elements, name_surfaces(nodes, elements), groups).check()
    _check_volumes(mesh, parameters, source)
    return mesh


def _tetrahedra(gmsh_mesh: Any) -> tuple[np.ndarray, np.ndarray]:
    """Nodes in use [mm], (node_count, 3), and tetrahedra, (element_count, 4), which gmsh makes positive."""
    tags, coordinates, _ = gmsh_mesh.getNodes()
    _, corner_tags = gmsh_mesh.getElementsByType(TETRAHEDRON)
    if len(corner_tags) == 0:
        raise GmshFailure("no tetrahedra came out")
    order = np.argsort(tags)
    used, elements = np.unique(corner_tags, return_inverse=True)
    nodes = coordinates.reshape(-1, 3)[order[np.searchsorted(tags[order], used)]]
    return nodes, elements.reshape(-1, 4)


def _check_volumes(mesh: VolumeMesh, finger: FingerParameters, source: str) -> None:
    silicone = float(tetrahedron_volumes(mesh.nodes, mesh.elements).sum())
    air = enclosed_volume(mesh.nodes, mesh.surface_groups["cavity"])
    tolerance = CURVED_TOLERANCE if finger.is_curved else VOLUME_TOLERANCE
    for what, meshed, wanted in (
        ("silicone", silicone, finger.solid_volume - finger.cavity_volume),
        ("cavity", air, finger.cavity_volume),
    ):
        if not abs(meshed - wanted) <= tolerance * wanted:
            raise MeshError(
                f"{source}: gmsh gave a {what} of {meshed:.6g} mm^3 instead of {wanted:.6g}; try another mesh.largest"
            )
