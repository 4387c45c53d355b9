"""What is painted over a finished picture: contact forces, axes, colour bars, and a caption."""

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np

from taichisoft.mechanics import ACTUATOR_KINDS
from taichisoft.mesh import SectionPlane
from taichisoft_outputs.drawing.camera import (
    PictureCamera,
    depth_of_scale,
    focal_length,
    project,
)
from taichisoft_outputs.drawing.colouring import (
    ColourScale,
    body_colours,
    displacements,
    round_down,
    sample_instants,
)
from taichisoft_outputs.drawing.style import SMALLEST_LETTERS, Style
from taichisoft_outputs.recording.reader import Recording

# Smooth polygons and text in a finished picture.

SUPERSAMPLING = 4
"""Polygons are painted this many times finer, and reduced."""

Colour = tuple[float, float, float]
"""Red, green and blue, each from 0 to 1 [-]."""


def paint_polygon(picture: Any, corners: Sequence[Sequence[float]] | np.ndarray, colour: Colour) -> None:
    """Paint a filled polygon with smooth edges."""
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
    """Corners of an arrow [pixels], shape (7, 2); one shorter than its head is all head, and narrower."""
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


def font_of(text: str, height: float) -> Any:
    """The font of a text, its letters about `height` [pixels] high."""
    return _font(text.isascii(), max(height, SMALLEST_LETTERS))


@cache  # reading a font takes longer than writing with it
def _font(is_ascii: bool, height: float) -> Any:
    from PIL import ImageFont

    if is_ascii:  # which is all that Pillow's font has
        return ImageFont.load_default(size=height)
    from matplotlib import get_data_path

    return ImageFont.truetype(f"{get_data_path()}/fonts/ttf/DejaVuSans.ttf", 0.9 * height)


def paint_text(picture: Any, place: tuple[float, float], text: str, height: float, colour: Colour, anchor: str) -> None:
    """Write text into a picture.

    Args:
        anchor: Pillow's two letters for the anchor: "la" left and top, "mm" the middle, "ls" left on the line.
    """
    from PIL import ImageDraw

    ImageDraw.Draw(picture).text(place, text, font=font_of(text, height), fill=as_bytes(colour), anchor=anchor)


def as_bytes(colour: Sequence[float] | np.ndarray) -> tuple[int, int, int]:
    """A colour with parts from 0 to 255."""
    red, green, blue = (round(255 * float(part)) for part in colour)
    return red, green, blue


# Arrows in a picture: contact forces where they act, axes of bodies, and the scene's axes in a corner.
#
# Arrows are painted over everything, so that none is hidden.

FORCE_COLOURS: tuple[Colour, ...] = ((0.86, 0.27, 0.05), (1.00, 0.86, 0.20), (0.10, 0.75, 0.85))
"""Red, green and blue of force arrows [-]; the later ones are for scenes in which the first one would not be seen."""
SEEN = 0.45
"""Least distance of the colour of arrows from the colours behind them [-]."""
LONGEST = 0.5
"""Length of the arrow of the strongest force, in radii of the scene [-]."""
ARROWS_ALONG = 8
"""Arrows of displacements along the radius of the scene."""
SAMPLES = 200
"""Number of instants, at most, in which the longest vector is looked for."""
FORCE_WIDTH, AXIS_WIDTH = 1 / 220, 1 / 180
"""Width of an arrow's shaft, in heights of the picture [-]."""

AXIS_COLOURS: tuple[Colour, ...] = ((0.80, 0.16, 0.16), (0.13, 0.55, 0.20), (0.16, 0.32, 0.80))
"""Red, green and blue of the axes x, y and z [-]."""
ON_DARK: tuple[Colour, ...] = ((0.95, 0.35, 0.30), (0.35, 0.78, 0.40), (0.42, 0.58, 1.00))
"""The same on a dark background."""
BODY_AXIS = 0.25
"""Length of the arrows at bodies, in radii of the scene [-]."""


