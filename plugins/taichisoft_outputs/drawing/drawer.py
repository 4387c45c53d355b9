"""Drawing the instants of a recording."""

from collections.abc import Sequence

import numpy as np

from taichisoft.mechanics import Plane
from taichisoft.mesh import SectionPlane
from taichisoft_outputs.drawing.camera import (
    PictureCamera,
    camera_path,
    focal_length,
    followed_part,
    outermost_points,
    seen_radius,
)
from taichisoft_outputs.drawing.colouring import (
    PLAIN,
    Colouring,
    body_colours,
    line_tubes,
    with_visual_surfaces,
)
from taichisoft_outputs.drawing.overlay import Overlay, colour_bars_width, letters_of
from taichisoft_outputs.drawing.stage import Floor, is_floor, reaches_under, square_of_plane
from taichisoft_outputs.drawing.style import Style
from taichisoft_outputs.drawing.surface_painter import SurfacePainter, cut_open, key_light, refuse_what_cuts_nothing
from taichisoft_outputs.recording.reader import Recording

# Smoothing of stair-stepped edges in a finished picture.
#
# The idea is that of fast approximate antialiasing (FXAA): along an edge between two rows of pixels the steps of a
# slanted line lie far apart; the nearer a pixel is to such a step, the more of the other row's colour it gets.

CONTRAST = np.uint8(12)
"""Difference of brightness among neighbours, of 255, from which a pixel lies at an edge."""
RELATIVE_SHIFT = np.uint8(3)
"""Bits by which the brightest neighbour is shifted for the least difference relative to it; bytes are quick."""
REACH = 14
"""How far along an edge its ends are looked for [pixels]."""


def antialias(image: np.ndarray) -> np.ndarray:
    """The image, shape (height, width, 3), dtype uint8, with smooth edges."""
    from PIL import Image

    height, width, _ = image.shape
    bright = np.asarray(Image.fromarray(image).convert("L"))
    inner = bright[1:-1, 1:-1]
    around = (bright[:-2, 1:-1], bright[2:, 1:-1], bright[1:-1, :-2], bright[1:-1, 2:])
    low, high = inner.copy(), inner.copy()
    for neighbour in around:
        np.minimum(low, neighbour, out=low)
        np.maximum(high, neighbour, out=high)
    rows, columns = np.nonzero(high - low > np.maximum(high >> RELATIVE_SHIFT, CONTRAST))
    if not len(rows):
        return image
    pixel = (rows + 1) * width + columns + 1
    flat = bright.ravel().astype(np.int32)
    across, along = _directions(flat, pixel, width)
    other, share = _shares(flat, pixel, across, along, height * width)
    smooth = image.reshape(-1, 3).copy()
    own, foreign = smooth[pixel].astype(np.float32), smooth[other].astype(np.float32)
    smooth[pixel] = np.rint(own + share[:, None] * (foreign - own)).astype(np.uint8)
    return smooth.reshape(image.shape)


