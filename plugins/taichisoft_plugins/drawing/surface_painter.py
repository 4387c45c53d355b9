"""Surfaces over a background: opaque ones, and translucent soft bodies in layers."""

from collections.abc import Sequence

import numpy as np

from taichisoft_plugins.drawing.camera import Camera, seen_from_front
from taichisoft_plugins.drawing.shading import shaded
from taichisoft_plugins.drawing.smooth_normals import SmoothNormals
from taichisoft_plugins.drawing.stage import NOTHING, Stage
from taichisoft_plugins.drawing.translucency import in_layers, laid_over

HOLE = " as a hole"
"""What an opaque surface hides of a layer of translucent ones is left open in that layer."""


class SurfacePainter:
    """Paints surfaces that deform; a process can have only one.

    Args:
        size: width and height of the pictures [pixels].
        triangles: of all surfaces by their names, vertex indices, outward, (triangle_count, 3).
        translucent: names of those that can be seen through.
        opacity: of the translucent surfaces [-].
        axes: rows right, front and up of the scene, from which the light comes.
    """

    def __init__(
        self,
        size: tuple[int, int],
        triangles: dict[str, np.ndarray],
        translucent: Sequence[str],
        opacity: float,
        axes: np.ndarray,
    ):
        self._size, self._opacity, self._axes = size, opacity, axes
        self._normals = {name: SmoothNormals(of_surface) for name, of_surface in triangles.items()}
        self._triangles = triangles
        self._translucent = list(translucent)
        self._opaque = [name for name in triangles if name not in translucent]
        self._always: list[str] = []
        self._stage = Stage(size)

    def hide_behind(self, name: str, vertices: np.ndarray, triangles: np.ndarray) -> None:
        """Let nothing be seen behind triangles that are painted elsewhere.

        Args:
            name: of what they are.
            vertices: [mm], shape (vertex_count, 3).
            triangles: vertex indices, shape (triangle_count, 3).
        """
        self._put_hole(name + HOLE, vertices, triangles)
        self._always.append(name + HOLE)

    def paint(
        self, picture: np.ndarray, camera: Camera, vertices: dict[str, np.ndarray], colours: dict[str, np.ndarray]
    ) -> np.ndarray:
        """The picture with all surfaces over it.

        Args:
            picture: shape (height, width, 3), dtype uint8.
            camera: sees them.
            vertices: of every surface [mm], shape (vertex_count, 3).
            colours: red, green and blue [-] of every surface, shape (3,), or of its vertices, (vertex_count, 3).
        """
        for name, where in vertices.items():
            self._put(name, camera, where, colours[name])
        picture = laid_over(picture, self._stage.image(camera, self._opaque + self._always), 1.0)
        holes = [name + HOLE for name in self._opaque] + self._always
        bodies = [vertices[name] for name in self._translucent]
        for layer in in_layers(bodies, camera, self._size):
            image = self._stage.image(camera, [self._translucent[body] for body in layer] + holes)
            picture = laid_over(picture, image, self._opacity)
        return picture

    def _put(self, name: str, camera: Camera, vertices: np.ndarray, colours: np.ndarray) -> None:
        corners, normals = self._normals[name](vertices)
        if colours.ndim == 2:
            colours = colours[self._triangles[name].ravel()]
        triangles = np.arange(len(corners)).reshape(-1, 3)
        triangles = triangles[seen_from_front(camera, corners.reshape(-1, 3, 3))]
        self._stage.put(name, corners, triangles, shaded(colours, normals, self._axes))
        if name in self._opaque:
            self._put_hole(name + HOLE, corners, triangles)

    def _put_hole(self, name: str, vertices: np.ndarray, triangles: np.ndarray) -> None:
        self._stage.put(name, vertices, triangles, np.tile(np.array(NOTHING) / 255, (len(vertices), 1)))
