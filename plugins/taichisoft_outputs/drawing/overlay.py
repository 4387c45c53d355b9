"""What is painted over a finished picture: contact forces, axes, colour bars, and a caption."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from taichisoft.mechanics import ACTUATOR_KINDS
from taichisoft.mesh import SectionPlane
from taichisoft_outputs.drawing.camera import PictureCamera, project
from taichisoft_outputs.drawing.colouring import body_colours
from taichisoft_outputs.drawing.painting import (
    AXIS_COLOURS,
    ON_DARK,
    SMALLEST_LETTERS,
    Colour,
    ColourScale,
    ForceArrows,
    as_bytes,
    font,
    is_dark,
    paint_axes,
    paint_body_axes,
    paint_polygon,
    paint_text,
    text_colour,
)
from taichisoft_outputs.drawing.style import Style
from taichisoft_outputs.recording.reader import Recording

MARK_COLOUR: Colour = (0.84, 0.16, 0.36)
LETTERS = 1 / 36
"""Height of letters, in heights of the picture [-]."""
BAR_LENGTH, BAR_WIDTH = 0.25, 1.0
"""Length of a colour bar, in heights of the picture, and its width, in heights of its letters [-]."""
SINGLE_FIGURES = 4
"""The caption gives more pressures or tensions than these as a range."""
GLOW = 0.25
"""How far the background's colour reaches around text and bars in a close-up, in heights of letters [-]."""
CAPTION_BODIES = 3
"""Number of rigid bodies, at most, whose height is in the caption."""


class Overlay:
    """Paints all that a style wants over a picture."""

    def __init__(
        self, recording: Recording, style: Style, instants: Sequence[int], scales: Sequence[ColourScale], radius: float
    ):
        self._recording, self._style, self._scales = recording, style, scales
        behind = [np.array(style.background_colour), *body_colours(recording.scene).values()]
        length = style.force_length
        self._arrows = ForceArrows(recording, instants, radius, behind, length) if style.arrows else None
        self._section = SectionPlane.parse(style.section) if style.section else None
        self._ink = text_colour(style.background_colour)
        self._axis_colours = ON_DARK if is_dark(style.background_colour) else AXIS_COLOURS
        self._radius = radius

    @property
    def arrow_tails(self) -> np.ndarray:
        """Where arrows of forces begin [mm], shape (count, 3)."""
        return np.zeros((0, 3)) if self._arrows is None else self._arrows.tails

    def paint(self, picture: np.ndarray, camera: PictureCamera, instant: int, marks: np.ndarray) -> np.ndarray:
        """The picture of an instant with everything painted over it, marks too."""
        from PIL import Image

        image, letters = Image.fromarray(picture), letters_of(self._style)
        if self._arrows is not None:
            self._arrows.paint(image, camera, instant, self._section)
        if self._style.body_axes:
            paint_body_axes(image, camera, self._recording.body_axes(instant), self._radius, self._axis_colours)
        paint_marks(image, camera, marks)
        if self._style.eye is not None or self._style.followed is not None:  # anything may be behind the text
            written = image.copy()
            self._write(written, camera, instant, letters)
            self._paint_glow(image, written, GLOW * letters)
        self._write(image, camera, instant, letters)
        return np.asarray(image)

    def _write(self, image: Any, camera: PictureCamera, instant: int, letters: float) -> None:
        if self._arrows is not None:
            self._arrows.paint_scale(image, camera, self._ink, letters)
        if self._style.axes:
            paint_axes(image, camera, self._axis_colours, letters)
        if self._style.bars:
            paint_colour_bars(image, self._scales, self._ink, letters)
        words = [self._style.name] if self._style.name else []
        if self._style.caption:
            words += caption_parts(self._recording, instant)
        if words:
            paint_caption(image, words, self._ink, letters)

    def _paint_glow(self, image: Any, written: Any, reach: float) -> None:
        from PIL import Image, ImageChops, ImageFilter

        where = ImageChops.difference(image, written).convert("L").point(lambda value: 255 * (value > 0))
        soft = where.filter(ImageFilter.GaussianBlur(reach)).point(lambda value: min(3 * value, 255))
        image.paste(Image.new("RGB", image.size, as_bytes(self._style.background_colour)), mask=soft)


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


