"""Walls of a finger that are given by their thickness: the positions that follow."""

from pydantic import BaseModel

from taichisoft_meshing.finger.dimensions import FingerDimensions
from taichisoft_meshing.finger.walls import THINNEST_WALL, at_most


def positions_from_walls(finger: FingerDimensions) -> dict[str, BaseModel]:
    """Tables that change, by name, for the thicknesses that are given: see `finger.Walls`.

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
