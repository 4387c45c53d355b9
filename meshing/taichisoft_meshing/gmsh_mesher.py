"""From a finger's dimensions to tetrahedra: gmsh builds the solid and fills it."""

from typing import Any

import numpy as np

from taichisoft.errors import MeshError
from taichisoft.mapped_surface import enclosed_volume
from taichisoft.mesh import VolumeMesh, tetrahedron_volumes
from taichisoft_meshing.finger import FingerParameters
from taichisoft_meshing.gmsh_session import GmshFailure, gmsh_session
from taichisoft_meshing.skin import name_surfaces

TETRAHEDRON = 4  # gmsh's number for the linear tetrahedron

# Of the volume asked for; all faces are flat, so only rounding may be missing from the volume meshed.
VOLUME_TOLERANCE = 1e-6


def mesh_finger(parameters: FingerParameters) -> VolumeMesh:
    """Mesh a finger with linear tetrahedra; the same parameters give the same mesh, node for node.

    Surface groups: "outer", the closed outer skin; "base", its part in the plane x = 0; "cavity", the wall of
    the air, closed, pointing into the silicone so that the volume that it encloses is positive. Element
    group: "silicone", all of it.

    Raises:
        MeshError: gmsh cannot be loaded, fails, or gives a body of another volume.
    """
    with gmsh_session("this finger") as gmsh:
        _build_solid(gmsh.model.occ, parameters)
        _set_sizes(gmsh, parameters)
        gmsh.model.mesh.generate(3)
        nodes, elements = _tetrahedra(gmsh.model.mesh)
    # Programs that save only what is in a group would leave the tetrahedra out.
    silicone = {"silicone": np.arange(len(elements), dtype=np.int32)}
    surfaces = name_surfaces(nodes, elements)
    mesh = VolumeMesh("finger meshed by gmsh", nodes, elements, surfaces, silicone).check()
    _check_volumes(mesh, parameters)
    return mesh


def _build_solid(occ: Any, finger: FingerParameters) -> None:
    """The block less its slots and its cavity, as one solid."""
    half_width = finger.body.width / 2
    corners = [occ.addPoint(x, y, -half_width) for x, y in finger.outline]
    sides = [occ.addLine(a, b) for a, b in zip(corners, corners[1:] + corners[:1], strict=True)]
    side_view = occ.addPlaneSurface([occ.addCurveLoop(sides)])
    body = [part for part in occ.extrude([(2, side_view)], 0, 0, finger.body.width) if part[0] == 3]
    voids = [_slot(occ, finger, number) for number in range(finger.slots.count)]
    if voids:
        body, _ = occ.cut(body, voids)
    chambers = [_chamber(occ, finger, number) for number in range(finger.chambers.count)]
    cavity, _ = occ.fuse([_channel(occ, finger)], chambers)
    occ.cut(body, cavity)
    occ.synchronize()


def _slot(occ: Any, finger: FingerParameters, number: int) -> tuple[int, int]:
    slots, width = finger.slots, finger.body.width
    x = -(slots.first + number * slots.pitch + slots.width)
    return 3, occ.addBox(x, 0, -width / 2, slots.width, slots.depth, width)


def _channel(occ: Any, finger: FingerParameters) -> tuple[int, int]:
    channel = finger.channel
    length, height = channel.end - channel.start, channel.top - channel.bottom
    return 3, occ.addBox(-channel.end, channel.bottom, -channel.width / 2, length, height, channel.width)


def _chamber(occ: Any, finger: FingerParameters, number: int) -> tuple[int, int]:
    chambers = finger.chambers
    x = -(chambers.first + number * chambers.pitch + chambers.width)
    y = finger.channel.bottom - chambers.height
    return 3, occ.addBox(x, y, -chambers.depth / 2, chambers.width, chambers.height, chambers.depth)


def _set_sizes(gmsh: Any, finger: FingerParameters) -> None:
    """`smallest` at the corners of the cavity, growing to `largest`."""
    sizes, channel = finger.mesh, finger.channel
    gmsh.option.setNumber("Mesh.MeshSizeMax", sizes.largest)
    gmsh.option.setNumber("Mesh.MeshSizeMin", sizes.smallest)
    half = max(channel.width, finger.chambers.depth) / 2
    low = channel.bottom - finger.chambers.height
    margin = 1e-3  # [mm] OpenCASCADE's boxes are a little loose
    corners = gmsh.model.getEntitiesInBoundingBox(
        -channel.end - margin, low - margin, -half - margin,
        -channel.start + margin, channel.top + margin, half + margin, dim=0,
    )  # fmt: skip
    gmsh.model.mesh.setSize(corners, sizes.smallest)


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


def _check_volumes(mesh: VolumeMesh, finger: FingerParameters) -> None:
    silicone = float(tetrahedron_volumes(mesh.nodes, mesh.elements).sum())
    air = enclosed_volume(mesh.nodes, mesh.surface_groups["cavity"])
    for what, meshed, wanted in (
        ("silicone", silicone, finger.solid_volume - finger.cavity_volume),
        ("cavity", air, finger.cavity_volume),
    ):
        if abs(meshed - wanted) > VOLUME_TOLERANCE * wanted:
            raise MeshError(
                f"gmsh gave a {what} of {meshed:.6g} mm^3 instead of {wanted:.6g}; try another mesh.largest"
            )
