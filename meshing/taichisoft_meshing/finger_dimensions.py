"""The dimensions of a finger: a block with a slanted tip, slots across its underside and air chambers inside.

Axes as in the mesh: the base is the plane x = 0 and the finger points to -x; y goes from the slotted side
(0) to the stiff back; z is centred. Positions along the finger are distances from the base, all in [mm].
"""

import math
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from taichisoft_meshing.body_tables import refuse_sizes
from taichisoft_meshing.geometry_file import ROUNDING, at_least, at_most

Length = Annotated[float, Field(gt=0)]
LengthOrNone = Annotated[float, Field(ge=0)]  # 0: left out
Count = Annotated[int, Field(ge=1)]
CountOrNone = Annotated[int, Field(ge=0)]


class _Table(BaseModel):
    """A table of a finger file: no unknown keys, no text or truth values for numbers, no NaN or infinity."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class WallThicknesses(_Table):
    """Thicknesses of silicone; one that is given takes the place of the positions that it decides."""

    side: Length | None = None
    """Thickness along z from the cavity to the outside [mm]; decides channel.width and chambers.depth."""
    back: Length | None = None
    """Thickness along y above the channel [mm]; decides channel.top, and shifts channel.bottom with it."""
    floor: Length | None = None
    """Thickness along y from the underside at the base to the chambers [mm]; decides chambers.height."""
    web: Length | None = None
    """Thickness along y from the slots up to the channel [mm]; decides slots.depth."""
    slot: Length | None = None
    """Thickness along x from a slot to the chambers beside it [mm]; decides slots.width, first and pitch."""


class FingerBody(_Table):
    """The block of silicone."""

    length: Length = 115.0
    """Length along x from the base to the tip [mm]."""
    height: Length = 30.0
    """Height along y from the underside to the back [mm]."""
    width: Length = 20.0
    """Width along z [mm]."""
    tip_height: Length = 10.0
    """Height along y of the face at the tip, below which the underside rises [mm]."""
    taper_length: Length = 20.0
    """Length along x over which the underside rises to the face at the tip [mm]."""
    base_length: Length = 10.0
    """Length along x of the part that is held [mm]: element group "base_block"."""


class Slots(_Table):
    """Cuts across the underside, which let the finger bend."""

    count: CountOrNone = 6
    """Number of slots."""
    width: Length = 2.5
    """Width of each slot along x [mm]."""
    depth: Length = 16.5
    """Depth of each slot along y from the underside [mm]."""
    pitch: Length = 13.0
    """Distance along x from one slot to the next [mm]."""
    first: Length = 23.9106
    """Distance from the base to the near side of the first slot [mm]."""
    fillet_radius: LengthOrNone = 0.0
    """Radius of the two edges across the finger at the bottom of each slot [mm]; 0: sharp edges."""


class AirChannel(_Table):
    """The air duct that joins the chambers."""

    start: Length = 16.0
    """Distance from the base to the near end of the channel [mm]."""
    end: Length = 99.0
    """Distance from the base to the far end of the channel [mm]."""
    bottom: Length = 19.5
    """Position y of the lower side [mm]."""
    top: Length = 22.0
    """Position y of the upper side [mm]."""
    width: Length = 15.0
    """Width along z [mm]."""


class Chambers(_Table):
    """The air chambers that hang from the channel."""

    count: Count = 7
    """Number of chambers."""
    width: Length = 5.0
    """Width of each chamber along x [mm]."""
    pitch: Length = 13.0
    """Distance along x from one chamber to the next [mm]."""
    first: Length = 16.0
    """Distance from the base to the near side of the first chamber [mm]."""
    height: Length = 11.0
    """Height along y from the lower side of each chamber to the channel [mm]."""
    depth: Length = 15.0
    """Depth of each chamber along z [mm]."""
    fillet_radius: LengthOrNone = 0.0
    """Radius of the two lower edges of each chamber across the finger [mm]; 0: sharp edges."""


class Inlet(_Table):
    """The hole through which the air comes, closed by the tube that is glued into it: it belongs to the cavity."""

    diameter: LengthOrNone = 0.0
    """Diameter of the bore along x into the middle of the channel's near end [mm]; 0: no hole."""
    plug: Length = 5.0
    """Distance from the base to the place where the bore is closed [mm]; the mesh is solid there."""


class StiffLayer(_Table):
    """A layer of stiffer silicone in the back: element group "stiff_layer"."""

    thickness: LengthOrNone = 5.5
    """Thickness along y [mm]; 0: no layer."""
    bottom: Length = 22.5
    """Position y of the lower side [mm]."""
    start: LengthOrNone = 19.0
    """Distance from the base to the near end of the layer [mm]."""
    end: Length = 100.0
    """Distance from the base to the far end of the layer [mm]."""
    width: Length = 16.0
    """Width along z [mm]."""


