"""Surfaces inside the thin walls of a cavity: elements end there, so that the walls have several layers of them."""

from typing import TYPE_CHECKING

import numpy as np

from taichisoft_meshing.finger.cavity_walls import thin_walls, walled_boxes

if TYPE_CHECKING:
    from taichisoft_meshing.finger.boxes import Box
    from taichisoft_meshing.finger.parameters import FingerParameters

FLATTEST = 2.4
"""Edges of the surfaces over the thickness of a layer: with more, the tetrahedra between them are flat."""

SHARED = 2 / 3
"""Of a wall between two chambers: layers grow from both sides, and must not meet."""


def layer_count(finger: "FingerParameters") -> int:
    """Layers of elements in the thinnest wall: those asked for, as many as are not too flat; 1 for an even mesh."""
    sizes = finger.mesh
    if sizes.smallest == sizes.largest:
        return 1
    affordable = int(FLATTEST * thin_walls(finger)[0] / sizes.smallest)
    return max(1, min(sizes.elements_across_walls, affordable))


def layer_boxes(finger: "FingerParameters", part: float) -> "list[Box]":
    """The boxes of the cavity, grown by a part of the walls around them, but not far into thick ones."""
    thin = thin_walls(finger)
    return [
        walled.box.grown(
            part * _depth(walled.below, walled.shared_below, thin),
            part * _depth(walled.above, walled.shared_above, thin),
        )
        for walled in walled_boxes(finger)
    ]


def _depth(walls: np.ndarray, shared: np.ndarray, thin: np.ndarray) -> np.ndarray:
    """How deep into each wall layers reach [mm], shape (3,)."""
    depth: np.ndarray = np.where(walls <= thin[-1], np.where(shared, SHARED, 1.0) * walls, thin[0])
    return depth
