"""How fine gmsh meshes a finger: small elements at the cavity and in the thin walls around it, larger elsewhere."""

from typing import Any

import numpy as np

from taichisoft_meshing.finger.boxes import Box, chamber_boxes, channel_box
from taichisoft_meshing.finger.cavity_walls import thin_walls
from taichisoft_meshing.finger.layers import layer_count
from taichisoft_meshing.finger.parameters import FingerParameters

GROWTH = 0.5
"""How much larger elements may be for each millimetre that they are farther from the walls [-]."""

INSIDE = 0.5
"""Of the size of the triangles of a thin wall: size of the tetrahedra in it. Where triangles are about as large as the
wall is thick, nodes come to lie inside it; gmsh finds no place for any where they are larger."""


def mesh_with_sizes(gmsh: Any, finger: FingerParameters) -> None:
    """Fill the model's solids with tetrahedra."""
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
    walls = _walls(finger)
    growing = [_box_field(gmsh, box, sizes.smallest, sizes.largest, _distance(finger)) for box in walls]
    _use_smallest(gmsh, growing)
    mesh.generate(2)
    if layer_count(finger) == 1:
        gmsh.option.setNumber("Mesh.MeshSizeMin", 0)
        inside = [_box_field(gmsh, box, INSIDE * sizes.smallest, sizes.largest, 0.0) for box in walls]
        _use_smallest(gmsh, growing + inside)
    mesh.generate(3)


def _walls(finger: FingerParameters) -> list[Box]:
    """The boxes of the cavity and the thin walls around them."""
    reach = np.full(3, thin_walls(finger)[-1])
    return [box.grown(reach, reach) for box in (channel_box(finger), *chamber_boxes(finger))]


def _distance(finger: FingerParameters) -> float:
    """From the walls to where elements are largest [mm]."""
    return (finger.mesh.largest - finger.mesh.smallest) / GROWTH


def _box_field(gmsh: Any, box: Box, inside: float, outside: float, distance: float) -> int:
    """A size inside a box, which becomes another one over a distance around it."""
    field = gmsh.model.mesh.field
    tag: int = field.add("Box")
    options = {"VIn": inside, "VOut": outside, "Thickness": distance}
    for axis, low, high in zip("XYZ", box.lower, box.upper, strict=True):
        options |= {f"{axis}Min": low, f"{axis}Max": high}
    for option, value in options.items():
        field.setNumber(tag, option, value)
    return tag


def _use_smallest(gmsh: Any, fields: list[int]) -> None:
    field = gmsh.model.mesh.field
    smallest = field.add("Min")
    field.setNumbers(smallest, "FieldsList", fields)
    field.setAsBackgroundMesh(smallest)