class Arrows:
    """Arrows of one scale over all instants: twice the vector is twice the length.

    Args:
        at: gives the points where arrows end [mm], and the vectors [unit], each of shape (count, 3), in an instant.
        words: what a vector is, and its unit, around the number at the arrow that shows the scale.
        instants: instants in which the longest vector is looked for.
        colour: red, green and blue [-].
        length: length of the arrows [mm/unit]; `longest` is that of the longest vector [mm] when it is not given.

    Attributes:
        length: length of the arrows [mm/unit]; 0 where there is none.
        tails: where arrows begin [mm], shape (count, 3), for a camera that is to see them whole.
    """

    def __init__(
        self,
        at: Callable[[int], tuple[np.ndarray, np.ndarray]],
        words: tuple[str, str],
        instants: Sequence[int],
        colour: Colour,
        length: float | None,
        longest: float = 0.0,
    ):
        self._at, self._words, self._colour = at, words, colour
        sample = [at(instant) for instant in sample_instants(instants, SAMPLES)]
        self._strongest = max((float(np.linalg.norm(v, axis=1).max(initial=0.0)) for _, v in sample), default=0.0)
        own = longest / self._strongest if self._strongest else 0.0
        self.length = own if length is None else length
        self.tails = np.concatenate([np.zeros((0, 3)), *(point - self.length * vector for point, vector in sample)])

    def paint(self, picture: Any, camera: PictureCamera, instant: int, section: SectionPlane | None) -> None:
        """Paint an instant's arrows into a Pillow image; none that ends on what is cut off."""
        if self._strongest:
            points, vectors = self._at(instant)
            if section is not None:
                kept = section.facing(camera.eye).height(points) <= 0.0
                points, vectors = points[kept], vectors[kept]
            _paint_arrows(picture, camera, points - self.length * vectors, points, FORCE_WIDTH, [self._colour])

    def paint_scale(self, picture: Any, camera: PictureCamera, ink: Colour, letters: float, row: int = 0) -> None:
        """Paint an arrow of a round length in the lower right corner, as long as in the middle of the scene.

        Args:
            row: number of such arrows below it.
        """
        if not self._strongest:
            return
        vector, height = round_down(self._strongest), picture.height
        length = self.length * vector * focal_length(height) / depth_of_scale(camera, None)
        tip = np.array([picture.width - 0.03 * height, (0.96 - 0.03 * row) * height - 1.5 * row * letters])
        paint_arrow(picture, tip - [length, 0], tip, FORCE_WIDTH * height, self._colour)
        text = f"{self._words[0]} {vector:g} {self._words[1]}"
        paint_text(picture, (tip[0], tip[1] - 0.02 * height), text, letters, ink, "rs")


def force_arrows(
    recording: Recording,
    instants: Sequence[int],
    radius: float,
    behind: Sequence[np.ndarray] = (),
    length: float | None = None,
) -> Arrows:
    """Arrows of contact forces, of a colour that is seen before those `behind`, red, green and blue [-]."""
    return Arrows(recording.contacts, ("force", "mN"), instants, arrow_colour(behind), length, LONGEST * radius)


def displacement_arrows(
    recording: Recording, instants: Sequence[int], radius: float, colour: Colour, length: float
) -> Arrows:
    """Arrows from where points of soft bodies would be if these had kept their shape, `length` times as long [-]."""
    ways = displacements(recording)
    soft = [one.mapping.nodes for one in recording.surfaces if one.kind == "soft" and one.mapping is not None]
    outside = np.unique(np.concatenate([np.zeros(0, dtype=int), *map(np.ravel, soft)]))
    cells = np.rint(recording.row("position", instants[0])[outside] / (radius / ARROWS_ALONG))
    chosen = outside[np.unique(cells, axis=0, return_index=True)[1]]

    def at(instant: int) -> tuple[np.ndarray, np.ndarray]:
        return recording.row("position", instant)[chosen], ways(instant)[chosen]

    return Arrows(at, ("displacement", "mm"), instants, colour, length)


