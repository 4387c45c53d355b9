"""Smoothing of stair-stepped edges in a finished picture.

The idea is that of fast approximate antialiasing (FXAA): along an edge between two rows of pixels the steps of a
slanted line lie far apart; the nearer a pixel is to such a step, the more of the other row's colour it gets.
"""

from collections.abc import Sequence

import numpy as np

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
