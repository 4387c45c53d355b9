"""How bright a surface is where its normal points: a high key light, and light from all around, more from above."""

import numpy as np

KEY = (0.55, 0.75, 1.25)
"""Direction to the key light in the axes (right, front, up) of `camera.scene_axes`: in front, from the right."""

DARKEST, KEY_STRENGTH, SKY_STRENGTH = 0.44, 0.44, 0.12
"""Brightness of what is turned away, and what the two lights add at most; together 1 [-]."""


def shaded(colours: np.ndarray, normals: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Colours as they appear in the light.

    Args:
        colours: red, green and blue [-], shape (3,) or (count, 3).
        normals: unit normals, shape (count, 3).
        axes: rows right, front and up of the scene, see `camera.scene_axes`.

    Returns:
        Shape (count, 3).
    """
    key = np.array(KEY) @ axes
    # Half of the light reaches around what it falls on, so that no side that is turned away looks flat.
    from_key = (0.5 + 0.5 * normals @ (key / np.linalg.norm(key))) ** 1.5
    from_sky = 0.5 + 0.5 * normals @ axes[2]
    return colours * (DARKEST + KEY_STRENGTH * from_key + SKY_STRENGTH * from_sky)[:, None]