def arrow_colour(behind: Sequence[np.ndarray]) -> Colour:
    """The first of FORCE_COLOURS that is seen before all of these colours, else the one that is seen best."""

    def nearest(colour: Colour) -> float:
        return min((float(np.linalg.norm(np.array(colour) - one)) for one in behind), default=np.inf)

    return next((colour for colour in FORCE_COLOURS if nearest(colour) >= SEEN), max(FORCE_COLOURS, key=nearest))


def paint_axes(picture: Any, camera: PictureCamera, colours: Sequence[Colour], letters: float) -> None:
    """Paint the directions of x, y and z, as the camera sees them, into the lower left corner of a Pillow image."""
    height = picture.height
    origin = np.array([0.1 * height, 0.9 * height])
    right, above, backward = camera.axes
    # The one that points away is painted first.
    for axis in np.argsort(backward):
        direction = np.array([right[axis], -above[axis]])
        length = np.linalg.norm(direction)
        if length > 0.1:
            paint_arrow(picture, origin, origin + 0.065 * height * direction, AXIS_WIDTH * height, colours[axis])
        # An axis that points at the viewer, or away, has its name beside the origin.
        outward = direction / length if length > 0.3 else np.array([-0.7, 0.7])
        label = origin + (0.065 * length + 0.017) * height * outward
        paint_text(picture, (label[0], label[1]), "xyz"[axis], letters, colours[axis], "mm")


def paint_body_axes(
    picture: Any, camera: PictureCamera, axes: np.ndarray, radius: float, colours: Sequence[Colour]
) -> None:
    """Paint the axes of bodies into a Pillow image.

    Args:
        axes: origin [mm] and unit vectors along x, y and z of each body, shape (count, 4, 3).
    """
    origins = np.repeat(axes[:, 0], 3, axis=0)
    ends = origins + BODY_AXIS * radius * axes[:, 1:].reshape(-1, 3)
    _paint_arrows(picture, camera, origins, ends, AXIS_WIDTH, colours)


def _paint_arrows(
    picture: Any, camera: PictureCamera, tails: np.ndarray, tips: np.ndarray, width: float, colours: Sequence[Colour]
) -> None:
    """Paint arrows between points [mm], shape (count, 3), in turns of the colours, the farthest first."""
    tail_pixels, tail_distance = project(camera, tails, picture.size)
    tip_pixels, distance = project(camera, tips, picture.size)
    before_camera = np.minimum(distance, tail_distance) > 1.0
    long_enough = np.linalg.norm(tip_pixels - tail_pixels, axis=1) > 1.0
    for index in np.argsort(-distance):
        if before_camera[index] and long_enough[index]:
            colour = colours[index % len(colours)]
            paint_arrow(picture, tail_pixels[index], tip_pixels[index], width * picture.height, colour)


# All that is painted over a picture: arrows, axes, bars, caption, marks.