class ElementSizes(_Table):
    """Sizes of the tetrahedra; equal sizes give an even mesh, without regard to walls."""

    largest: Length = 18.0
    """Edge length far from the cavity [mm]."""
    smallest: Length = 9.0
    """Edge length at the cavity and in the thin walls around it [mm]."""
    elements_across_walls: Count = 2
    """Layers of elements in the thin walls of the cavity, if `smallest` is so small that they are not flat."""
    curvature: CountOrNone = 8
    """Number of edges around a full turn of a fillet or bore; 0: no finer where the surface is curved."""
    order: Literal[1, 2] = 1
    """1: tetrahedra of four nodes; 2: of ten, whose sides follow curved surfaces, for `element = "quadratic"`."""


def starts(row: Slots | Chambers) -> list[float]:
    """Distances from the base to the near sides of the slots or chambers [mm], the smallest first."""
    return [row.first + number * row.pitch for number in range(row.count)]


def end(row: Slots | Chambers) -> float:
    """Distance from the base to the far side of the last slot or chamber [mm]."""
    return row.first + (row.count - 1) * row.pitch + row.width


class FingerDimensions(_Table):
    """All tables of a finger; their values fit together only in `FingerParameters`."""

    wall: Length | None = None
    """Thickness of the side walls [mm]: short for walls.side."""
    walls: WallThicknesses = WallThicknesses()
    body: FingerBody = FingerBody()
    slots: Slots = Slots()
    channel: AirChannel = AirChannel()
    chambers: Chambers = Chambers()
    inlet: Inlet = Inlet()
    stiff_layer: StiffLayer = StiffLayer()
    mesh: ElementSizes = ElementSizes()

    @property
    def outline(self) -> list[tuple[float, float]]:
        """Corners (x, y) of the side view without slots, in order around it [mm]."""
        body = self.body
        return [
            (0.0, 0.0),
            (0.0, body.height),
            (-body.length, body.height),
            (-body.length, body.height - body.tip_height),
            (-(body.length - body.taper_length), 0.0),
        ]

    def underside(self, distance: float) -> float:
        """Position y of the underside, slots apart, at a distance from the base [mm]."""
        body = self.body
        beyond = max(distance - (body.length - body.taper_length), 0.0)
        return (body.height - body.tip_height) * beyond / body.taper_length

    @property
    def cavity_volume(self) -> float:
        """Volume of the air in the channel, the chambers and the inlet [mm^3]."""
        channel, chambers, inlet = self.channel, self.chambers, self.inlet
        duct = (channel.end - channel.start) * (channel.top - channel.bottom) * channel.width
        side_view = chambers.width * chambers.height - 2 * _corner(chambers.fillet_radius)
        bore = math.pi / 4 * inlet.diameter**2 * max(channel.start - inlet.plug, 0.0)
        return duct + chambers.count * side_view * chambers.depth + bore

    @property
    def solid_volume(self) -> float:
        """Volume of silicone and air together, the block less its taper and its slots [mm^3]."""
        body, slots = self.body, self.slots
        taper = body.taper_length * (body.height - body.tip_height) / 2
        cuts = slots.count * (slots.width * slots.depth - 2 * _corner(slots.fillet_radius))
        return (body.length * body.height - taper - cuts) * body.width

    @property
    def is_curved(self) -> bool:
        """Whether some surface is curved, so that flat triangles miss a part of the volume."""
        fillets = self.chambers.fillet_radius, self.slots.fillet_radius * self.slots.count
        return any(fillets) or self.inlet.diameter > 0


def _corner(radius: float) -> float:
    """Area between a right angle and the arc that rounds it [mm^2]."""
    return (1 - math.pi / 4) * radius**2


# The rules between a finger's dimensions: positions that follow from thicknesses, and walls that must remain.

# [mm] A thinner wall cannot be cast, and its elements would be flat.
THINNEST_WALL = 0.1


class FingerParameters(FingerDimensions):
    """A finger whose dimensions fit together; the defaults are the finger of the PneuNet gripper tutorial.

    A thickness in `walls`, or `wall`, decides positions in other tables, which have the decided values.
    """

    @model_validator(mode="after")
    def _check_walls(self) -> "FingerParameters":
        for name, table in positions_from_walls(self).items():
            object.__setattr__(self, name, table)  # frozen, but not made yet
        for check in (
            _check_taper,
            _check_channel,
            _check_chambers,
            _check_slots,
            _check_slots_miss_chambers,
            _check_fillets,
            _check_base,
            _check_stiff_layer,
            _check_sizes,
        ):
            check(self)
        return self


