"""A finger as a solid, made by OpenCASCADE in gmsh."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from taichisoft_meshing.finger.boxes import TOUCH, Box, chamber_boxes, channel_box, slot_boxes
from taichisoft_meshing.finger.cavity_walls import layer_boxes, layer_count
from taichisoft_meshing.finger.parameters import FingerParameters
from taichisoft_meshing.gmsh_session import GmshFailure

Solids = list[tuple[int, int]]  # pairs of the dimension, 3, and gmsh's number


@dataclass(frozen=True)
class Draft:
    """How far faces lean so that what is cast comes out of its mould upward, along y.

    Outside and cores lean the same way, and slots the other, so that every wall between them keeps its thickness.

    Attributes:
        slope: tangent of the draft angle [-].
        neutral: height y at which everything has its drawn size [mm].
    """

    slope: float = 0.0
    neutral: float = 0.0

    def outward(self, y: float) -> float:
        """How far faces are moved outward at a height y [mm]."""
        return self.slope * (y - self.neutral)


DRAWN = Draft()
"""No draft: the finger as its dimensions say."""

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


def finger_outside(occ: Any, finger: FingerParameters, draft: Draft = DRAWN) -> Solids:
    """The block less its slots: the outside of the finger. Its base stays in the plane x = 0 with any draft."""
    half, height, top = finger.body.width / 2, finger.body.height, draft.outward(finger.body.height)
    if not draft.slope:
        block = drawn_out(occ, [(x, y, -half) for x, y in finger.outline], (0.0, 0.0, finger.body.width))
    else:
        base, back, tip, corner, flat = finger.outline
        tip = (tip[0] - draft.slope * (height - corner[1]), height)
        deep = half + abs(top) + draft.slope * height
        side = drawn_out(occ, [(x, y, -deep) for x, y in (base, back, tip, corner, flat)], (0.0, 0.0, 2 * deep))
        low = half + draft.outward(0.0)
        front = [(0.0, 0.0, -low), (0.0, 0.0, low), (0.0, height, half + top), (0.0, height, -half - top)]
        block, _ = occ.intersect(side, drawn_out(occ, front, (tip[0] - 1.0, 0.0, 0.0)))
    slots = [solid_box(occ, slot, draft, -1.0, through=True) for slot in slot_boxes(finger)]
    radius = finger.slots.fillet_radius
    slots = [_rounded(occ, slot, radius, finger.slots.depth) if radius else slot for slot in slots]
    if slots:
        block, _ = occ.cut(block, slots)
    return block


def finger_cavity(occ: Any, finger: FingerParameters, draft: Draft = DRAWN, inlet: bool = True) -> Solids:
    """Channel, chambers and, if `inlet`, the bore in one piece: the air in the finger."""
    channel, bore = finger.channel, finger.inlet
    chambers = [solid_box(occ, box, draft) for box in chamber_boxes(finger)]
    radius, bottom = finger.chambers.fillet_radius, channel.bottom - finger.chambers.height
    parts = [_rounded(occ, chamber, radius, bottom) if radius else chamber for chamber in chambers]
    if bore.diameter and inlet:
        parts.append(inlet_bore(occ, finger, -bore.plug))
    cavity: Solids
    cavity, _ = occ.fuse([solid_box(occ, channel_box(finger), draft)], parts)
    return cavity


def inlet_bore(occ: Any, finger: FingerParameters, end: float, deeper: float = 0.0) -> tuple[int, int]:
    """The cylinder along x from the near end of the channel, or `deeper` [mm] in it, to the position x = `end`."""
    channel, begin = finger.channel, -finger.channel.start - deeper
    middle = (channel.bottom + channel.top) / 2
    return 3, occ.addCylinder(begin, middle, 0, end - begin, 0, 0, finger.inlet.diameter / 2)


def drawn_out(occ: Any, corners: Sequence[tuple[float, float, float]], way: tuple[float, float, float]) -> Solids:
    """The solid between a polygon and the same one shifted."""
    points = [occ.addPoint(*corner) for corner in corners]
    sides = [occ.addLine(a, b) for a, b in zip(points, points[1:] + points[:1], strict=True)]
    face = occ.addPlaneSurface([occ.addCurveLoop(sides)])
    return [part for part in occ.extrude([(2, face)], *way) if part[0] == 3]


def _inner_solids(occ: Any, finger: FingerParameters) -> Solids:
    """Solids at whose faces elements are to end: the held base and the layers of the walls; none for an even mesh."""
    if finger.mesh.smallest == finger.mesh.largest:
        return []
    body, layers = finger.body, layer_count(finger)
    base = Box((-body.base_length, 0.0, -body.width / 2), (body.base_length, body.height, body.width))
    inner = [solid_box(occ, base)]
    for layer in range(1, layers):
        first, *others = [solid_box(occ, box) for box in layer_boxes(finger, layer / layers)]
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


def solid_box(occ: Any, box: Box, draft: Draft = DRAWN, sign: float = 1.0, through: bool = False) -> tuple[int, int]:
    """A box whose faces across x and z lean outward upward, or inward for sign = -1; `through` reaches beyond its z."""
    if not draft.slope:
        return 3, occ.addBox(*box.corner, *box.size)
    (left, bottom, near), (right, top, far) = box.lower.tolist(), box.upper.tolist()
    low, high = sign * draft.outward(bottom), sign * draft.outward(top)
    margin = max(abs(low), abs(high)) + 1.0
    side = [(left - low, bottom), (right + low, bottom), (right + high, top), (left - high, top)]
    begin, depth = near - margin, far - near + 2 * margin
    solid = drawn_out(occ, [(x, y, begin) for x, y in side], (0.0, 0.0, depth))
    if not through:
        front = [(bottom, near - low), (bottom, far + low), (top, far + high), (top, near - high)]
        across = [(left - margin, y, z) for y, z in front]
        solid, _ = occ.intersect(solid, drawn_out(occ, across, (right - left + 2 * margin, 0.0, 0.0)))
    return solid[0]
