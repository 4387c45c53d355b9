"""The geometry kind `pneunet_finger`: a finger's dimensions from TOML, which gmsh builds and fills."""

from typing import Any

import numpy as np

from taichisoft.errors import MeshError
from taichisoft.meshes import VolumeMesh
from taichisoft_meshing.bodies.meshed_body import compare_volumes
from taichisoft_meshing.curved_sides import curved_sides, with_curved_sides
from taichisoft_meshing.finger.boxes import Box, chamber_boxes, channel_box
from taichisoft_meshing.finger.cavity_walls import layer_count, thin_walls
from taichisoft_meshing.finger.groups import element_groups, surface_groups
from taichisoft_meshing.finger.parameters import FingerParameters
from taichisoft_meshing.finger.solid import build_finger
from taichisoft_meshing.geometry_file import CheckedGeometry
from taichisoft_meshing.gmsh_session import gmsh_session, obey_size_fields, tetrahedra
from taichisoft_meshing.size_search import GROWTH

ROUNDING, CURVED = 1e-6, 0.02
"""Largest errors of a volume, as shares of that of the drawing [-]: between flat faces only rounding is missing, and
flat triangles cut the corners of fillets and of an inlet, or fill them."""

INSIDE = 0.5
"""Size of the tetrahedra in a thin wall over that of its triangles [-]. Where triangles are about as large as the wall
is thick, nodes come to lie inside it; gmsh finds no place for any where they are larger."""


def mesh_finger(parameters: FingerParameters, source: str = "finger") -> VolumeMesh:
    """Mesh a finger; the same parameters give the same mesh, node for node.

    Surface groups: "outer", the closed outer skin; "base", its part in the plane x = 0; "cavity", the wall of
    the air, closed, pointing into the silicone so that the volume that it encloses is positive. Element
    groups: "silicone", all of it, "stiff_layer" and "base_block", see `element_groups`.

    Args:
        parameters: every dimension.
        source: name of the finger in errors, for example its file.

    Raises:
        MeshError: gmsh cannot be loaded, fails, or gives a body of another volume.
    """
    with gmsh_session(source) as gmsh:
        build_finger(gmsh, parameters)
        _mesh_with_sizes(gmsh, parameters)
        nodes, elements, _ = tetrahedra(gmsh)
        sides = curved_sides(gmsh, nodes, elements) if parameters.mesh.order == 2 else None
    try:
        groups = element_groups(parameters, nodes, elements)
    except ValueError as error:
        raise MeshError(f"{source}: {error}") from error
    mesh = VolumeMesh(f"{source} meshed by gmsh", nodes, elements, surface_groups(nodes, elements), groups).check()
    if sides is not None:
        mesh = with_curved_sides(mesh, sides).check()
    air = parameters.cavity_volume
    compare_volumes(mesh, parameters.solid_volume - air, [air], CURVED if parameters.is_curved else ROUNDING)
    return mesh


def _mesh_with_sizes(gmsh: Any, finger: FingerParameters) -> None:
    """Fill the model's solids with tetrahedra: small ones at the cavity and in the walls around it."""
    sizes, mesh = finger.mesh, gmsh.model.mesh
    gmsh.option.setNumber("Mesh.MeshSizeMax", sizes.largest)
    if finger.is_curved:
        gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", sizes.curvature)
    else:
        gmsh.option.setNumber("Mesh.MeshSizeMin", sizes.smallest)
    if sizes.smallest == sizes.largest:
        mesh.generate(3)
        return
    gmsh.option.setNumber("Mesh.MeshSizeFromPoints", 0)
    gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", int(finger.is_curved))
    reach = np.full(3, thin_walls(finger)[-1])
    walls = [box.grown(reach, reach) for box in (channel_box(finger), *chamber_boxes(finger))]
    for box in walls:
        _add_box_field(gmsh, box, sizes.smallest, sizes.largest, (sizes.largest - sizes.smallest) / GROWTH)
    obey_size_fields(gmsh)
    mesh.generate(2)
    if layer_count(finger) == 1:
        gmsh.option.setNumber("Mesh.MeshSizeMin", 0)
        for box in walls:
            _add_box_field(gmsh, box, INSIDE * sizes.smallest, sizes.largest, 0.0)
        obey_size_fields(gmsh)
    mesh.generate(3)


def _add_box_field(gmsh: Any, box: Box, inside: float, outside: float, distance: float) -> None:
    """Set the size [mm] inside a box, which becomes that outside over a distance [mm] around it."""
    field = gmsh.model.mesh.field
    tag = field.add("Box")
    options = {"VIn": inside, "VOut": outside, "Thickness": distance}
    for axis, low, high in zip("XYZ", box.lower, box.upper, strict=True):
        options |= {f"{axis}Min": low, f"{axis}Max": high}
    for option, value in options.items():
        field.setNumber(tag, option, value)


PRESETS = {"coarse": 3.6, "medium": 1.55, "fine": 1.0}
"""Element size at the cavity over the thickness of the thinnest wall [-]; the tutorial's finger has 590, 2000 and 5700
nodes."""


class PneunetFinger(CheckedGeometry):
    """A finger that the tables of a file describe."""

    table_type = FingerParameters

    @property
    def presets(self) -> dict[str, float]:
        """Largest element size [mm] by name: a multiple of the thinnest wall at the cavity, graded as in the file."""
        finger = self.table
        grading = finger.mesh.largest / finger.mesh.smallest
        return {name: times * float(thin_walls(finger)[0]) * grading for name, times in PRESETS.items()}

    def mesh(self, size: float | None = None) -> VolumeMesh:
        """Mesh the finger with gmsh; `size` [mm] replaces the largest element size and scales the smallest with it."""
        return mesh_finger(self.sized(size), str(self.file))
