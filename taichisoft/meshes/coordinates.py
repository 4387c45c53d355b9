"""Limits of coordinates: finite, and not so large that products of lengths overflow."""

import numpy as np

from taichisoft.errors import MeshError

LARGEST = 1e9
"""Largest coordinate [mm], a thousand kilometres: beyond 1e38 mm the quality of an element overflows."""


def refuse_coordinates(points: np.ndarray, source: object, what: str) -> None:
    """Raise MeshError for the first point with a coordinate that is not finite, or larger than LARGEST.

    Args:
        points: positions [mm], shape (count, 3).
        source: file that they come from; begins the error.
        what: name of a point, such as "node".
    """
    with np.errstate(invalid="ignore"):
        wrong = ~(np.abs(points) <= LARGEST)
    if not wrong.any():
        return
    index = int(np.argmax(wrong.any(axis=1)))
    value = float(points[index][wrong[index]][0])
    problem = f"of {value:g} mm; {LARGEST:g} mm is the most" if np.isfinite(value) else "that is not finite"
    raise MeshError(f"{source}: {what} {index} has a coordinate {problem}")
