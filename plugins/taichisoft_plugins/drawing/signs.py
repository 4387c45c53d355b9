"""What is written and painted over a picture: forces, axes, colour bars, caption."""

from collections.abc import Sequence

import numpy as np

from taichisoft_plugins.drawing.camera import Camera
from taichisoft_plugins.drawing.caption import caption_parts, paint_caption
from taichisoft_plugins.drawing.colour_bars import paint_bars
from taichisoft_plugins.drawing.colour_scale import ColourScale
from taichisoft_plugins.drawing.corner_axes import paint_axes
from taichisoft_plugins.drawing.force_arrows import ForceArrows
from taichisoft_plugins.drawing.painting import text_colour
from taichisoft_plugins.drawing.style import Style
from taichisoft_plugins.recording.reader import Recording


class Signs:
    """The signs that a style wants.

    Args:
        recording: stays open.
        style: what the user chose.
        frames: all that will be drawn.
        scales: what the colours of the surfaces mean.
        radius: of the scene [mm].
    """

    def __init__(
        self,
        recording: Recording,
        style: Style,
        frames: Sequence[int],
        scales: Sequence[ColourScale],
        radius: float,
    ):
        self._recording, self._style, self._scales = recording, style, scales
        self._arrows = ForceArrows(recording, frames, radius) if style.arrows else None
        self._ink = text_colour(style.background_colour)

    def paint(self, picture: np.ndarray, camera: Camera, frame: int) -> np.ndarray:
        """The picture, shape (height, width, 3), dtype uint8, with the signs of a frame over it."""
        from PIL import Image

        image = Image.fromarray(picture)
        if self._arrows is not None:
            self._arrows.paint(image, camera, frame)
            self._arrows.paint_scale(image, camera, self._ink)
        if self._style.axes:
            paint_axes(image, camera)
        paint_bars(image, self._scales, self._ink)
        if self._style.caption:
            paint_caption(image, caption_parts(self._recording, frame), self._ink)
        return np.array(image)
