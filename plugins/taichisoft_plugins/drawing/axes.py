"""Axes as arrows: those of the scene in a corner of the picture, and those of bodies where they are."""

from typing import Any

import numpy as np

from taichisoft_plugins.drawing.camera import Camera, project
from taichisoft_plugins.drawing.painting import Colour, arrow_outline, paint_polygon, paint_text

AXIS_COLOURS: dict[str, Colour] = {"x": (0.80, 0.16, 0.16), "y": (0.13, 0.55, 0.20), "z": (0.16, 0.32, 0.80)}
ON_DARK: dict[str, Colour] = {"x": (0.95, 0.35, 0.30), "y": (0.35, 0.78, 0.40), "z": (0.42, 0.58, 1.00)}
"""The same on a dark background."""
BODY_AXIS = 0.25
"""Length of the arrows at bodies, in radii of the scene [-]."""
WIDTH = 1 / 180
"""Width of an arrow's shaft, in heights of the picture [-]."""


def paint_axes(picture: Any, camera: Camera, colours: dict[str, Colour]) -> None:
    """Paint the directions of x, y and z, as the camera sees them, into the lower left corner of a Pillow image."""
    height = picture.height
    origin = np.array([0.1 * height, 0.9 * height])
    right, above, backward = camera.axes
    # The one that points away is painted first.
    for axis in np.argsort(backward):
        name = "xyz"[axis]
        direction = np.array([right[axis], -above[axis]])
        length = np.linalg.norm(direction)
        tip = origin + 0.065 * height * direction
        if length > 0.1:
            paint_polygon(picture, arrow_outline(origin, tip, WIDTH * height), colours[name])
        # An axis that points at the viewer, or away, has its name beside the origin.
        outward = direction / length if length > 0.3 else np.array([-0.7, 0.7])
        label = origin + (0.065 * length + 0.017) * height * outward
        paint_text(picture, (label[0], label[1]), name, height / 38, colours[name], "mm")


def paint_body_axes(picture: Any, camera: Camera, axes: np.ndarray, radius: float, colours: dict[str, Colour]) -> None:
    """Paint the axes of bodies into a Pillow image, over what is there, so that none is hidden inside its body.

    Args:
        picture: a Pillow image in RGB, which is changed.
        camera: the camera that sees them.
        axes: origin [mm] and unit vectors along x, y and z of each, shape (count, 4, 3).
        radius: radius of the scene [mm].
        colours: by the names x, y and z.
    """
    origins = np.repeat(axes[:, 0], 3, axis=0)
    ends = origins + BODY_AXIS * radius * axes[:, 1:].reshape(-1, 3)
    tails, tail_distance = project(camera, origins, picture.size)
    tips, distance = project(camera, ends, picture.size)
    before_camera = np.minimum(distance, tail_distance) > 1.0
    for index in np.argsort(-distance):
        if before_camera[index]:
            outline = arrow_outline(tails[index], tips[index], WIDTH * picture.height)
            paint_polygon(picture, outline, colours["xyz"[index % 3]])
