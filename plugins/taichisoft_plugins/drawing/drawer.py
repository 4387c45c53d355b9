"""Drawing the frames of a recording."""

from collections.abc import Sequence

import numpy as np

from taichisoft.bodies.surfaces import Plane
from taichisoft_plugins.drawing.camera import scene_axes
from taichisoft_plugins.drawing.camera_path import camera_path
from taichisoft_plugins.drawing.colour_bars import ROOM
from taichisoft_plugins.drawing.colouring import PLAIN, Colouring
from taichisoft_plugins.drawing.floor import Floor
from taichisoft_plugins.drawing.framing import outermost_points
from taichisoft_plugins.drawing.signs import Signs
from taichisoft_plugins.drawing.smooth_edges import smooth_edges
from taichisoft_plugins.drawing.style import Style, StyleError
from taichisoft_plugins.drawing.surface_painter import SurfacePainter
from taichisoft_plugins.drawing.visual_surface import with_visual_surfaces
from taichisoft_plugins.drawing.walls import is_floor, reaches_under, square_of_plane
from taichisoft_plugins.recording.reader import Recording

HELD_BACK = {"soft": 0.55, "rigid": 1.0, "obstacle": 1.0}
"""How much of the light a kind of surface holds back [-]; silicone lets some through."""


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
        width, height = style.size
        up = recording.scene.up
        self._surfaces = with_visual_surfaces(recording, style.surface)
        points = outermost_points(self._surfaces, frames)
        radius = float(np.linalg.norm(points - points.mean(axis=0), axis=1).max())
        self._colouring = Colouring(recording, style, frames, self._surfaces)
        self._signs = Signs(recording, style, frames, self._colouring.scales, radius)
        side = ROOM * height if self._colouring.scales else 0.0
        aspect = max(width - 2 * side, width / 2) / height
        self._camera = camera_path(style, self._surfaces, frames, points, up, aspect)
        background = np.array(style.background_colour)
        self._background = np.empty((height, width, 3), dtype=np.uint8)
        self._background[:] = np.rint(255 * background)
        # Of several floors only the highest can be seen: they are infinite.
        floors = sorted(
            (plane for plane in recording.planes if is_floor(plane, up)), key=lambda plane: plane.point @ up
        )
        self._floor = Floor(floors[-1], points, background) if floors else None
        self._walls = [
            (plane.name, *square_of_plane(plane, points, floors))
            for plane in recording.planes
            if not is_floor(plane, up)
        ]
        triangles = {surface.name: surface.triangles for surface in self._surfaces}
        triangles |= {name: of_wall for name, _, of_wall in self._walls}
        soft = [surface.name for surface in self._surfaces if surface.kind == "soft"]
        self._painter = SurfacePainter(style.size, triangles, soft, style.opacity, scene_axes(up))
        self._hide_what_is_under(floors[-1:], points)

    def image(self, frame: int) -> np.ndarray:
        """The picture of one of the frames: red, green and blue, shape (height, width, 3), dtype uint8."""
        camera = self._camera(frame)
        vertices = {surface.name: surface.vertices(frame) for surface in self._surfaces}
        picture = self._background
        if self._floor is not None:
            throwers = [
                (vertices[surface.name], surface.triangles, HELD_BACK[surface.kind])
                for surface in self._surfaces
                if surface.kind in HELD_BACK
            ]
            picture = self._floor.paint(picture, camera, throwers)
        colours = {surface.name: self._colouring.colours(surface, frame) for surface in self._surfaces}
        for name, corners, _ in self._walls:
            vertices[name], colours[name] = corners, np.array(PLAIN["obstacle"])
        picture = self._painter.paint(picture, camera, vertices, colours)
        return self._signs.paint(smooth_edges(picture), camera, frame)

    def _hide_what_is_under(self, floors: Sequence[Plane], points: np.ndarray) -> None:
        """The floor is painted behind everything, so what reaches under it must be cut off; mostly nothing does."""
        for floor in floors:
            obstacles = [surface.vertices(0) for surface in self._surfaces if surface.kind == "obstacle"]
            if any(reaches_under(floor, vertices) for vertices in obstacles):
                self._painter.hide_behind(floor.name, *square_of_plane(floor, points, [], half=20.0))


def check_style(recording: Recording, style: Style) -> None:
    """See whether a style fits a recording, before anything is drawn.

    Raises:
        StyleError: it follows a body that is not there; says which there are.
    """
    names = [surface.name for surface in recording.surfaces if surface.kind in ("soft", "rigid")]
    if style.followed is not None and style.followed not in names:
        raise StyleError(f"view '{style.view}': no body is called '{style.followed}'; there are: {', '.join(names)}")
