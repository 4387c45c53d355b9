"""Soft shadows on a plane: how much of the sun is hidden behind what stands before it."""

from collections.abc import Sequence

import numpy as np

SUN = (0.25, 0.2, 1.0)
"""Direction to the middle of the sun in the axes (right, front, up) of `camera.scene_axes`: high, so that shadows stay
near what casts them."""

SUN_RADIUS = 0.13
"""Radius of the sun, as the tangent of an angle: the edge of a shadow is twice this part of its height wide."""

RAYS = 5
"""Number of points of the sun whose light is followed; the blur hides that they are few."""

PIXELS = 256
"""Width and height of the picture of the shadows."""

Caster = tuple[np.ndarray, np.ndarray, float]
"""Vertices [mm] (vertex_count, 3), outward triangles (triangle_count, 3), and the part of the light they take [-]."""


def shadow(
    casters: Sequence[Caster], centre: np.ndarray, first: np.ndarray, second: np.ndarray, sun: np.ndarray, half: float
) -> np.ndarray:
    """The hidden part of the sun over a square of a plane.

    Args:
        casters: what stands before the plane; a later one covers an earlier one.
        centre: centre of the square [mm], shape (3,).
        first, second: unit vectors along its sides, shape (3,); first x second points to where things stand.
        sun: direction to the sun, shape (3,).
        half: half the width of the square [mm].

    Returns:
        From 0 (light) to 1 (dark), shape (PIXELS, PIXELS); columns run along `first` and rows along
        `second`, from -half to half.
    """
    from PIL import Image, ImageDraw
    from scipy.ndimage import gaussian_filter

    normal = np.cross(first, second)
    sun = sun / (sun @ normal)
    total = np.zeros((PIXELS, PIXELS))
    for ray in range(RAYS):
        angle = 2 * np.pi * ray / RAYS
        light = sun + SUN_RADIUS * (np.cos(angle) * first + np.sin(angle) * second)
        picture = Image.new("L", (PIXELS, PIXELS))
        fill = ImageDraw.Draw(picture).polygon
        for vertices, triangles, opacity in casters:
            offset = vertices - centre
            height = offset @ normal
            on_plane = offset - height[:, None] * light
            pixel = (np.stack([on_plane @ first, on_plane @ second], axis=1) / half + 1) * (PIXELS / 2)
            a, b, c = (pixel[triangles[:, k]] for k in range(3))
            facing = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) > (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
            above = height[triangles].max(axis=1) > 0
            value = round(255 * opacity)
            for corners in np.concatenate([a, b, c], axis=1)[facing & above].tolist():
                fill(corners, fill=value)
        total += np.asarray(picture)
    return gaussian_filter(total / (255 * RAYS), sigma=2.0)