def positions_from_walls(finger: FingerDimensions) -> dict[str, BaseModel]:
    """Tables that change, by name, for the thicknesses that are given in `Walls`."""
    body, slots, channel, chambers, walls = finger.body, finger.slots, finger.channel, finger.chambers, finger.walls
    if finger.wall is not None and walls.side is not None:
        raise ValueError(f"wall = {finger.wall:g}: is short for walls.side, which is given too; give one of them")
    side = walls.side if finger.wall is None else finger.wall
    if side is not None:
        key = "walls.side" if finger.wall is None else "wall"
        at_most(key, side, (body.width - THINNEST_WALL) / 2, "to leave a cavity in body.width")
        channel = channel.model_copy(update={"width": body.width - 2 * side})
        chambers = chambers.model_copy(update={"depth": body.width - 2 * side})
    if walls.back is not None:
        height = channel.top - channel.bottom
        at_most("walls.back", walls.back, body.height - height - THINNEST_WALL, "to leave room for the channel")
        top = body.height - walls.back
        channel = channel.model_copy(update={"top": top, "bottom": top - height})
    if walls.floor is not None:
        at_most("walls.floor", walls.floor, channel.bottom - THINNEST_WALL, "to leave chambers below channel.bottom")
        chambers = chambers.model_copy(update={"height": channel.bottom - walls.floor})
    for key, value in (("walls.web", walls.web), ("walls.slot", walls.slot)):
        if value is not None and slots.count == 0:
            raise ValueError(f"{key} = {value:g}: there are no slots, slots.count = 0; leave it out")
    if walls.web is not None:
        at_most("walls.web", walls.web, channel.bottom - THINNEST_WALL, "to leave slots below channel.bottom")
        slots = slots.model_copy(update={"depth": channel.bottom - walls.web})
    if walls.slot is not None:
        between = chambers.pitch - chambers.width
        at_most("walls.slot", walls.slot, (between - THINNEST_WALL) / 2, "to leave slots between the chambers")
        first = chambers.first + chambers.width + walls.slot
        slots = slots.model_copy(update={"width": between - 2 * walls.slot, "first": first, "pitch": chambers.pitch})
    return {"slots": slots, "channel": channel, "chambers": chambers}


def _check_taper(finger: FingerDimensions) -> None:
    body = finger.body
    at_most("body.tip_height", body.tip_height, body.height - THINNEST_WALL, "below body.height")
    at_most("body.taper_length", body.taper_length, body.length - THINNEST_WALL, "below body.length")


def _check_channel(finger: FingerDimensions) -> None:
    body, channel = finger.body, finger.channel
    at_least("channel.start", channel.start, THINNEST_WALL, "to leave a wall at the base")
    at_least("channel.end", channel.end, channel.start + THINNEST_WALL, "beyond channel.start")
    at_most("channel.end", channel.end, body.length - THINNEST_WALL, "to leave a wall at the tip")
    at_least("channel.top", channel.top, channel.bottom + THINNEST_WALL, "above channel.bottom")
    at_most("channel.top", channel.top, body.height - THINNEST_WALL, "to leave a wall at the back")
    at_most("channel.width", channel.width, body.width - 2 * THINNEST_WALL, "to leave walls at its sides")
    lowest = finger.underside(channel.end) + THINNEST_WALL
    at_least("channel.bottom", channel.bottom, lowest, "to leave a wall above the underside at channel.end")


def _check_chambers(finger: FingerDimensions) -> None:
    channel, chambers = finger.channel, finger.chambers
    last_end = end(chambers)
    if chambers.count > 1:
        at_least("chambers.pitch", chambers.pitch, chambers.width + THINNEST_WALL, "beyond chambers.width")
    at_least("chambers.first", chambers.first, channel.start, "channel.start")
    most = (channel.end - chambers.first - chambers.width) / chambers.pitch + 1
    if last_end > channel.end + ROUNDING:
        raise ValueError(
            f"chambers.count = {chambers.count}: the last chamber would end {last_end:g} mm from the base, "
            f"beyond channel.end = {channel.end:g}; must be at most {max(int(most + ROUNDING), 0)}"
        )
    widest = finger.body.width - 2 * THINNEST_WALL
    at_most("chambers.depth", chambers.depth, widest, "to leave walls at their sides")
    highest = channel.bottom - finger.underside(last_end) - THINNEST_WALL
    at_most("chambers.height", chambers.height, highest, "to leave a wall above the underside")


