"""Where things are in all frames that will be drawn, so that nothing is cut off in any of them."""

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from taichisoft_plugins.drawing.style import StyleError
from taichisoft_plugins.recording.reader import RecordedSurface

AT_A_TIME = 100_000
"""Points that are kept before they are reduced to their outermost."""


def outermost_points(
    surfaces: Iterable[RecordedSurface], frames: Iterable[int], origin: Callable[[int], np.ndarray] | None = None
) -> np.ndarray:
    """The corners of the convex hull of all that moves, over all frames [mm], shape (point_count, 3).

    Args:
        surfaces: of a recording; obstacles may be large and are left out, unless there is nothing else.
        frames: all that will be drawn.
        origin: of the coordinates in a frame [mm], shape (3,); None for that of the scene.

    Raises:
        StyleError: a position is not a finite number; says in which frame and of what.
    """
    surfaces = list(surfaces)
    moving = [surface for surface in surfaces if surface.kind in ("soft", "rigid")] or surfaces
    kept: list[np.ndarray] = []
    for frame in frames:
        shift = 0.0 if origin is None else origin(frame)
        for surface in moving:
            vertices = surface.vertices(frame)
            if not np.isfinite(vertices).all():
                raise StyleError(f"frame {frame} cannot be drawn: positions of '{surface.name}' are not finite")
            kept.append(vertices - shift)
        if sum(map(len, kept)) > AT_A_TIME:
            kept = [_outermost(np.concatenate(kept))]
    return _outermost(np.concatenate(kept))


def spread(frames: Sequence[int], count: int) -> list[int]:
    """At most `count` of the frames, evenly spread from the first to the last."""
    return [frames[index] for index in np.unique(np.linspace(0, len(frames) - 1, count).astype(int))]


def _outermost(points: Sequence[np.ndarray] | np.ndarray) -> np.ndarray:
    from scipy.spatial import ConvexHull

    points = np.unique(np.asarray(points), axis=0)
    if len(points) < 5:
        return points
    # Joggling lets flat things have a hull too.
    return points[ConvexHull(points, qhull_options="QJ").vertices]
