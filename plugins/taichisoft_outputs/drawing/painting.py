"""Smooth polygons and text in a finished picture."""

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from taichisoft_outputs.drawing.style import SMALLEST_LETTERS

SUPERSAMPLING = 4
"""Polygons are painted this many times finer, and reduced."""

Colour = tuple[float, float, float]
"""Red, green and blue, each from 0 to 1 [-]."""


def paint_polygon(picture: Any, corners: Sequence[Sequence[float]] | np.ndarray, colour: Colour) -> None:
    """Paint a filled polygon with smooth edges.

    Args:
        picture: a Pillow image in RGB, which is changed.
        corners: pixels to the right of the left edge and below the upper edge, shape (count, 2).
        colour: colour of the polygon.
    """
    from PIL import Image, ImageDraw

    corners = np.asarray(corners, dtype=float)
    low = np.maximum(np.floor(corners.min(axis=0)).astype(int), 0)
    high = np.minimum(np.ceil(corners.max(axis=0)).astype(int) + 1, picture.size)
    if (high <= low).any():
        return
    mask = Image.new("L", (int(high[0] - low[0]) * SUPERSAMPLING, int(high[1] - low[1]) * SUPERSAMPLING))
    ImageDraw.Draw(mask).polygon([tuple(corner) for corner in (corners - low) * SUPERSAMPLING], fill=255)
    picture.paste(as_bytes(colour), tuple(int(part) for part in low), mask.reduce(SUPERSAMPLING))


def paint_arrow(picture: Any, tail: np.ndarray, tip: np.ndarray, width: float, colour: Colour) -> None:
    """Paint the arrow of `arrow_outline` into a Pillow image."""
    paint_polygon(picture, arrow_outline(tail, tip, width), colour)


def arrow_outline(tail: np.ndarray, tip: np.ndarray, width: float) -> np.ndarray:
    """Corners of an arrow [pixels], shape (7, 2); one shorter than its head is all head, and narrower.

    Args:
        tail, tip: where the arrow begins and ends [pixels], shape (2,).
        width: width of the shaft [pixels].
    """
    length = max(float(np.linalg.norm(tip - tail)), 1e-9)
    along = (tip - tail) / length
    across = np.array([-along[1], along[0]])
    head = min(4.0 * width, length)
    shrunk = head / 4.0
    neck = tip - head * along
    shaft, wing = 0.5 * shrunk * across, 1.6 * shrunk * across
    return np.array([tail + shaft, neck + shaft, neck + wing, tip, neck - wing, neck - shaft, tail - shaft])


def is_dark(background: Sequence[float]) -> bool:
    """Whether what stands on a background should be light."""
    red, green, blue = background
    return 0.3 * red + 0.6 * green + 0.1 * blue <= 0.45


def text_colour(background: Sequence[float]) -> Colour:
    """The colour of text: dark on a light background, light on a dark one."""
    return (0.94, 0.95, 0.97) if is_dark(background) else (0.13, 0.16, 0.20)


@cache
def font(height: float) -> Any:
    """The font of all text, its letters about `height` [pixels] high; reading it takes longer than writing with it."""
    from PIL import ImageFont

    return ImageFont.load_default(size=max(height, SMALLEST_LETTERS))


def paint_text(picture: Any, place: tuple[float, float], text: str, height: float, colour: Colour, anchor: str) -> None:
    """Write text into a picture.

    Args:
        picture: a Pillow image in RGB, which is changed.
        place: place of the anchor [pixels].
        text: what to write.
        height: height of the letters [pixels].
        colour: colour of the letters.
        anchor: Pillow's two letters for the anchor: "la" left and top, "mm" the middle, "ls" left on the line.
    """
    from PIL import ImageDraw

    ImageDraw.Draw(picture).text(place, text, font=font(height), fill=as_bytes(colour), anchor=anchor)


def as_bytes(colour: Colour) -> tuple[int, int, int]:
    """A colour with parts from 0 to 255."""
    red, green, blue = (round(255 * part) for part in colour)
    return red, green, blue
