"""The boxes of a finger's slots, air and layers, in the axes of the mesh."""

from dataclasses import dataclass

import numpy as np

from taichisoft_meshing.finger.finger_dimensions import FingerDimensions, starts

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