MARK_COLOUR: Colour = (0.84, 0.16, 0.36)
LETTERS = 1 / 36
"""Height of letters, in heights of the picture [-]."""
SCALE_BAR = 0.2
"""Greatest length of the bar that shows mm, in widths of the picture [-]."""
BAR_LENGTH, BAR_WIDTH = 0.25, 1.0
"""Length of a colour bar, in heights of the picture, and its width, in heights of its letters [-]."""
SINGLE_FIGURES = 4
"""The caption gives more pressures or tensions than these as a range."""
LONGEST_NAME = 36
"""Letters of a name in a legend; of longer ones begin and end are there."""
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
        self._section = SectionPlane.parse(style.section) if style.section else None
        self._ink = text_colour(style.background_colour)
        self._arrows: list[Arrows] = []
        if style.arrows:
            self._arrows.append(force_arrows(recording, instants, radius, behind, length))
        if style.displacement_arrows is not None:
            times = style.displacement_arrows
            self._arrows.append(displacement_arrows(recording, instants, radius, self._ink, times))
        self._axis_colours = ON_DARK if is_dark(style.background_colour) else AXIS_COLOURS
        self._radius = radius

    @property
    def arrow_tails(self) -> np.ndarray:
        """Where arrows begin [mm], shape (count, 3)."""
        return np.concatenate([np.zeros((0, 3)), *(arrows.tails for arrows in self._arrows)])

    def paint(self, picture: np.ndarray, camera: PictureCamera, instant: int, marks: np.ndarray) -> np.ndarray:
        """The picture of an instant with everything painted over it, marks too."""
        from PIL import Image

        image, letters = Image.fromarray(picture), letters_of(self._style)
        for arrows in self._arrows:
            arrows.paint(image, camera, instant, self._section)
        if self._style.body_axes:
            paint_body_axes(image, camera, self._recording.body_axes(instant), self._radius, self._axis_colours)
        paint_marks(image, camera, marks)
        if self._style.is_close_up:  # anything may be behind the text
            written = image.copy()
            self._write(written, camera, instant, letters)
            self._paint_glow(image, written, GLOW * letters)
        self._write(image, camera, instant, letters)
        return np.asarray(image)

    def _write(self, image: Any, camera: PictureCamera, instant: int, letters: float) -> None:
        for row, arrows in enumerate(arrows for arrows in self._arrows if arrows.length):
            arrows.paint_scale(image, camera, self._ink, letters, row)
        if self._style.scale_bar:
            paint_scale_bar(image, depth_of_scale(camera, self._section), self._ink, letters)
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


def paint_scale_bar(picture: Any, depth: float, ink: Colour, letters: float) -> None:
    """Paint a bar of a round length, as seen at a depth before the camera [mm], at the lower edge of an image."""
    scale = focal_length(picture.height) / depth
    length = round_down(SCALE_BAR * picture.width / scale)
    middle, bottom, half, thick = 0.5 * picture.width, 0.96 * picture.height, 0.5 * scale * length, 0.15 * letters
    corners = [(-half, -thick), (half, -thick), (half, thick), (-half, thick)]
    paint_polygon(picture, np.add(corners, [middle, bottom]), ink)
    paint_text(picture, (middle, bottom - 2.0 * thick), f"{length:g} mm", letters, ink, "ms")


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
    texts = [text for scale in scales for text in (*_title_lines(scale), *_labels(scale))]
    return max(font_of(text, letters).getlength(text) for text in texts) + 2.0 * letters if texts else 0.0


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
        # Of many names the letters are small, so that the bars below have their place.
        free = 0.97 * height - top - (len(scales) - 1) * (length + 4.5 * letters)
        small = min(letters, free / 1.5 / max(len(scale.names), 1))
        for name, step in zip(scale.names, scale.steps, strict=False):
            box = (round(left), round(top), round(left + letters), round(top + small))
            ImageDraw.Draw(picture).rectangle(box, as_bytes(step), as_bytes(ink), max(round(letters / 16), 1))
            paint_text(picture, (left + 1.5 * letters, top + 0.5 * small), _shortened(name), small, ink, "lm")
            top += 1.5 * small
        if scale.names:
            top += letters
            continue
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
    words, _, unit = scale.title.rpartition(" ")
    return [words, unit] if words else [unit]


def _labels(scale: ColourScale) -> list[str]:
    """What stands beside a bar or in a legend, with as much before it as its colours are wide."""
    return [f"mm {text}" for text in map(_shortened, scale.names or (scale.top,))]


def _shortened(name: str) -> str:
    return name if len(name) <= LONGEST_NAME else f"{name[: LONGEST_NAME - 11]}...{name[-8:]}"


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
        if lines and font_of(longer, letters).getlength(longer) <= picture.width - 2 * edge:
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
