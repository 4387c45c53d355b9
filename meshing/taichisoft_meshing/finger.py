"""The dimensions of a finger: a block with a slanted tip, slots across its underside and air chambers inside.

Axes as in the mesh: the base is the plane x = 0 and the finger points to -x; y goes from the slotted side
(0) to the stiff back; z is centred. Positions along the finger are distances from the base, all in [mm].
"""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, model_validator

from taichisoft_meshing.finger_walls import check_walls

Length = Annotated[float, Field(gt=0)]
Count = Annotated[int, Field(ge=1)]


class _Table(BaseModel):
    """A table of a finger file: no unknown keys, no text or truth values for numbers, no NaN or infinity."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class Body(_Table):
    """The block of silicone."""

    length: Length = 115.0
    """[mm] along x, from the base to the tip."""
    height: Length = 30.0
    """[mm] along y."""
    width: Length = 20.0
    """[mm] along z."""
    tip_height: Length = 10.0
    """[mm] along y, of the face at the tip; below it the underside rises."""
    taper_length: Length = 20.0
    """[mm] along x, over which the underside rises to the tip's face."""


class Slots(_Table):
    """Cuts across the underside, which let the finger bend."""

    count: Annotated[int, Field(ge=0)] = 6
    width: Length = 2.5
    """[mm] along x."""
    depth: Length = 16.5
    """[mm] along y, from the underside."""
    pitch: Length = 13.0
    """[mm] along x, from one slot to the next."""
    first: Length = 23.9106
    """[mm] from the base to the near side of the first slot."""


class Channel(_Table):
    """The air duct that joins the chambers."""

    start: Length = 16.0
    """[mm] from the base to its near end."""
    end: Length = 99.0
    """[mm] from the base to its far end."""
    bottom: Length = 19.5
    """[mm] y of its lower side."""
    top: Length = 22.0
    """[mm] y of its upper side."""
    width: Length = 15.0
    """[mm] along z."""


class Chambers(_Table):
    """The air chambers that hang from the channel."""

    count: Count = 7
    width: Length = 5.0
    """[mm] along x."""
    pitch: Length = 13.0
    """[mm] along x, from one chamber to the next."""
    first: Length = 16.0
    """[mm] from the base to the near side of the first chamber."""
    height: Length = 11.0
    """[mm] along y, below the channel."""
    depth: Length = 15.0
    """[mm] along z."""


class ElementSizes(_Table):
    """How fine the tetrahedra are; equal sizes mesh evenly."""

    largest: Length = 10.0
    """[mm] edge length far from the cavity."""
    smallest: Length = 10.0
    """[mm] edge length at the corners of the cavity."""


class FingerParameters(_Table):
    """A finger of the kind used in the PneuNet gripper tutorial; the defaults are that finger."""

    body: Body = Body()
    slots: Slots = Slots()
    channel: Channel = Channel()
    chambers: Chambers = Chambers()
    mesh: ElementSizes = ElementSizes()

    @model_validator(mode="after")
    def _check_walls(self) -> "FingerParameters":
        check_walls(self)
        return self

    @property
    def outline(self) -> list[tuple[float, float]]:
        """Corners (x, y) [mm] of the side view without slots, in order around it."""
        body = self.body
        return [
            (0.0, 0.0),
            (0.0, body.height),
            (-body.length, body.height),
            (-body.length, body.height - body.tip_height),
            (-(body.length - body.taper_length), 0.0),
        ]

    @property
    def cavity_volume(self) -> float:
        """Air in the channel and the chambers [mm^3]."""
        channel, chambers = self.channel, self.chambers
        duct = (channel.end - channel.start) * (channel.top - channel.bottom) * channel.width
        return duct + chambers.count * chambers.width * chambers.height * chambers.depth

    @property
    def solid_volume(self) -> float:
        """Silicone and air [mm^3]: the block less its taper and its slots."""
        body, slots = self.body, self.slots
        taper = body.taper_length * (body.height - body.tip_height) / 2
        side_view = body.length * body.height - taper - slots.count * slots.width * slots.depth
        return side_view * body.width
