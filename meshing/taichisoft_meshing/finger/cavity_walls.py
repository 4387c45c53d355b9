"""The walls around a finger's cavity: their thicknesses, the thin ones among them, and their layers of elements."""

from dataclasses import dataclass

import numpy as np

from taichisoft_meshing.finger.boxes import Box, chamber_boxes, channel_box, slot_boxes
from taichisoft_meshing.finger.finger_dimensions import FingerDimensions

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
    found = np.sort(np.concatenate([walled.walls.ravel() for walled in walled_boxes(finger)]))
    return found[found <= THIN * found[0]]


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


def _overlap(one: Box, other: Box) -> bool:
    """Whether two boxes share a stretch along x."""
    return bool(one.lower[0] < other.upper[0] and other.lower[0] < one.upper[0])
