"""The dimensions of a finger: a block with a slanted tip, slots across its underside and air chambers inside.

Axes as in the mesh: the base is the plane x = 0 and the finger points to -x; y goes from the slotted side
(0) to the stiff back; z is centred. Positions along the finger are distances from the base, all in [mm].
"""

import math
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

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
