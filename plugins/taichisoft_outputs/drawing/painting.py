"""What is painted into a finished picture: shaded polygons, text, arrows, cables, scales."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

import numpy as np

from taichisoft import Scene
from taichisoft.mechanics import ACTUATOR_KINDS, ActuatorKind
from taichisoft.mesh import SectionPlane
from taichisoft_outputs.drawing.camera import PictureCamera, project, radius_around_mean, scene_axes
from taichisoft_outputs.drawing.style import SMALLEST_LETTERS
from taichisoft_outputs.recording.bodies import RecordedSurface
from taichisoft_outputs.recording.reader import Recording

# Smooth normals of surfaces, and how bright a surface is where its normal points.
#
# There is a high key light, and light from all around, more of it from above.

KEY_LIGHT = (0.55, 0.75, 1.25)
"""Direction to the usual key light in the axes (right, front, up) of `camera.scene_axes`: in front, from the right."""

DARKEST, KEY_STRENGTH, SKY_STRENGTH = 0.44, 0.44, 0.12
"""Brightness of what is turned away, and what the two lights add at most; together 1 [-]."""


CREASE_ANGLE = 40.0
"""Faces that meet at a sharper angle [degrees] keep the edge between them."""


class SmoothNormals:
    """Gives every triangle corner a vertex and a normal of its own, as its surface deforms.

    The normal of a corner is the area-weighted mean of the triangles at its vertex that are turned by less than
    CREASE_ANGLE against its own triangle: curved faces are smooth, and edges stay sharp.
    """

    def __init__(self, triangles: np.ndarray):
        self._triangles = triangles
        # The pairs do not change while the surface deforms; finding them takes longer than all the rest.
        self._corners, others = corners_at_same_vertex(triangles.ravel())
        self._own, self._other = self._corners // 3, others // 3

    def __call__(self, vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Corners and normals for vertices [mm] of shape (vertex_count, 3).

        Returns:
            Corner positions [mm] and unit normals, each (3 * triangle_count, 3); corner 3 i + k is corner k of
            triangle i.
        """
        corners = vertices[self._triangles]
        areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        smooth = face_alike(areas, self._own, self._other)
        where, what = self._corners[smooth], areas[self._other[smooth]]
        normals = np.stack([np.bincount(where, part, self._triangles.size) for part in what.T], axis=1)
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        return corners.reshape(-1, 3), normals / np.maximum(lengths, 1e-30)