def _directions(flat: np.ndarray, pixel: np.ndarray, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Steps (differences of flat indices) across the edge at each pixel, to its other side, and along it."""
    near = {(row, column): flat[pixel + row * width + column] for row in (-1, 0, 1) for column in (-1, 0, 1)}

    def curvature(line: Sequence[tuple[int, int]]) -> np.ndarray:
        before, middle, after = (near[place] for place in line)
        return np.abs(before + after - 2 * middle)

    vertical = [curvature([(-1, column), (0, column), (1, column)]) for column in (-1, 0, 1)]
    horizontal = [curvature([(row, -1), (row, 0), (row, 1)]) for row in (-1, 0, 1)]
    level = vertical[0] + 2 * vertical[1] + vertical[2] >= horizontal[0] + 2 * horizontal[1] + horizontal[2]
    before, after = np.where(level, near[-1, 0], near[0, -1]), np.where(level, near[1, 0], near[0, 1])
    side = np.where(np.abs(before - near[0, 0]) >= np.abs(after - near[0, 0]), -1, 1)
    return side * np.where(level, width, 1), np.where(level, 1, width)


def _shares(
    flat: np.ndarray, pixel: np.ndarray, across: np.ndarray, along: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """The pixel on the other side of each edge, and its share of the colour [-]."""
    other = pixel + across
    sum_here = flat[pixel] + flat[other]
    threshold = np.abs(flat[other] - flat[pixel]) / 2  # of the sum of both sides: a quarter of the step for their mean
    distance, end = [], []
    for sign in (-1, 1):
        far = np.full(len(pixel), float(REACH))
        difference = np.zeros(len(pixel), dtype=np.int32)
        walking = np.arange(len(pixel))
        for step in range(1, REACH + 1):
            offset = sign * step * along[walking]
            here = np.clip(pixel[walking] + offset, 0, count - 1)
            beyond = np.clip(other[walking] + offset, 0, count - 1)
            change = flat[here] + flat[beyond] - sum_here[walking]
            difference[walking] = change
            ended = np.abs(change) >= threshold[walking]
            far[walking[ended]] = step
            walking = walking[~ended]
            if not len(walking):
                break
        distance.append(far)
        end.append(difference)
    nearer = distance[0] <= distance[1]
    near = np.where(nearer, distance[0], distance[1])
    change = np.where(nearer, end[0], end[1])
    # Only where the edge turns to the other side's colour does this pixel lie on the bulging side of the step.
    towards = (change > 0) == (flat[other] > flat[pixel])
    share = np.where(towards & (change != 0), 0.5 - near / (distance[0] + distance[1]), 0.0)
    return other, np.clip(share, 0.0, 0.5)


def without_background(on_black: np.ndarray, on_white: np.ndarray) -> np.ndarray:
    """What both show of the same things, as red, green, blue and opacity, shape (height, width, 4), dtype uint8."""
    through = (on_white.astype(np.float32) - on_black).clip(0.0, 255.0).max(axis=2, keepdims=True)
    opacity = 255.0 - through
    colours = np.minimum(255.0 * on_black / np.maximum(opacity, 1.0), 255.0)
    return np.rint(np.concatenate([colours, opacity], axis=2)).astype(np.uint8)


SHADOW_OPACITY = {"soft": 0.55, "rigid": 1.0, "obstacle": 1.0}
"""Part of the light that a kind of surface takes from what is behind it [-]; silicone lets some through."""

NO_POINTS = np.zeros((0, 3))


class Drawer:
    """Draws instants of a recording as its style says; a process can have only one.

    Args:
        instants: all instants that will be drawn, in order: the camera and the ranges of the colours suit them all.
        room: space around what these instants show, in parts of its extent [-], for others that are not known yet.
    """

    def __init__(self, recording: Recording, style: Style, instants: Sequence[int], room: float = 0.0):
        style.check(recording.scene)
        plain_floor = style.background is not None or style.transparent
        style = style.for_scene(recording.scene)
        width, height = style.size
        up = recording.scene.up
        self._scene, self._planes = recording.scene, recording.planes
        self._surfaces = [*with_visual_surfaces(recording, style.surface), *line_tubes(recording, instants[0])]
        if style.colour_by != "none":  # a sheet would hide the colours of what it lies on
            self._surfaces = [surface for surface in self._surfaces if surface.kind != "membrane"]
        points = outermost_points(self._surfaces, instants)
        self._section = SectionPlane.parse(style.section) if style.section else None
        if style.section and not room:
            obstacles = [surface.vertices(instants[0]) for surface in self._surfaces if surface.kind == "obstacle"]
            refuse_what_cuts_nothing(style.section, np.concatenate([points, *obstacles]))
        self._colouring = Colouring(recording, style, instants, self._surfaces)
        followed = followed_part(recording, self._surfaces, style.followed) if style.followed is not None else None
        radius = seen_radius(style, points, followed)
        self._overlay = Overlay(recording, style, instants, self._colouring.scales, radius)
        side = colour_bars_width(self._colouring.scales, letters_of(style)) if style.bars else 0.0
        aspect = max(width - 2 * side, width / 2) / height
        spread = np.concatenate([points + room * (points - points.mean(axis=0)), self._overlay.arrow_tails])
        self._camera = camera_path(style, instants, spread, up, aspect, followed, recording.times)
        # Of several floors only the highest can be seen: they are infinite.
        floors = sorted(
            (plane for plane in recording.planes if is_floor(plane, up)), key=lambda plane: plane.point @ up
        )
        own = body_colours(recording.scene)
        light, self._shadows = recording.scene.appearance.light, recording.scene.appearance.shadows
        self._backdrops: list[tuple[np.ndarray, Floor | None]] = []
        for colour in ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)) if style.transparent else (style.background_colour,):
            background, floor = np.array(colour), None
            if floors:
                of_floor = None if style.transparent else own.get(floors[-1].name)
                if of_floor is None and plain_floor:
                    of_floor = background
                floor = Floor(floors[-1], points, background, of_floor, light)
            self._backdrops.append((np.full((height, width, 3), np.rint(255 * background), np.uint8), floor))
        self._walls = [
            (plane.name, *square_of_plane(plane, points, floors))
            for plane in recording.planes
            if not is_floor(plane, up)
        ]
        self._wall_colours = {name: own.get(name, np.array(PLAIN["obstacle"])) for name, _, _ in self._walls}
        triangles = {surface.name: surface.triangles for surface in self._surfaces}
        triangles |= {name: of_wall for name, _, of_wall in self._walls}
        soft, within = (
            [surface.name for surface in self._surfaces if surface.kind in kinds]
            for kinds in (("soft",), ("cavity", "line"))
        )
        light_from = key_light(recording.scene)
        unlit, scale = self._colouring.unlit, self._colouring.values_scale
        self._painter = SurfacePainter(
            style.size, triangles, soft, style.soft_opacity, light_from, up, unlit, within, scale
        )
        self._recording = recording
        if floors:
            self._hide_what_is_under(floors[-1], points)

    def measure(self, instant: int, camera: PictureCamera) -> tuple[np.ndarray, np.ndarray]:
        """Depth [mm] and number of the body that each pixel of a camera sees, see `SurfacePainter.measure`.

        Bodies are numbered as in the model: soft ones, rigid ones, obstacles; a plane is seen from its upper side.
        """
        scene, planes = self._scene, self._planes
        names = [*scene.soft_bodies, *scene.rigid_bodies, *scene.obstacles]
        solid = {s.name: s for s in self._surfaces if s.kind in SHADOW_OPACITY and s.name in names}
        vertices = {name: surface.vertices(instant) for name, surface in solid.items()}
        depth, number = self._painter.measure(camera, vertices, {name: names.index(name) for name in solid})
        right, up, backward = camera.axes
        height, width = depth.shape
        x, y = np.meshgrid(np.arange(width) + 0.5 - width / 2, np.arange(height) + 0.5 - height / 2)
        ahead = (x[..., None] * right - y[..., None] * up) / focal_length(height) - backward
        for plane in planes:
            towards = ahead @ plane.normal
            with np.errstate(divide="ignore"):
                distance = np.where(towards < 0.0, (plane.point - camera.eye) @ plane.normal / towards, np.inf)
            is_seen = (distance > 0.0) & (distance < depth)
            depth = np.where(is_seen, distance, depth).astype(np.float32)
            number = np.where(is_seen, names.index(plane.name), number)
        return depth, number

    def image(self, instant: int, marks: np.ndarray = NO_POINTS, camera: PictureCamera | None = None) -> np.ndarray:
        """The picture of one of the instants, with marks at points [mm]; shape (height, width, 3), dtype uint8.

        A transparent one has the opacity as a fourth number. `camera` replaces that of the style.
        """
        camera = self._camera(instant) if camera is None else camera
        pictures = [self._over(backdrop, floor, instant, marks, camera) for backdrop, floor in self._backdrops]
        return pictures[0] if len(pictures) == 1 else without_background(*pictures)

    def _over(
        self, picture: np.ndarray, floor: Floor | None, instant: int, marks: np.ndarray, camera: PictureCamera
    ) -> np.ndarray:
        vertices = {surface.name: surface.vertices(instant) for surface in self._surfaces}
        plane = self._section.facing(camera.eye) if self._section is not None else None
        if floor is not None:
            casters = []
            for surface in self._surfaces:
                if self._shadows and surface.kind in SHADOW_OPACITY:
                    at, triangles = vertices[surface.name], surface.triangles
                    if plane is not None:
                        triangles = triangles[plane.height(at[triangles].mean(axis=1)) <= 0.0]
                    casters.append((at, triangles, SHADOW_OPACITY[surface.kind]))
            picture = floor.paint(picture, camera, casters)
        colours, values = self._colouring.colours(instant), self._colouring.values(instant)
        for surface in self._surfaces:
            if values is not None and surface.kind == "soft":
                colours[surface.name] = self._colouring.at_corners(surface, values)[:, None]
        for name, corners, _ in self._walls:
            vertices[name], colours[name] = corners, self._wall_colours[name]
        section = None
        if plane is not None:
            section = cut_open(self._recording, self._surfaces, instant, plane, values)
        picture = self._painter.paint(picture, camera, vertices, colours, section)
        return self._overlay.paint(antialias(picture), camera, instant, marks)

    def _hide_what_is_under(self, floor: Plane, points: np.ndarray) -> None:
        """Cut off what reaches under a floor, which is painted behind everything; mostly nothing does."""
        obstacles = [surface.vertices(0) for surface in self._surfaces if surface.kind == "obstacle"]
        if any(reaches_under(floor, vertices) for vertices in obstacles):
            self._painter.hide_behind(floor.name, *square_of_plane(floor, points, [], half=20.0))
