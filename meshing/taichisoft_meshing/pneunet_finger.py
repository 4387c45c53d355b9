"""The geometry kind `pneunet_finger`: a finger's dimensions from TOML, which gmsh builds and fills."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from taichisoft.errors import MeshError
from taichisoft.mesh import VolumeMesh, cavity_names, skins_and_cavities
from taichisoft_meshing.body_tables import add_box_of_size
from taichisoft_meshing.finger_dimensions import FingerDimensions, FingerParameters, starts
from taichisoft_meshing.geometry_file import CheckedGeometry
from taichisoft_meshing.gmsh_session import (
    GmshFailure,
    compare_volumes,
    curved_sides,
    gmsh_session,
    obey_size_fields,
    tetrahedra,
    with_curved_sides,
)

# The boxes of a finger's slots, air and layers, in the axes of the mesh.

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Box:
    """A box with faces across x, y and z.

    Attributes:
        corner: the corner with the smallest coordinates [mm].
        size: edge lengths along x, y and z [mm].
    """

    corner: Vector
    size: Vector

    @property
    def lower(self) -> np.ndarray:
        """Smallest coordinates [mm], shape (3,)."""
        return np.array(self.corner)

    @property
    def upper(self) -> np.ndarray:
        """Largest coordinates [mm], shape (3,)."""
        return np.array(self.corner) + np.array(self.size)

    def grown(self, below: np.ndarray, above: np.ndarray) -> "Box":
        """A box with faces moved outward: those at `lower` by `below`, those at `upper` by `above` [mm], (3,) each."""
        lower, upper = self.lower - below, self.upper + above
        x, y, z = lower.tolist()
        length, height, width = (upper - lower).tolist()
        return Box((x, y, z), (length, height, width))

    def holds(self, points: np.ndarray) -> np.ndarray:
        """Whether points of shape (count, 3) [mm] lie inside or on a face, shape (count,)."""
        inside: np.ndarray = np.all((points >= self.lower - TOUCH) & (points <= self.upper + TOUCH), axis=1)
        return inside


TOUCH = 1e-9
"""Distance from a face of a box up to which a point lies on it [mm]; selection in scenes has the same rule."""


def slot_boxes(finger: FingerDimensions) -> list[Box]:
    """The boxes of the slots, beginning at the base."""
    slots, width = finger.slots, finger.body.width
    size = (slots.width, slots.depth, width)
    return [Box((-(start + slots.width), 0.0, -width / 2), size) for start in starts(slots)]


def channel_box(finger: FingerDimensions) -> Box:
    """The box of the air duct."""
    channel = finger.channel
    size = (channel.end - channel.start, channel.top - channel.bottom, channel.width)
    return Box((-channel.end, channel.bottom, -channel.width / 2), size)


def chamber_boxes(finger: FingerDimensions) -> list[Box]:
    """The boxes of the air chambers below the channel, beginning at the base."""
    chambers = finger.chambers
    y = finger.channel.bottom - chambers.height
    size = (chambers.width, chambers.height, chambers.depth)
    return [Box((-(start + chambers.width), y, -chambers.depth / 2), size) for start in starts(chambers)]


def stiff_layer_box(finger: FingerDimensions) -> Box | None:
    """The box of the layer of stiffer silicone; or None."""
    layer = finger.stiff_layer
    if layer.thickness == 0:
        return None
    return Box((-layer.end, layer.bottom, -layer.width / 2), (layer.end - layer.start, layer.thickness, layer.width))


# The walls around a finger's cavity: their thicknesses, the thin ones among them, and their layers of elements.

THIN = 1.5
"""Largest thickness of a thin wall over that of the thinnest: a thicker one bends little [-]."""

FLATTEST = 2.4
"""Largest edge of elements over the thickness of their layer: with longer ones the tetrahedra are flat [-]."""

SHARED = 2 / 3
"""Share of a wall between two chambers that layers fill: they grow from both sides, and must not meet [-]."""


@dataclass(frozen=True)
class WalledBox:
    """A box of the cavity and the silicone around it.

    Attributes:
        box: the channel, or a chamber.
        walls: thickness of the silicone at its faces [mm], shape (2, 3): those with the smallest x, y and z, then those
            with the largest.
        shared: whether there is air again behind the silicone at each face, shape (2, 3).
    """

    box: Box
    walls: np.ndarray
    shared: np.ndarray


def walled_boxes(finger: FingerDimensions) -> list[WalledBox]:
    """The channel and the chambers, each with the silicone around it, or beside it where it opens into another box."""
    return [_channel(finger), *(_chamber(finger, number) for number in range(finger.chambers.count))]


def thin_walls(finger: FingerDimensions) -> np.ndarray:
    """Thicknesses of the thin walls [mm], thinnest first, shape (count,) with count of at least 1."""
    thicknesses = np.sort(np.concatenate([walled.walls.ravel() for walled in walled_boxes(finger)]))
    return thicknesses[thicknesses <= THIN * thicknesses[0]]


def layer_count(finger: FingerDimensions) -> int:
    """Number of layers in the thinnest wall: `elements_across_walls`, or fewer if these were flat; 1 if even."""
    sizes = finger.mesh
    if sizes.smallest == sizes.largest:
        return 1
    affordable = int(FLATTEST * thin_walls(finger)[0] / sizes.smallest)
    return max(1, min(sizes.elements_across_walls, affordable))


def layer_boxes(finger: FingerDimensions, share: float) -> list[Box]:
    """The boxes of the cavity, grown by a share of the walls around them, but not far into thick ones."""
    thin = thin_walls(finger)
    grown = []
    for walled in walled_boxes(finger):
        full = np.where(walled.shared, SHARED, 1.0) * walled.walls
        depth = np.where(walled.walls <= thin[-1], full, thin[0])
        grown.append(walled.box.grown(*(share * depth)))
    return grown


def _channel(finger: FingerDimensions) -> WalledBox:
    body, channel = finger.body, finger.channel
    box = channel_box(finger)
    underneath = [finger.underside(channel.end)]
    underneath += [slot.size[1] for slot in slot_boxes(finger) if _overlap(slot, box)]
    side = (body.width - channel.width) / 2
    below = [body.length - channel.end, channel.bottom - max(underneath), side]
    above = [channel.start, body.height - channel.top, side]
    return WalledBox(box, np.array([below, above]), np.zeros((2, 3), dtype=bool))


def _chamber(finger: FingerDimensions, number: int) -> WalledBox:
    body, boxes = finger.body, chamber_boxes(finger)
    box = boxes[number]
    beside = [slot for slot in slot_boxes(finger) if slot.size[1] > box.corner[1]]
    behind, ahead = body.length + box.lower[0], -box.upper[0]  # to the tip and to the base
    behind = min([behind, *(gap for slot in beside if (gap := box.lower[0] - slot.upper[0]) > 0)])
    ahead = min([ahead, *(gap for slot in beside if (gap := slot.lower[0] - box.upper[0]) > 0)])
    shared_behind = number + 1 < len(boxes) and box.lower[0] - boxes[number + 1].upper[0] < behind
    shared_ahead = number > 0 and boxes[number - 1].lower[0] - box.upper[0] < ahead
    if shared_behind:
        behind = box.lower[0] - boxes[number + 1].upper[0]
    if shared_ahead:
        ahead = boxes[number - 1].lower[0] - box.upper[0]
    underneath = [finger.underside(-box.lower[0])]
    underneath += [slot.size[1] for slot in slot_boxes(finger) if slot not in beside and _overlap(slot, box)]
    side = (body.width - finger.chambers.depth) / 2
    below = [behind, box.corner[1] - max(underneath), side]
    above = [ahead, body.height - finger.channel.top, side]
    shared = [[shared_behind, False, False], [shared_ahead, False, False]]
    return WalledBox(box, np.array([below, above]), np.array(shared))


def _overlap(first: Box, second: Box) -> bool:
    """Whether two boxes share a stretch along x."""
    return bool(first.lower[0] < second.upper[0] and second.lower[0] < first.upper[0])


# The parts of a finger that scenes name: groups of its tetrahedra and of its boundary triangles.


def element_groups(finger: FingerParameters, nodes: np.ndarray, elements: np.ndarray) -> dict[str, np.ndarray]:
    """Groups of elements, each (count,) element indices.

    "silicone" has all. "stiff_layer" has those whose mean of nodes lies in the layer, as a box in a scene would select
    them: faces of the mesh along the layer's would be a fraction of a millimetre from the channel's, and the elements
    between them as flat. "base_block" has those that lie whole within body.base_length of the base; in an even mesh,
    which does not end there, there may be none.

    Args:
        finger: the dimensions.
        nodes: positions [mm], shape (node_count, 3).
        elements: tetrahedra, shape (element_count, 4).
    """
    groups = {"silicone": np.arange(len(elements), dtype=np.int32)}
    layer = stiff_layer_box(finger)
    if layer is not None:
        groups["stiff_layer"] = _indices(layer.holds(nodes[elements].mean(axis=1)))
        if not len(groups["stiff_layer"]):
            raise ValueError(
                f"stiff_layer.thickness = {finger.stiff_layer.thickness:g}: no element has its middle in the layer; "
                f"must be larger, or 0 for none, or mesh.largest = {finger.mesh.largest:g} smaller"
            )
    held = nodes[:, 0] >= -finger.body.base_length - TOUCH
    base = _indices(held[elements].all(axis=1))
    return {**groups, "base_block": base} if len(base) else groups


def surface_groups(nodes: np.ndarray, elements: np.ndarray) -> dict[str, np.ndarray]:
    """Groups of boundary triangles of a body in one piece, each (count, 3) node indices.

    "outer" is closed and faces outward; "base" is the part of it in the plane x = 0. "cavity", or "cavity_0",
    "cavity_1", ... from the base on where there are several, are closed and face into the silicone, so that the
    volumes that they enclose are positive.

    Args:
        nodes: positions [mm], shape (node_count, 3).
        elements: tetrahedra of positive volume, shape (element_count, 4).
    """
    skins, cavities = skins_and_cavities(nodes, elements)
    if len(skins) != 1:
        raise MeshError(f"the body has {len(skins)} outer skins; it must be one piece of silicone")
    (outer,) = skins
    in_base = (np.abs(nodes[outer, 0]) < TOUCH).all(axis=1)
    cavities.sort(key=lambda cavity: -nodes[cavity, 0].max())
    names = cavity_names(len(cavities))
    return {"outer": outer, "base": outer[in_base], **dict(zip(names, cavities, strict=True))}


def _indices(chosen: np.ndarray) -> np.ndarray:
    return np.flatnonzero(chosen).astype(np.int32)


# A finger as a solid, made by OpenCASCADE in gmsh.

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
    """Make the silicone, cut along the inner surfaces where elements are to end; the model then holds nothing else."""
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


def drawn_out(occ: Any, corners: Sequence[tuple[float, float, float]], shift: tuple[float, float, float]) -> Solids:
    """The solid between a polygon and the same one shifted."""
    points = [occ.addPoint(*corner) for corner in corners]
    sides = [occ.addLine(a, b) for a, b in zip(points, points[1:] + points[:1], strict=True)]
    face = occ.addPlaneSurface([occ.addCurveLoop(sides)])
    return [part for part in occ.extrude([(2, face)], *shift) if part[0] == 3]


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
        add_box_of_size(gmsh, box.lower, box.upper, sizes.smallest, sizes.largest)
    obey_size_fields(gmsh)
    mesh.generate(2)
    if layer_count(finger) == 1:
        gmsh.option.setNumber("Mesh.MeshSizeMin", 0)
        for box in walls:
            add_box_of_size(gmsh, box.lower, box.upper, INSIDE * sizes.smallest, sizes.largest, sharp=True)
        obey_size_fields(gmsh)
    mesh.generate(3)


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