def split_creases(vertices: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Give a vertex on a crease one copy per smooth part of the surface around it.

    A surface that deforms is split once; copy i is then always where vertex `source[i]` is.

    Returns:
        `source`, vertex of each copy, shape (copy_count,), and triangles of copies, shape (triangle_count, 3).
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    corners = vertices[triangles]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    one, other = corners_at_same_vertex(triangles.ravel())
    smooth = face_alike(areas, one // 3, other // 3)
    joined = coo_matrix((np.ones(smooth.sum()), (one[smooth], other[smooth])), shape=(triangles.size, triangles.size))
    count, copy = connected_components(joined, directed=False)
    source = np.empty(count, dtype=np.int64)
    source[copy] = triangles.ravel()
    return source, copy.reshape(-1, 3)


def face_alike(areas: np.ndarray, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Whether triangles `one` and `other`, shape (count,), are turned against each other by less than CREASE_ANGLE.

    Args:
        areas: a vector along the normal of each triangle, of any length, shape (triangle_count, 3).
    """
    units = areas / np.maximum(np.linalg.norm(areas, axis=1, keepdims=True), 1e-30)
    return np.einsum("ij,ij->i", units[one], units[other]) > np.cos(np.radians(CREASE_ANGLE))


def corners_at_same_vertex(vertex_of_corner: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """All ordered pairs of corners that share a vertex, each corner with itself too."""
    order = np.argsort(vertex_of_corner, kind="stable")
    _, start, count = np.unique(vertex_of_corner[order], return_index=True, return_counts=True)
    size = np.repeat(count, count)  # per sorted corner: how many corners its vertex has
    first = np.repeat(np.arange(len(order)), size)
    step = np.arange(len(first)) - np.repeat(np.cumsum(size) - size, size)
    second = np.repeat(np.repeat(start, count), size) + step
    return order[first], order[second]


def key_light(scene: Scene) -> np.ndarray:
    """Unit vector to the key light of a scene, shape (3,)."""
    chosen = scene.appearance.light
    key = np.array(KEY_LIGHT) @ scene_axes(scene.up) if chosen is None else np.array(chosen)
    return key / np.linalg.norm(key)


def shade(colours: np.ndarray, normals: np.ndarray, key: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Colours as they appear in the light, shape (count, 3)."""
    # Half of the light reaches around what it falls on, so that no side that is turned away looks flat.
    from_key = (0.5 + 0.5 * normals @ key) ** 1.5
    from_sky = 0.5 + 0.5 * normals @ up
    return colours * (DARKEST + KEY_STRENGTH * from_key + SKY_STRENGTH * from_sky)[:, None]


# Cables, and other actuators drawn as lines, as thin tubes with a bead at each point through which they run.

THICKNESS = 0.01
"""Radius of a tube, in radii of the soft bodies [-]: cables are drawn thicker than they are, so that they are seen."""
BEAD = 2.0
"""Radius of a bead, in radii of the tube [-]."""
SIDES = 10
"""Faces around a tube: few enough to draw fast, and enough that they meet at angles that are shaded smoothly."""

_TURN = 2.0 * np.pi * np.arange(SIDES) / SIDES
_RING = np.stack([np.cos(_TURN), np.sin(_TURN)], axis=1)


@dataclass(frozen=True)
class LineTube(RecordedSurface):
    """A tube around a line.

    Attributes:
        actuator: the kind of the actuator.
        number: its number among its kind.
        segment: the part of the line between two points that each vertex belongs to, shape (vertex_count,).
    """

    actuator: str = ""
    number: int = 0
    segment: np.ndarray | None = None

    def at_vertices(self, values: np.ndarray) -> np.ndarray:
        """Values at the vertices, shape (vertex_count,), of values of the parts between points, (point_count - 1,)."""
        return values[self.segment]


def line_tubes(recording: Recording, first_frame: int) -> list[LineTube]:
    """A tube for each cable and other line of a recording.

    Args:
        first_frame: the instant in which the bodies have the size that the thickness suits.
    """
    lines = [(kind, line) for kind in ACTUATOR_KINDS for line in recording.lines(kind)]
    if not lines:
        return []
    soft = [surface.vertices(first_frame) for surface in recording.surfaces if surface.kind == "soft"]
    radius = THICKNESS * radius_around_mean(np.concatenate(soft))
    return [
        LineTube(
            # No body or cavity has this name, as a line's own might be.
            name=f"{line.name}|{kind.name}",
            kind="line",
            triangles=tube_triangles(len(line.owner)),
            vertices=_around(partial(recording.points_of_line, line), radius),
            actuator=kind.name,
            number=line.number,
            segment=_segments(len(line.owner)),
        )
        for kind, line in lines
    ]


def tube_vertices(points: np.ndarray, radius: float) -> np.ndarray:
    """Vertices of a tube with beads around a polyline [mm], shape (vertex_count, 3)."""
    along = np.diff(points, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-30)
    # Any direction across: faces are too many and too small for anybody to see where the first of them is.
    aside = np.cross(along, np.eye(3)[np.abs(along).argmin(axis=1)])
    aside /= np.maximum(np.linalg.norm(aside, axis=1, keepdims=True), 1e-30)
    across = np.stack([aside, np.cross(along, aside)], axis=1)
    rings = radius * np.einsum("sk,pkd->psd", _RING, across)
    ends = np.stack([points[:-1], points[1:]], axis=1)
    tubes = ends[:, :, None] + rings[:, None]
    beads = points[:, None] + BEAD * radius * _BALL
    return np.concatenate([tubes.reshape(-1, 3), beads.reshape(-1, 3)])


def tube_triangles(point_count: int) -> np.ndarray:
    """Vertex indices of the outward triangles of `tube_vertices`, shape (triangle_count, 3)."""
    segments = 2 * SIDES * np.arange(point_count - 1)
    beads = 2 * SIDES * (point_count - 1) + len(_BALL) * np.arange(point_count)
    return np.concatenate([_repeated(_band(0, SIDES), segments), _repeated(_BALL_TRIANGLES, beads)])


def _around(points: Callable[[int], np.ndarray], radius: float) -> Callable[[int], np.ndarray]:
    return lambda instant: tube_vertices(points(instant), radius)


def _segments(point_count: int) -> np.ndarray:
    """The segment of each vertex of `tube_vertices`; that of a bead is the one that ends there."""
    of_tubes = np.repeat(np.arange(point_count - 1), 2 * SIDES)
    of_beads = np.repeat(np.maximum(np.arange(point_count) - 1, 0), len(_BALL))
    return np.concatenate([of_tubes, of_beads])


def _repeated(triangles: np.ndarray, starts: Iterable[int]) -> np.ndarray:
    return np.concatenate([triangles + start for start in starts])


def _band(first: int, second: int) -> np.ndarray:
    """Triangles between two rings of SIDES vertices that begin at these indices, outward from the axis."""
    here = np.arange(SIDES)
    after = (here + 1) % SIDES
    lower = np.stack([first + here, first + after, second + after], axis=1)
    upper = np.stack([first + here, second + after, second + here], axis=1)
    return np.concatenate([lower, upper])


def _unit_ball() -> tuple[np.ndarray, np.ndarray]:
    """Vertices and outward triangles of a ball of radius 1."""
    tilts = np.linspace(np.pi, 0.0, SIDES // 2 + 1)  # the poles are rings, too, whose vertices are at one place
    rings = [np.column_stack([np.sin(tilt) * _RING, np.full(SIDES, np.cos(tilt))]) for tilt in tilts]
    bands = [_band(SIDES * ring, SIDES * (ring + 1)) for ring in range(len(tilts) - 1)]
    bands[0], bands[-1] = bands[0][SIDES:], bands[-1][:SIDES]  # the other triangles there have no area
    return np.concatenate(rings), np.concatenate(bands)


_BALL, _BALL_TRIANGLES = _unit_ball()


# Scales that hold for all instants that are drawn: colours for numbers, round ends, instants to look at.

SOFT = ((0.93, 0.92, 0.88), (0.98, 0.82, 0.42), (0.93, 0.46, 0.24), (0.70, 0.13, 0.30), (0.33, 0.06, 0.32))
"""Colours from silicone's own over yellow and red to violet: brightness falls all the way."""

AIR = ((0.60, 0.70, 0.72), (0.24, 0.66, 0.62), (0.02, 0.50, 0.38), (0.00, 0.27, 0.22))
"""Colours from grey to dark green: none of them is among the colours of the silicone around the air."""

LINE = ((0.42, 0.43, 0.46), (0.62, 0.25, 0.55), (0.72, 0.02, 0.50), (0.36, 0.00, 0.32))
"""Colours from grey over magenta to purple, which neither silicone nor air has."""


STEPS = (1.0, 1.2, 1.5, 1.8, 2.0, 2.5, 3.0, 3.5, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0)


@dataclass(frozen=True)
class ColourScale:
    """Colours that run linearly from the lowest to the highest value.

    Attributes:
        title: what the values are, with their unit.
        low, high: values of the first and the last colour; `low` < `high`.
        steps: red, green and blue [-] of evenly spaced values.
        highest: the highest value that is shown; above `high` it has the colour of that, and the bar says so.
    """

    title: str
    low: float
    high: float
    steps: Sequence[tuple[float, float, float]]
    highest: float = -np.inf

    @property
    def stops(self) -> np.ndarray:
        """The values between which colours run linearly, shape (step_count,)."""
        return np.linspace(self.low, self.high, len(self.steps))

    @property
    def top(self) -> str:
        """The number at the high end, and the highest value where its colour stands for all up to that."""
        return f"{self.high:g}" + (f" to {self.highest:.3g}" if self.highest > self.high * (1 + 1e-9) else "")

    def colours(self, values: np.ndarray) -> np.ndarray:
        """Red, green and blue [-], shape (count, 3), of values (count,); values outside get the colour of the end."""
        return np.stack([np.interp(values, self.stops, part) for part in np.array(self.steps).T], axis=1)


def round_up(value: float) -> float:
    """The next of STEPS times a power of ten, for the high end of a scale: no more than a quarter above the value."""
    power = 10.0 ** np.floor(np.log10(value))
    step = next(step for step in STEPS if value <= step * power * (1 + 1e-9))
    return float(f"{step * power:.6g}")  # the decimal number, not 0.7000000000000001


def scale_of(title: str, values: np.ndarray, steps: Sequence[tuple[float, float, float]]) -> ColourScale | None:
    """A scale from the lowest to the highest of the values, and zero, with round ends; None where all are zero."""
    lowest, highest = np.min(values, initial=0.0), np.max(values, initial=0.0)
    if highest == lowest:
        return None
    ends = [round_up(abs(end)) * np.sign(end) if end else 0.0 for end in (lowest, highest)]
    return ColourScale(title, float(ends[0]), float(ends[1]), steps)


def effort_scale(kind: ActuatorKind, values: np.ndarray) -> ColourScale | None:
    """A scale for efforts of a kind of actuators, such as pressures."""
    return scale_of(f"{kind.effort.words} [{kind.effort.unit}]", values, AIR if kind.drawn == "walls" else LINE)


def round_down(value: float) -> float:
    """The last of 1, 2, 5 and 10 times a power of ten, for a value that a scale shows."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(step for step in (1.0, 2.0, 5.0) if step * power <= value * (1 + 1e-9)))


def sample_instants(instants: Sequence[int], count: int) -> list[int]:
    """At most `count` of the instants, evenly spaced from the first to the last."""
    return [instants[index] for index in np.unique(np.linspace(0, len(instants) - 1, count).astype(int))]


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


@cache
def font(height: float) -> Any:
    """The font of all text, its letters about `height` [pixels] high; reading it takes longer than writing with it."""
    from PIL import ImageFont

    return ImageFont.load_default(size=max(height, SMALLEST_LETTERS))


def paint_text(picture: Any, place: tuple[float, float], text: str, height: float, colour: Colour, anchor: str) -> None:
    """Write text into a picture.

    Args:
        anchor: Pillow's two letters for the anchor: "la" left and top, "mm" the middle, "ls" left on the line.
    """
    from PIL import ImageDraw

    ImageDraw.Draw(picture).text(place, text, font=font(height), fill=as_bytes(colour), anchor=anchor)


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
SAMPLES = 200
"""Number of instants, at most, in which the strongest force is looked for."""
FORCE_WIDTH, AXIS_WIDTH = 1 / 220, 1 / 180
"""Width of an arrow's shaft, in heights of the picture [-]."""

AXIS_COLOURS: tuple[Colour, ...] = ((0.80, 0.16, 0.16), (0.13, 0.55, 0.20), (0.16, 0.32, 0.80))
"""Red, green and blue of the axes x, y and z [-]."""
ON_DARK: tuple[Colour, ...] = ((0.95, 0.35, 0.30), (0.35, 0.78, 0.40), (0.42, 0.58, 1.00))
"""The same on a dark background."""
BODY_AXIS = 0.25
"""Length of the arrows at bodies, in radii of the scene [-]."""


class ForceArrows:
    """Arrows of contact forces, of one scale over all instants: twice the force is twice the length.

    Args:
        behind: red, green and blue [-] of what may be behind the arrows.
        length: length of the arrows [mm/mN]; that which suits the strongest force when it is not given.

    Attributes:
        length: length of the arrows [mm/mN]; 0 where no force is shown.
        tails: where arrows begin [mm], shape (count, 3), for a camera that is to see them whole.
    """

    def __init__(
        self,
        recording: Recording,
        instants: Sequence[int],
        radius: float,
        behind: Sequence[np.ndarray] = (),
        length: float | None = None,
    ):
        self._recording = recording
        self._colour = arrow_colour(behind)
        contacts = [recording.contacts(instant) for instant in sample_instants(instants, SAMPLES)]
        self._strongest = max((float(np.linalg.norm(f, axis=1).max(initial=0.0)) for _, f in contacts), default=0.0)
        own = LONGEST * radius / self._strongest if self._strongest else 0.0
        self.length = own if length is None else length
        self.tails = np.concatenate([np.zeros((0, 3)), *(point - self.length * force for point, force in contacts)])

    def paint(self, picture: Any, camera: PictureCamera, instant: int, section: SectionPlane | None) -> None:
        """Paint an instant's arrows, which end where the forces act, into a Pillow image; none that is cut off."""
        if self._strongest:
            points, forces = self._recording.contacts(instant)
            if section is not None:
                kept = section.facing(camera.eye).height(points) <= 0.0
                points, forces = points[kept], forces[kept]
            _paint_arrows(picture, camera, points - self.length * forces, points, FORCE_WIDTH, [self._colour])

    def paint_scale(self, picture: Any, camera: PictureCamera, ink: Colour, letters: float) -> None:
        """Paint an arrow of a round force in the lower right corner, as long as it is in the middle of the scene."""
        if not self._strongest:
            return
        force = round_down(self._strongest)
        apart = camera.target + self.length * force * camera.axes[0]
        pixels, _ = project(camera, np.array([camera.target, apart]), picture.size)
        height = picture.height
        tip = np.array([picture.width - 0.03 * height, height - 0.04 * height])
        paint_arrow(picture, tip - [pixels[1, 0] - pixels[0, 0], 0], tip, FORCE_WIDTH * height, self._colour)
        paint_text(picture, (tip[0], tip[1] - 0.02 * height), f"force {force:g} mN", letters, ink, "rs")


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
