"""Bodies that can be seen through: which are drawn together, and how their pictures are laid over each other."""

from collections.abc import Sequence

import numpy as np

from taichisoft_plugins.drawing.camera import Camera, project
from taichisoft_plugins.drawing.stage import NOTHING


def in_layers(bodies: Sequence[np.ndarray], camera: Camera, size: tuple[int, int]) -> list[list[int]]:
    """Indices of bodies from the farthest layer to the nearest; in no layer does one stand before another.

    Two bodies may share a picture where their rectangles in it do not touch, so mostly few pictures are needed.

    Args:
        bodies: vertices [mm] of each, shape (vertex_count, 3).
        camera: sees them.
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


def laid_over(below: np.ndarray, layer: np.ndarray, opacity: float) -> np.ndarray:
    """A picture with another one over it, where that shows something.

    Args:
        below: all that is behind the layer, shape (height, width, 3), dtype uint8.
        layer: what shines over it, before `stage.NOTHING`.
        opacity: of the layer [-].
    """
    from PIL import Image

    red, green, blue = NOTHING
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
