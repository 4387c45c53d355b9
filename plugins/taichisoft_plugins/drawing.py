"""Drawing the frames of a recording."""

from collections.abc import Sequence

import numpy as np

from taichisoft_plugins.camera import Camera, scene_axes
from taichisoft_plugins.camera_path import camera_path
from taichisoft_plugins.caption import caption_parts, paint_caption
from taichisoft_plugins.colour_bars import ROOM, paint_bars
from taichisoft_plugins.colouring import PLAIN, Colouring
from taichisoft_plugins.corner_axes import paint_axes
from taichisoft_plugins.floor import Floor
from taichisoft_plugins.force_arrows import ForceArrows
from taichisoft_plugins.framing import outermost_points
from taichisoft_plugins.painting import text_colour
from taichisoft_plugins.recording_reader import RecordedSurface, Recording
from taichisoft_plugins.shading import shaded
from taichisoft_plugins.smooth_edges import smooth_edges
from taichisoft_plugins.smooth_normals import SmoothNormals
from taichisoft_plugins.stage import NOTHING, Stage
from taichisoft_plugins.style import Style, StyleError
from taichisoft_plugins.translucency import in_layers, laid_over
from taichisoft_plugins.visual_surface import with_visual_surfaces
from taichisoft_plugins.walls import is_floor, square_of_plane

HELD_BACK = {"soft": 0.55, "rigid": 1.0, "obstacle": 1.0}
"""How much of the light a kind of surface holds back [-]; silicone lets some through."""

HOLE = " as a hole"
"""What an opaque surface hides of a layer of translucent ones is left open in that layer."""


class Drawer:
    """Draws frames of a recording as its style says; a process can have only one.

    Args:
        recording: stays open as long as frames are drawn.
        style: what the user chose.
        frames: all frames that will be drawn, in order: the camera and the ranges of the colours suit them all.

    Raises:
        StyleError: the style does not fit the recording.
        MeshError: the style's surface file is missing or unreadable.
        RecordingError: something that the style wants drawn was not recorded.
    """

    def __init__(self, recording: Recording, style: Style, frames: Sequence[int]):
        check_style(recording, style)
        self._recording, self._style, up = recording, style, recording.up
        self._axes = scene_axes(up)
        self._surfaces = with_visual_surfaces(recording, style.surface)
        points = outermost_points(self._surfaces, frames)
        self._colouring = Colouring(recording, style, frames, self._surfaces)
        width, height = style.size
        side = ROOM * height if self._colouring.scales else 0.0
        aspect = max(width - 2 * side, width / 2) / height
        self._camera = camera_path(style, self._surfaces, frames, points, up, aspect)
        radius = float(np.linalg.norm(points - points.mean(axis=0), axis=1).max())
        self._arrows = ForceArrows(recording, frames, radius) if style.arrows else None
        self._normals = {surface.name: SmoothNormals(surface.triangles) for surface in self._surfaces}
        background = np.array(style.background_colour)
        self._empty = np.empty((height, width, 3), dtype=np.uint8)
        self._empty[:] = np.rint(255 * background)
        floors = [plane for plane in recording.planes if is_floor(plane, up)]
        self._floors = [
            Floor(plane, points, background) for plane in sorted(floors, key=lambda plane: plane.point @ up)
        ]
        self._stage = Stage(style.size)
        self._opaque = [surface.name for surface in self._surfaces if surface.kind != "soft"]
        for plane in recording.planes:
            if not is_floor(plane, up):
                square, triangles = square_of_plane(plane, points, floors)
                normals = np.tile(plane.normal, (len(square), 1))
                self._put(plane.name, square, triangles, shaded(np.array(PLAIN["obstacle"]), normals, self._axes))
                self._opaque.append(plane.name)

    def image(self, frame: int) -> np.ndarray:
        """The picture of one of the frames: red, green and blue, shape (height, width, 3), dtype uint8."""
        camera = self._camera(frame)
        vertices = {surface.name: surface.vertices(frame) for surface in self._surfaces}
        for surface in self._surfaces:
            self._put_surface(surface, vertices[surface.name], frame)
        throwers = [
            (vertices[surface.name], surface.triangles, HELD_BACK[surface.kind])
            for surface in self._surfaces
            if surface.kind in HELD_BACK
        ]
        picture = self._empty
        for floor in self._floors:
            picture = floor.paint(picture, camera, throwers)
        picture = smooth_edges(self._with_surfaces(picture, camera, vertices))
        return self._with_signs(picture, camera, frame)

    def _put_surface(self, surface: RecordedSurface, vertices: np.ndarray, frame: int) -> None:
        corners, normals = self._normals[surface.name](vertices)
        colours = self._colouring.colours(surface, frame)
        if colours.ndim == 2:
            colours = colours[surface.triangles.ravel()]
        triangles = np.arange(len(corners)).reshape(-1, 3)
        self._put(surface.name, corners, triangles, shaded(colours, normals, self._axes))

    def _put(self, name: str, vertices: np.ndarray, triangles: np.ndarray, colours: np.ndarray) -> None:
        self._stage.put(name, vertices, triangles, colours)
        if name in self._opaque:
            self._stage.put(name + HOLE, vertices, triangles, np.tile(np.array(NOTHING) / 255, (len(vertices), 1)))

    def _with_surfaces(self, picture: np.ndarray, camera: Camera, vertices: dict[str, np.ndarray]) -> np.ndarray:
        soft = [surface.name for surface in self._surfaces if surface.kind == "soft"]
        picture = laid_over(picture, self._stage.image(camera, self._opaque), 1.0)
        for layer in in_layers([vertices[name] for name in soft], camera, self._style.size):
            visible = [soft[body] for body in layer] + [name + HOLE for name in self._opaque]
            picture = laid_over(picture, self._stage.image(camera, visible), self._style.opacity)
        return picture

    def _with_signs(self, picture: np.ndarray, camera: Camera, frame: int) -> np.ndarray:
        from PIL import Image

        image, style, ink = Image.fromarray(picture), self._style, text_colour(self._style.background_colour)
        if self._arrows is not None:
            self._arrows.paint(image, camera, frame)
            self._arrows.paint_scale(image, camera, ink)
        if style.axes:
            paint_axes(image, camera)
        paint_bars(image, self._colouring.scales, ink)
        if style.caption:
            paint_caption(image, caption_parts(self._recording, frame), ink)
        return np.array(image)


def check_style(recording: Recording, style: Style) -> None:
    """See whether a style fits a recording, before anything is drawn.

    Raises:
        StyleError: it follows a body that is not there; says which there are.
    """
    names = [surface.name for surface in recording.surfaces if surface.kind in ("soft", "rigid")]
    if style.followed is not None and style.followed not in names:
        raise StyleError(f"view '{style.view}': no body is called '{style.followed}'; there are: {', '.join(names)}")