def _check_slots(finger: FingerDimensions) -> None:
    body, slots = finger.body, finger.slots
    if slots.count == 0:
        return
    at_least("slots.first", slots.first, THINNEST_WALL, "to leave a wall at the base")
    if slots.count > 1:
        at_least("slots.pitch", slots.pitch, slots.width + THINNEST_WALL, "beyond slots.width")
    last_end = end(slots)
    flat = body.length - body.taper_length
    if last_end > flat + ROUNDING:
        raise ValueError(
            f"slots.count = {slots.count}: the last slot would end {last_end:g} mm from the base; "
            f"must end before the taper, which begins at {flat:g}"
        )
    above = finger.channel.bottom - THINNEST_WALL
    at_most("slots.depth", slots.depth, above, "to leave a wall below the channel")


def _check_slots_miss_chambers(finger: FingerDimensions) -> None:
    """A slot that reaches as high as the chambers must pass between them."""
    slots, chambers = finger.slots, finger.chambers
    reach = finger.channel.bottom - chambers.height - THINNEST_WALL
    if slots.depth <= reach + ROUNDING:
        return
    for slot, near in enumerate(starts(slots), 1):
        for chamber, start in enumerate(starts(chambers), 1):
            gap = max(start - (near + slots.width), near - (start + chambers.width))
            if gap < THINNEST_WALL - ROUNDING:
                raise ValueError(
                    f"slots.depth = {slots.depth:g}: slot {slot} ({near:g} to {near + slots.width:g} mm "
                    f"from the base) cuts into chamber {chamber}, which begins at {start:g}; "
                    f"must be at most {reach:g}, or the slots must pass between the chambers"
                )


def _check_fillets(finger: FingerDimensions) -> None:
    """Between two fillets a flat face must remain, as between a fillet and the next edge."""
    slots, chambers = finger.slots, finger.chambers
    if slots.count:
        widest = (slots.width - THINNEST_WALL) / 2
        at_most("slots.fillet_radius", slots.fillet_radius, widest, "below half of slots.width")
        at_most("slots.fillet_radius", slots.fillet_radius, slots.depth - THINNEST_WALL, "below slots.depth")
    widest = (chambers.width - THINNEST_WALL) / 2
    at_most("chambers.fillet_radius", chambers.fillet_radius, widest, "below half of chambers.width")
    at_most("chambers.fillet_radius", chambers.fillet_radius, chambers.height - THINNEST_WALL, "below chambers.height")


def _check_base(finger: FingerDimensions) -> None:
    body, channel, inlet = finger.body, finger.channel, finger.inlet
    at_most("body.base_length", body.base_length, channel.start - THINNEST_WALL, "to end before the channel")
    if finger.slots.count:
        at_most("body.base_length", body.base_length, finger.slots.first - THINNEST_WALL, "to end before the slots")
    flat = body.length - body.taper_length
    at_most("body.base_length", body.base_length, flat - THINNEST_WALL, "to end before the taper")
    if inlet.diameter:
        room = min(channel.top - channel.bottom, channel.width) - 2 * THINNEST_WALL
        at_most("inlet.diameter", inlet.diameter, room, "to open into the near end of the channel")
        at_least("inlet.plug", inlet.plug, THINNEST_WALL, "to close the bore at the base")
        at_most("inlet.plug", inlet.plug, channel.start - THINNEST_WALL, "to leave a bore before channel.start")


def _check_stiff_layer(finger: FingerDimensions) -> None:
    body, layer = finger.body, finger.stiff_layer
    if layer.thickness == 0:
        return
    at_least("stiff_layer.end", layer.end, layer.start + THINNEST_WALL, "beyond stiff_layer.start")
    at_most("stiff_layer.end", layer.end, body.length, "body.length")
    at_most("stiff_layer.bottom", layer.bottom, body.height - THINNEST_WALL, "below body.height")
    at_most("stiff_layer.thickness", layer.thickness, body.height - layer.bottom, "body.height - stiff_layer.bottom")
    at_most("stiff_layer.width", layer.width, body.width, "body.width")


def _check_sizes(finger: FingerDimensions) -> None:
    sizes = finger.mesh
    at_most("mesh.largest", sizes.largest, finger.body.length, "body.length: elements larger than the body")
    at_most("mesh.smallest", sizes.smallest, sizes.largest, "mesh.largest")
    cavity = finger.cavity_volume
    refuse_sizes(sizes.largest, sizes.smallest, finger.solid_volume - cavity, [cavity])
