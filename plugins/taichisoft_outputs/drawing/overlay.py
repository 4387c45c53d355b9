"""What is painted over a finished picture: contact forces, axes, colour bars, and a caption."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from taichisoft.actuators import ACTUATOR_KINDS
from taichisoft_outputs.drawing.arrows import AXIS_COLOURS, ON_DARK, ForceArrows, paint_axes, paint_body_axes
from taichisoft_outputs.drawing.camera import PictureCamera, project
from taichisoft_outputs.drawing.colouring import body_colours
from taichisoft_outputs.drawing.painting import (
    SMALLEST_LETTERS,
    Colour,
    font,
    is_dark,
    paint_polygon,
    paint_text,
    text_colour,
)
from taichisoft_outputs.drawing.scales import ColourScale
from taichisoft_outputs.drawing.style import Style
from taichisoft_outputs.recording.reader import Recording

MARK_COLOUR: Colour = (0.84, 0.16, 0.36)
COLOUR_BAR_WIDTH = 0.185
"""Width of the edge of the picture in which the colour bars stand, in heights of the picture [-]."""
SINGLE_FIGURES = 4
"""The caption gives more pressures or tensions than these as a range."""
CAPTION_BODIES = 3
"""Number of rigid bodies, at most, whose height is in the caption."""


class Overlay:
    """Paints all that a style wants over a picture.

    Args:
        recording: the recording, which stays open.
        style: what the user chose.
        frames: all frames that will be drawn.
        scales: what the colours of the surfaces mean.
        radius: radius of the scene [mm].
    """

    def __init__(
        self, recording: Recording, style: Style, frames: Sequence[int], scales: Sequence[ColourScale], radius: float
    ):
        self._recording, self._style, self._scales = recording, style, scales
        behind = [np.array(style.background_colour), *body_colours(recording.scene).values()]
        self._arrows = ForceArrows(recording, frames, radius, behind) if style.arrows else None
        self._ink = text_colour(style.background_colour)
        self._axis_colours = ON_DARK if is_dark(style.background_colour) else AXIS_COLOURS
        self._radius = radius

    def paint(self, picture: np.ndarray, camera: PictureCamera, frame: int, marks: np.ndarray) -> np.ndarray:
        """The picture of a frame with everything painted over it, marks too; shape (height, width, 3), dtype uint8."""
        from PIL import Image

        image = Image.fromarray(picture)
        if self._arrows is not None:
            self._arrows.paint(image, camera, frame)
            self._arrows.paint_scale(image, camera, self._ink)
        if self._style.body_axes:
            paint_body_axes(image, camera, self._recording.body_axes(frame), self._radius, self._axis_colours)
        paint_marks(image, camera, marks)
        if self._style.axes:
            paint_axes(image, camera, self._axis_colours)
        paint_colour_bars(image, self._scales, self._ink)
        if self._style.caption:
            paint_caption(image, caption_parts(self._recording, frame), self._ink)
        return np.asarray(image)


def paint_marks(picture: Any, camera: PictureCamera, points: np.ndarray) -> None:
    """Paint a ring and a dot at points [mm], shape (count, 3), into a Pillow image; nothing hides them."""
    height = picture.height
    angles = np.linspace(0.0, 2.0 * np.pi, 49)
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    places, depths = project(camera, points, picture.size)
    for place in places[depths > 1.0]:
        outline = [place + 0.022 * height * circle, place + 0.015 * height * circle[::-1]]
        paint_polygon(picture, np.concatenate(outline), MARK_COLOUR)
        paint_polygon(picture, place + 0.005 * height * circle, MARK_COLOUR)


def paint_colour_bars(picture: Any, scales: Sequence[ColourScale], ink: Colour) -> None:
    """Paint a bar for each scale, one under the other, at the right edge of a Pillow image."""
    from PIL import Image

    height = picture.height
    letters = max(height / 40, SMALLEST_LETTERS)
    left = picture.width - COLOUR_BAR_WIDTH * height
    width, length = round(0.022 * height), round(0.28 * height)
    for index, scale in enumerate(scales):
        top = round((0.15 + 0.40 * index) * height)
        right = picture.width - 0.02 * height
        paint_text(picture, (right, top - 0.8 * letters), scale.title, letters, ink, "rs")
        values = np.linspace(scale.high, scale.low, length)
        colours = np.rint(255 * scale.colours(values)).astype(np.uint8)
        picture.paste(Image.fromarray(np.repeat(colours[:, None], width, axis=1)), (round(left), top))
        for value in np.linspace(scale.high, scale.low, 3):
            place = top + (scale.high - value) / (scale.high - scale.low) * length
            paint_text(picture, (left + width + 0.012 * height, place), f"{value:g}", letters, ink, "lm")


def caption_parts(recording: Recording, frame: int) -> list[str]:
    """What the caption of a frame says."""
    parts = [f"{recording.times[frame]:.2f} s"]
    for kind in ACTUATOR_KINDS:
        if recording.actuators.names_of(kind):
            effort = kind.effort
            texts = [f"{value:z.{effort.digits}f}" for value in recording.row(effort.name, frame)]
            parts.append(_figures_text(effort.words, texts, effort.unit))
    start = recording.row("rigid_position", recording.last_start if frame >= recording.last_start else 0)
    rises = (recording.row("rigid_position", frame) - start) @ recording.scene.up
    raised = dict(zip(recording.scene.rigid_bodies, rises, strict=True))
    for name in recording.scene.objects[:CAPTION_BODIES]:
        parts.append(f"{name} raised {_one_decimal(raised[name])} mm")
    return parts


def paint_caption(picture: Any, parts: list[str], ink: Colour) -> None:
    """Write the parts into the upper left corner of a Pillow image, in as few lines as they fit."""
    height = picture.height
    letters, edge = height / 32, 0.03 * height
    lines: list[str] = []
    for part in parts:
        longer = f"{lines[-1]}     {part}" if lines else part
        if lines and font(letters).getlength(longer) <= picture.width - 2 * edge:
            lines[-1] = longer
        else:
            lines.append(part)
    for number, line in enumerate(lines):
        place = edge, edge + number * 1.4 * max(letters, SMALLEST_LETTERS)
        paint_text(picture, place, line, letters, ink, "la")


def _figures_text(name: str, texts: list[str], unit: str) -> str:
    if len(set(texts)) == 1:
        return f"{name} {texts[0]} {unit}"
    if len(texts) <= SINGLE_FIGURES:
        return f"{name}s {', '.join(texts)} {unit}"
    in_order = sorted(texts, key=float)
    return f"{name}s from {in_order[0]} to {in_order[-1]} {unit}"


def _one_decimal(value: float) -> str:
    """The number with one decimal; what rounds to zero has no sign."""
    return f"{round(float(value), 1) + 0.0:.1f}"
