"""The axes of the scene in a corner of the picture."""

from typing import Any

import numpy as np

from taichisoft_plugins.drawing.camera import Camera
from taichisoft_plugins.drawing.painting import Colour, arrow_outline, paint_polygon, write

COLOURS: dict[str, Colour] = {"x": (0.80, 0.16, 0.16), "y": (0.13, 0.55, 0.20), "z": (0.16, 0.32, 0.80)}


def paint_axes(picture: Any, camera: Camera) -> None:
    """Paint x, y and z as the camera sees their directions into the lower left corner of a Pillow image."""
    height = picture.height
    origin = np.array([0.1 * height, 0.9 * height])
    right, above, backward = camera.axes
    # The one that points away is painted first.
    for axis in np.argsort(backward):
        name = "xyz"[axis]
        direction = np.array([right[axis], -above[axis]])
        tip = origin + 0.065 * height * direction
        if np.linalg.norm(direction) > 0.1:
            paint_polygon(picture, arrow_outline(origin, tip, height / 180), COLOURS[name])
        label = origin + (0.065 * np.linalg.norm(direction) + 0.017) * height * _unit(direction)
        write(picture, (label[0], label[1]), name, height / 38, COLOURS[name], "mm")


def _unit(direction: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(direction)
    # An axis that points at the viewer, or away, has its name beside the origin.
    return direction / length if length > 0.3 else np.array([-0.7, 0.7])
