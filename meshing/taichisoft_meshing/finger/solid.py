"""A finger as a solid, made by OpenCASCADE in gmsh."""

from typing import Any

from taichisoft_meshing.finger.boxes import TOUCH, Box, chamber_boxes, channel_box, slot_boxes
from taichisoft_meshing.finger.cavity_walls import layer_boxes, layer_count
from taichisoft_meshing.finger.parameters import FingerParameters
from taichisoft_meshing.gmsh_session import GmshFailure

Solids = list[tuple[int, int]]  # pairs of the dimension, 3, and gmsh's number

VOLUME_TOLERANCE = 1e-6
"""Largest error of OpenCASCADE's volume, as a share of the formula's [-]: only rounding may be missing."""


def build_finger(gmsh: Any, finger: FingerParameters) -> None:
    """Make the silicone, cut along the inner surfaces where elements are to end; the model then holds nothing else.

    Raises:
        GmshFailure: the solid has not the volume of the drawing.
    """
    occ = gmsh.model.occ
    silicone, _ = occ.cut(finger_outside(occ, finger), finger_cavity(occ, finger))
    inner = [occ.intersect([solid], silicone, removeTool=False)[0] for solid in _inner_solids(occ, finger)]
    if inner:
        occ.fragment(silicone, [part for parts in inner for part in parts])
    occ.synchronize()
    wanted = finger.solid_volume - finger.cavity_volume
    made = sum(occ.getMass(*solid) for solid in occ.getEntities(3))
    if not abs(made - wanted) <= VOLUME_TOLERANCE * wanted:
        raise GmshFailure(f"OpenCASCADE gave a solid of {made:.9g} mm^3 instead of {wanted:.9g}")


def finger_outside(occ: Any, finger: FingerParameters) -> Solids:
    """The block less its slots: the outside of the finger."""
    half_width = finger.body.width / 2
    corners = [occ.addPoint(x, y, -half_width) for x, y in finger.outline]
    sides = [occ.addLine(a, b) for a, b in zip(corners, corners[1:] + corners[:1], strict=True)]
    side_view = occ.addPlaneSurface([occ.addCurveLoop(sides)])
    block: Solids = [part for part in occ.extrude([(2, side_view)], 0, 0, finger.body.width) if part[0] == 3]
    slots = [_box(occ, box) for box in slot_boxes(finger)]
    radius = finger.slots.fillet_radius
    slots = [_rounded(occ, slot, radius, finger.slots.depth) if radius else slot for slot in slots]
    if slots:
        block, _ = occ.cut(block, slots)
    return block


def finger_cavity(occ: Any, finger: FingerParameters) -> Solids:
    """Channel, chambers and inlet in one piece: the air in the finger."""
    channel, inlet = finger.channel, finger.inlet
    chambers = [_box(occ, box) for box in chamber_boxes(finger)]
    radius, bottom = finger.chambers.fillet_radius, channel.bottom - finger.chambers.height
    parts = [_rounded(occ, chamber, radius, bottom) if radius else chamber for chamber in chambers]
    if inlet.diameter:
        middle, length = (channel.bottom + channel.top) / 2, channel.start - inlet.plug
        parts.append((3, occ.addCylinder(-channel.start, middle, 0, length, 0, 0, inlet.diameter / 2)))
    cavity: Solids
    cavity, _ = occ.fuse([_box(occ, channel_box(finger))], parts)
    return cavity


def _inner_solids(occ: Any, finger: FingerParameters) -> Solids:
    """Solids at whose faces elements are to end: the held base and the layers of the walls; none for an even mesh."""
    if finger.mesh.smallest == finger.mesh.largest:
        return []
    body, layers = finger.body, layer_count(finger)
    base = Box((-body.base_length, 0.0, -body.width / 2), (body.base_length, body.height, body.width))
    inner = [_box(occ, base)]
    for layer in range(1, layers):
        first, *others = [_box(occ, box) for box in layer_boxes(finger, layer / layers)]
        inner += occ.fuse([first], others)[0]
    return inner


def _rounded(occ: Any, solid: tuple[int, int], radius: float, y: float) -> tuple[int, int]:
    """Round the two edges of a box that run across the finger at the height `y` [mm], with a radius [mm]."""
    faces = occ.getSurfaceLoops(solid[1])[1][0]
    edges = {edge for face in faces for loop in occ.getCurveLoops(face)[1] for edge in loop.tolist()}
    middles = {edge: occ.getCenterOfMass(1, edge) for edge in sorted(edges)}
    across = [edge for edge, middle in middles.items() if abs(middle[1] - y) < TOUCH and abs(middle[2]) < TOUCH]
    rounded: Solids = occ.fillet([solid[1]], across, [radius])
    return rounded[0]


def _box(occ: Any, box: Box) -> tuple[int, int]:
    return 3, occ.addBox(*box.corner, *box.size)
