"""Surfaces over a background: opaque ones, and translucent bodies in layers from the farthest to the nearest."""

from collections.abc import Sequence

import numpy as np

from taichisoft_outputs.drawing.camera import PictureCamera, project, seen_from_front
from taichisoft_outputs.drawing.shading import SmoothNormals, shade
from taichisoft_outputs.drawing.stage import EMPTY, Stage

HOLDOUT = " as a holdout"
"""Ends the name of what is drawn in the colour EMPTY, so that it hides parts of a layer without being seen in it."""


class SurfacePainter:
    """Paints surfaces that deform; a process can have only one.

    Args:
        size: width and height of the pictures [pixels].
        triangles: vertex indices of all surfaces by their names, outward, (triangle_count, 3).
        translucent: names of the surfaces that can be seen through.
        opacity: opacity of the translucent surfaces [-].
        key: unit vector to the key light, shape (3,).
        up: unit vector against gravity, shape (3,).
    """

    def __init__(
        self,
        size: tuple[int, int],
        triangles: dict[str, np.ndarray],
        translucent: Sequence[str],
        opacity: float,
        key: np.ndarray,
        up: np.ndarray,
    ):
        self._size, self._opacity, self._key, self._up = size, opacity, key, up
        self._normals = {name: SmoothNormals(of_surface) for name, of_surface in triangles.items()}
        self._triangles = triangles
        self._translucent = list(translucent)
        self._opaque = [name for name in triangles if name not in translucent]
        self._always: list[str] = []
        self._stage = Stage(size)

    def hide_behind(self, name: str, vertices: np.ndarray, triangles: np.ndarray) -> None:
        """Let nothing be seen behind triangles that are painted elsewhere.

        Args:
            name: name of the triangles.
            vertices: vertices [mm], shape (vertex_count, 3).
            triangles: vertex indices, shape (triangle_count, 3).
        """
        self._put_holdout(name + HOLDOUT, vertices, triangles)
        self._always.append(name + HOLDOUT)

    def paint(
        self,
        picture: np.ndarray,
        camera: PictureCamera,
        vertices: dict[str, np.ndarray],
        colours: dict[str, np.ndarray],
    ) -> np.ndarray:
        """The picture with all surfaces over it.

        Args:
            picture: the background, shape (height, width, 3), dtype uint8.
            camera: the camera that sees the surfaces.
            vertices: vertices of every surface [mm], shape (vertex_count, 3).
            colours: red, green and blue [-] of every surface, shape (3,), or of its vertices, (vertex_count, 3).
        """
        for name, where in vertices.items():
            self._put(name, camera, where, colours[name])
        picture = lay_over(picture, self._stage.image(camera, self._opaque + self._always), 1.0)
        holdouts = [name + HOLDOUT for name in self._opaque] + self._always
        bodies = [vertices[name] for name in self._translucent]
        for layer in depth_layers(bodies, camera, self._size):
            image = self._stage.image(camera, [self._translucent[body] for body in layer] + holdouts)
            picture = lay_over(picture, image, self._opacity)
        return picture

    def _put(self, name: str, camera: PictureCamera, vertices: np.ndarray, colours: np.ndarray) -> None:
        corners, normals = self._normals[name](vertices)
        if colours.ndim == 2:
            colours = colours[self._triangles[name].ravel()]
        triangles = np.arange(len(corners)).reshape(-1, 3)
        triangles = triangles[seen_from_front(camera, corners.reshape(-1, 3, 3))]
        self._stage.put(name, corners, triangles, shade(colours, normals, self._key, self._up))
        if name in self._opaque:
            self._put_holdout(name + HOLDOUT, corners, triangles)

    def _put_holdout(self, name: str, vertices: np.ndarray, triangles: np.ndarray) -> None:
        self._stage.put(name, vertices, triangles, np.tile(np.array(EMPTY) / 255, (len(vertices), 1)))


def depth_layers(bodies: Sequence[np.ndarray], camera: PictureCamera, size: tuple[int, int]) -> list[list[int]]:
    """Indices of bodies from the farthest layer to the nearest; in no layer does one stand before another.

    Two bodies may share a layer where their rectangles in the picture do not touch, so mostly few layers are needed.

    Args:
        bodies: vertices [mm] of each body, shape (vertex_count, 3).
        camera: the camera that sees the bodies.
        size: width and height of the picture [pixels].
    """
    rectangles, distances = [], []
    for vertices in bodies:
        pixels, depth = project(camera, vertices, size)
        rectangles.append((pixels.min(axis=0), pixels.max(axis=0)))
        distances.append(depth.mean())
    layers: list[list[int]] = []
    layer_of: dict[int, int] = {}
    for index in sorted(range(len(bodies)), key=lambda body: -distances[body]):
        low, high = rectangles[index]
        behind = [
            layer
            for other, layer in layer_of.items()
            if (low <= rectangles[other][1]).all() and (rectangles[other][0] <= high).all()
        ]
        layer_of[index] = max(behind, default=-1) + 1
        if layer_of[index] == len(layers):
            layers.append([])
        layers[layer_of[index]].append(index)
    return layers


def lay_over(below: np.ndarray, layer: np.ndarray, opacity: float) -> np.ndarray:
    """A picture with a layer over it, where that shows something.

    Args:
        below: picture of all that is behind the layer, shape (height, width, 3), dtype uint8.
        layer: picture of the layer, EMPTY where there is nothing in it.
        opacity: opacity of the layer [-].
    """
    from PIL import Image

    red, green, blue = EMPTY
    # Channel by channel, and only where there is something: this is done for every pixel of a video.
    covered = (layer[..., 1] != green) | (layer[..., 0] != red) | (layer[..., 2] != blue)
    mask = Image.fromarray(covered)
    box = mask.getbbox()
    if box is None:
        return below
    part = np.s_[box[1] : box[3], box[0] : box[2]]
    bottom, top = Image.fromarray(below[part]), Image.fromarray(layer[part])
    bottom.paste(top if opacity == 1.0 else Image.blend(bottom, top, opacity), mask=mask.crop(box))
    over = below.copy()
    over[part] = np.asarray(bottom)
    return over
