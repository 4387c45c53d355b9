"""Drawing the frames of a recording."""

from collections.abc import Sequence

import numpy as np

from taichisoft_plugins.camera import fit_camera, scene_axes
from taichisoft_plugins.floor import Floor
from taichisoft_plugins.recording_reader import RecordedSurface, Recording
from taichisoft_plugins.shading import shaded
from taichisoft_plugins.smooth_edges import smooth_edges
from taichisoft_plugins.smooth_normals import SmoothNormals
from taichisoft_plugins.stage import NOTHING, Stage
from taichisoft_plugins.style import Style
from taichisoft_plugins.translucency import in_layers, laid_over

COLOURS = {
    "soft": (0.96, 0.93, 0.88),
    "cavity": (0.10, 0.52, 0.55),
    "rigid": (0.16, 0.33, 0.72),
    "obstacle": (0.62, 0.65, 0.69),
}
"""Red, green and blue [-] by the kind of surface."""

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
    """

    def __init__(self, recording: Recording, style: Style, frames: Sequence[int]):
        self._recording = recording
        self._style = style
        self._axes = scene_axes(recording.up)
        points = np.concatenate(
            [s.vertices(frame) for s in recording.surfaces if s.kind in ("soft", "rigid") for frame in frames]
        )
        self._camera = fit_camera(points, recording.up, style.view, style.size[0] / style.size[1])
        self._normals = {surface.name: SmoothNormals(surface.triangles) for surface in recording.surfaces}
        background = np.array(style.background)
        self._empty = np.empty((style.size[1], style.size[0], 3), dtype=np.uint8)
        self._empty[:] = np.rint(255 * background)
        self._floors = [Floor(plane, points, background) for plane in recording.planes]
        self._stage = Stage(style.size)

    def image(self, frame: int) -> np.ndarray:
        """The picture of one of the frames: red, green and blue, shape (height, width, 3), dtype uint8."""
        surfaces = self._recording.surfaces
        vertices = {surface.name: surface.vertices(frame) for surface in surfaces}
        for surface in surfaces:
            self._put(surface, vertices[surface.name])
        throwers = [
            (vertices[surface.name], surface.triangles, HELD_BACK[surface.kind])
            for surface in surfaces
            if surface.kind in HELD_BACK
        ]
        picture = self._empty
        for floor in self._floors:
            picture = floor.paint(picture, self._camera, throwers)
        return smooth_edges(self._with_surfaces(picture, vertices))

    def _put(self, surface: RecordedSurface, vertices: np.ndarray) -> None:
        corners, normals = self._normals[surface.name](vertices)
        triangles = np.arange(len(corners)).reshape(-1, 3)
        colours = shaded(np.array(COLOURS[surface.kind]), normals, self._axes)
        self._stage.put(surface.name, corners, triangles, colours)
        if surface.kind != "soft":
            self._stage.put(surface.name + HOLE, corners, triangles, np.zeros_like(colours) + np.array(NOTHING) / 255)

    def _with_surfaces(self, picture: np.ndarray, vertices: dict[str, np.ndarray]) -> np.ndarray:
        soft = [surface.name for surface in self._recording.surfaces if surface.kind == "soft"]
        opaque = [surface.name for surface in self._recording.surfaces if surface.kind != "soft"]
        picture = laid_over(picture, self._stage.image(self._camera, opaque), 1.0)
        for layer in in_layers([vertices[name] for name in soft], self._camera, self._style.size):
            visible = [soft[body] for body in layer] + [name + HOLE for name in opaque]
            picture = laid_over(picture, self._stage.image(self._camera, visible), self._style.opacity)
        return picture
