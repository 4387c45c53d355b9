"""How thick the silicone is around each box of a finger's cavity, and which of these walls are thin."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from taichisoft_meshing.finger.boxes import Box, chamber_boxes, channel_box, slot_boxes

if TYPE_CHECKING:
    from taichisoft_meshing.finger.parameters import FingerParameters

THIN = 1.5
"""Times the thinnest wall: a wall that is thicker bends little, and is none of the thin ones."""


@dataclass(frozen=True)
class WalledBox:
    """A box of the cavity and the silicone around it.

    Attributes:
        box: the channel, or a chamber.
        below: thickness of the silicone at its faces with the smallest x, y and z [mm], shape (3,).
        above: at those with the largest.
        shared_below: whether there is air again behind it, shape (3,).
        shared_above: likewise.
    """

    box: Box
    below: np.ndarray
    above: np.ndarray
    shared_below: np.ndarray
    shared_above: np.ndarray


def walled_boxes(finger: "FingerParameters") -> list[WalledBox]:
    """The channel and the chambers with their walls; where a box opens into another, the silicone beside that."""
    return [_channel(finger), *(_chamber(finger, number) for number in range(finger.chambers.count))]


def thin_walls(finger: "FingerParameters") -> np.ndarray:
    """Thicknesses of the thin walls [mm], thinnest first, shape (count,) with count of at least 1."""
    found = np.sort(np.concatenate([np.concatenate([walled.below, walled.above]) for walled in walled_boxes(finger)]))
    return found[found <= THIN * found[0]]


def _channel(finger: "FingerParameters") -> WalledBox:
    body, channel = finger.body, finger.channel
    box = channel_box(finger)
    underneath = [finger.underside(channel.end)]
    underneath += [slot.size[1] for slot in slot_boxes(finger) if _overlap(slot, box)]
    side = (body.width - channel.width) / 2
    return WalledBox(
        box,
        below=np.array([body.length - channel.end, channel.bottom - max(underneath), side]),
        above=np.array([channel.start, body.height - channel.top, side]),
        shared_below=np.zeros(3, dtype=bool),
        shared_above=np.zeros(3, dtype=bool),
    )


def _chamber(finger: "FingerParameters", number: int) -> WalledBox:
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
    return WalledBox(
        box,
        below=np.array([behind, box.corner[1] - max(underneath), side]),
        above=np.array([ahead, body.height - finger.channel.top, side]),
        shared_below=np.array([shared_behind, False, False]),
        shared_above=np.array([shared_ahead, False, False]),
    )


def _overlap(one: Box, other: Box) -> bool:
    """Whether they share a stretch along x."""
    return bool(one.lower[0] < other.upper[0] and other.lower[0] < one.upper[0])
