"""The rules between a finger's dimensions: positions that follow from thicknesses, and walls that must remain."""

from pydantic import BaseModel, model_validator

from taichisoft_meshing.finger.finger_dimensions import FingerDimensions, end, starts
from taichisoft_meshing.geometry_file import ROUNDING, at_least, at_most
from taichisoft_meshing.size_search import element_count, refuse_too_many

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
    """Tables that change, by name, for the thicknesses that are given in `Walls`.

    Raises:
        ValueError: "key = value: what would be valid", where a thickness leaves no room.
    """
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
    silicone, cavity = finger.solid_volume - finger.cavity_volume, finger.cavity_volume
    refuse_too_many(element_count(silicone, sizes.largest, sizes.largest), "mesh.largest", sizes.largest)
    refuse_too_many(
        element_count(silicone, sizes.largest, sizes.smallest, [cavity]), "mesh.smallest", sizes.smallest, power=2
    )
