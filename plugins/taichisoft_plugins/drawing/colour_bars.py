"""Bars at the right edge of the picture that say what its colours mean."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from taichisoft_plugins.drawing.colour_scale import ColourScale
from taichisoft_plugins.drawing.painting import SMALLEST, Colour, write

ROOM = 0.185
"""Width that the bars take, in heights of the picture [-]."""


def paint_bars(picture: Any, scales: Sequence[ColourScale], ink: Colour) -> None:
    """Paint the bars one under the other into a Pillow image."""
    from PIL import Image

    height = picture.height
    letters = max(height / 40, SMALLEST)
    left = picture.width - ROOM * height
    width, length = round(0.022 * height), round(0.28 * height)
    for index, scale in enumerate(scales):
        top = round((0.15 + 0.40 * index) * height)
        right = picture.width - 0.02 * height
        write(picture, (right, top - 0.8 * letters), scale.title, letters, ink, "rs")
        values = np.linspace(scale.high, scale.low, length)
        colours = np.rint(255 * scale.colours(values)).astype(np.uint8)
        picture.paste(Image.fromarray(np.repeat(colours[:, None], width, axis=1)), (round(left), top))
        for value in np.linspace(scale.high, scale.low, 3):
            place = top + (scale.high - value) / (scale.high - scale.low) * length
            write(picture, (left + width + 0.012 * height, place), f"{value:g}", letters, ink, "lm")
