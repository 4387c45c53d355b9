"""Where the camera stands in each frame, so that nothing that moves is cut off in any of them."""

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from taichisoft_outputs.drawing.camera import PictureCamera, distance_to_see, fit_camera, picture_up, view_direction
from taichisoft_outputs.drawing.style import Style, StyleError
from taichisoft_outputs.recording.reader import RecordedSurface

ORBIT_DIRECTIONS = 72
"""Number of directions from which the distance of an orbit is chosen."""
POINTS_AT_A_TIME = 100_000
"""Number of points that are kept before they are reduced to their outermost."""

CameraPath = Callable[[int], PictureCamera]
"""Gives the camera of a frame."""


def camera_path(
    style: Style,
    surfaces: Sequence[RecordedSurface],
    frames: Sequence[int],
    points: np.ndarray,
    up: np.ndarray,
    aspect: float,
) -> CameraPath:
    """The path that a style asks for.

    Args:
        style: what the user chose; a body that it follows is there.
        surfaces: surfaces of the recording.
        frames: all frames that will be drawn, in order.
        points: `outermost_points` of these [mm], shape (point_count, 3).
        up: unit vector against gravity, shape (3,).
        aspect: width / height of the part of the picture that things are fitted into.
    """
    if style.followed is not None:
        return _following(style.followed, surfaces, frames, up, aspect)
    if style.eye is None and style.view == "orbit":
        return _orbiting(points, frames, up, aspect)
    if style.eye is not None:
        camera = _explicit(style, points, up)
    else:
        camera = fit_camera(points, up, style.view or "iso", aspect)
    return lambda frame: camera


def outermost_points(
    surfaces: Iterable[RecordedSurface], frames: Iterable[int], origin: Callable[[int], np.ndarray] | None = None
) -> np.ndarray:
    """The corners of the convex hull of all that moves, over all frames [mm], shape (point_count, 3).

    Args:
        surfaces: surfaces of a recording; obstacles may be large and are left out, unless there is nothing else.
        frames: all frames that will be drawn.
        origin: gives the origin of the coordinates in a frame [mm], shape (3,); None for that of the scene.

    Raises:
        StyleError: a position is not a finite number; the message says in which frame and of what.
    """
    surfaces = list(surfaces)
    moving = [surface for surface in surfaces if surface.kind in ("soft", "rigid", "line")] or surfaces
    kept: list[np.ndarray] = []
    for frame in frames:
        shift = 0.0 if origin is None else origin(frame)
        for surface in moving:
            vertices = surface.vertices(frame)
            if not np.isfinite(vertices).all():
                raise StyleError(f"frame {frame} cannot be drawn: positions of '{surface.name}' are not finite")
            kept.append(vertices - shift)
        if sum(map(len, kept)) > POINTS_AT_A_TIME:
            kept = [_outermost(np.concatenate(kept))]
    return _outermost(np.concatenate(kept))


def _outermost(points: np.ndarray) -> np.ndarray:
    from scipy.spatial import ConvexHull

    points = np.unique(points, axis=0)
    if len(points) < 5:
        return points
    # Joggling lets flat things have a hull too.
    return points[ConvexHull(points, qhull_options="QJ").vertices]


def _explicit(style: Style, points: np.ndarray, up: np.ndarray) -> PictureCamera:
    eye = np.array(style.eye)
    target = points.mean(axis=0) if style.target is None else np.array(style.target)
    return PictureCamera(eye, target, picture_up((eye - target) / np.linalg.norm(eye - target), up))


def _orbiting(points: np.ndarray, frames: Sequence[int], up: np.ndarray, aspect: float) -> CameraPath:
    middle = (points.min(axis=0) + points.max(axis=0)) / 2

    def looking(turned: float, distance: float) -> PictureCamera:
        backward, up_in_picture = view_direction(up, "iso", turned)
        return PictureCamera(middle + distance * backward, middle, up_in_picture)

    turns = np.linspace(0, 2 * np.pi, ORBIT_DIRECTIONS, endpoint=False)
    distance = max(distance_to_see(points, looking(turned, 1.0), aspect) for turned in turns)
    place = {frame: index for index, frame in enumerate(frames)}
    return lambda frame: looking(2 * np.pi * place[frame] / len(frames), distance)


def _following(
    body: str, surfaces: Sequence[RecordedSurface], frames: Sequence[int], up: np.ndarray, aspect: float
) -> CameraPath:
    followed = next(surface for surface in surfaces if surface.name == body)

    def middle(frame: int) -> np.ndarray:
        return followed.vertices(frame).mean(axis=0)

    around_it = fit_camera(outermost_points(surfaces, frames, middle), up, "iso", aspect)
    return lambda frame: PictureCamera(around_it.eye + middle(frame), around_it.target + middle(frame), around_it.up)