def letters_of(style: Style) -> float:
    """Height of the letters of a style [pixels]."""
    return max(LETTERS * style.size[1] if style.font_size is None else style.font_size, SMALLEST_LETTERS)


def colour_bars_width(scales: Sequence[ColourScale], letters: float) -> float:
    """Width of the edge of the picture in which the colour bars stand [pixels]."""
    texts = [text for scale in scales for text in (*_title_lines(scale), f"{'m' * 2} {scale.top}")]
    return max(map(font(letters).getlength, texts), default=0.0) + 2.0 * letters if texts else 0.0


def paint_colour_bars(picture: Any, scales: Sequence[ColourScale], ink: Colour, letters: float) -> None:
    """Paint a bar for each scale, one under the other, at the right edge of a Pillow image, within a line of ink."""
    from PIL import Image, ImageDraw

    height = picture.height
    left = picture.width - colour_bars_width(scales, letters) + letters
    width, length = round(BAR_WIDTH * letters), round(min(BAR_LENGTH, 0.75 / max(len(scales), 1)) * height)
    top = 0.10 * height
    for scale in scales:
        for line in _title_lines(scale):
            paint_text(picture, (left, top), line, letters, ink, "la")
            top += 1.25 * letters
        top = round(top + 0.5 * letters)
        values = np.linspace(scale.high, scale.low, length)
        colours = np.rint(255 * scale.colours(values)).astype(np.uint8)
        edge = max(round(letters / 16), 1)
        box = (round(left) - edge, top - edge, round(left) + width + edge - 1, top + length + edge - 1)
        ImageDraw.Draw(picture).rectangle(box, outline=as_bytes(ink), width=edge)
        picture.paste(Image.fromarray(np.repeat(colours[:, None], width, axis=1)), (round(left), top))
        for value, text in ((scale.high, scale.top), ((scale.high + scale.low) / 2, ""), (scale.low, "")):
            place = top + (scale.high - value) / (scale.high - scale.low) * length
            paint_text(picture, (left + width + 0.5 * letters, place), text or f"{value:g}", letters, ink, "lm")
        top += length + 1.5 * letters


def _title_lines(scale: ColourScale) -> list[str]:
    """Words, and the unit under them."""
    words, _, unit = scale.title.rpartition(" ")
    return [words, unit]


def caption_parts(recording: Recording, instant: int) -> list[str]:
    """What the caption of an instant says; bodies are raised from where they were before the base moved."""
    parts = [f"{recording.times[instant]:.2f} s"]
    for kind in ACTUATOR_KINDS:
        if recording.actuators.names_of(kind):
            effort = kind.effort
            texts = [f"{value:z.{effort.digits}f}" for value in recording.row(effort.name, instant)]
            parts.append(_figures_text(effort.words, texts, effort.unit))
    if instant >= recording.lift_start:
        moved = recording.row("rigid_position", instant) - recording.row("rigid_position", recording.lift_start)
        raised = dict(zip(recording.scene.rigid_bodies, moved @ recording.scene.up, strict=True))
        parts += [f"{name} raised {raised[name]:z.1f} mm" for name in recording.scene.objects[:CAPTION_BODIES]]
    return parts


def paint_caption(picture: Any, parts: list[str], ink: Colour, letters: float) -> None:
    """Write the parts into the upper left corner of a Pillow image, in as few lines as they fit."""
    edge = 0.03 * picture.height
    lines: list[str] = []
    for part in parts:
        longer = f"{lines[-1]}     {part}" if lines else part
        if lines and font(letters).getlength(longer) <= picture.width - 2 * edge:
            lines[-1] = longer
        else:
            lines.append(part)
    for number, line in enumerate(lines):
        place = edge, edge + number * 1.4 * letters
        paint_text(picture, place, line, letters, ink, "la")


def _figures_text(name: str, texts: list[str], unit: str) -> str:
    if len(set(texts)) == 1:
        return f"{name} {texts[0]} {unit}"
    if len(texts) <= SINGLE_FIGURES:
        return f"{name}s {', '.join(texts)} {unit}"
    in_order = sorted(texts, key=float)
    return f"{name}s from {in_order[0]} to {in_order[-1]} {unit}"
