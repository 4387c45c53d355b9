"""Smoothing of stair-stepped edges in a finished picture.

The idea is that of fast approximate antialiasing (FXAA): along an edge between two rows of pixels the steps of a
slanted line lie far apart; the nearer a pixel is to such a step, the more of the other row's colour it gets.
"""

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
    middle = 2 * flat[pixel]
    up, down, left, right = (flat[pixel + step] for step in (-width, width, -1, 1))
    corner = {(v, h): flat[pixel + v * width + h] for v in (-1, 1) for h in (-1, 1)}
    rows_differ = (
        np.abs(corner[-1, -1] + corner[1, -1] - 2 * left)
        + 2 * np.abs(up + down - middle)
        + np.abs(corner[-1, 1] + corner[1, 1] - 2 * right)
    )
    columns_differ = (
        np.abs(corner[-1, -1] + corner[-1, 1] - 2 * up)
        + 2 * np.abs(left + right - middle)
        + np.abs(corner[1, -1] + corner[1, 1] - 2 * down)
    )
    level = rows_differ >= columns_differ
    own = flat[pixel]
    before, after = np.where(level, up, left), np.where(level, down, right)
    side = np.where(np.abs(before - own) >= np.abs(after - own), -1, 1)
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
