"""Where the camera stands in each frame, so that nothing that moves is cut off in any of them."""

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from taichisoft_outputs.drawing.camera import (
    PictureCamera,
    distance_to_see,
    fit_camera,
    picture_up,
    radius_around_mean,
    view_direction,
)
from taichisoft_outputs.drawing.style import TIP, Style, StyleError
from taichisoft_outputs.recorded_tips import recorded_fingertips
from taichisoft_outputs.recording.reader import RecordedSurface, Recording

ORBIT_DIRECTIONS = 72
"""Number of directions from which the distance of an orbit is chosen."""
POINTS_AT_A_TIME = 100_000
"""Number of points that are kept before they are reduced to their outermost."""

NEAR, NEAR_TIP = 1.6, 0.6
"""Radius of what is seen around a body that is followed, in its radii, and around a tip, in radii of its finger [-]."""

CameraPath = Callable[[int], PictureCamera]
"""Gives the camera of a frame."""
FollowedPart = tuple[Callable[[int], np.ndarray], float]
"""Gives the middle of what a camera moves with in a frame [mm], shape (3,); and the radius that it sees of it [mm]."""


def camera_path(
    style: Style,
    frames: Sequence[int],
    points: np.ndarray,
    up: np.ndarray,
    aspect: float,
    followed: FollowedPart | None = None,
) -> CameraPath:
    """The path that a style asks for.

    Args:
        style: what the user chose.
        frames: all frames that will be drawn, in order.
        points: `outermost_points` of these [mm], shape (point_count, 3).
        up: unit vector against gravity, shape (3,).
        aspect: width / height of the part of the picture that things are fitted into.
        followed: what the camera moves with; None where it does not.
    """
    if followed is not None:
        return _following(followed, up, aspect)
    if style.eye is None and style.view == "orbit":
        return _orbiting(points, frames, up, aspect)
    if style.eye is not None:
        camera = _explicit(style, points, up)
    else:
        camera = fit_camera(points, up, style.view or "iso", aspect)
    return lambda frame: camera


def outermost_points(surfaces: Iterable[RecordedSurface], frames: Iterable[int]) -> np.ndarray:
    """The corners of the convex hull of all that moves, over all frames [mm], shape (point_count, 3).

    Args:
        surfaces: surfaces of a recording; obstacles may be large and are left out, unless there is nothing else.
        frames: all frames that will be drawn.

    Raises:
        StyleError: a position is not a finite number; the message says in which frame and of what.
    """
    surfaces = list(surfaces)
    moving = [surface for surface in surfaces if surface.kind in ("soft", "rigid", "line")] or surfaces
    kept: list[np.ndarray] = []
    for frame in frames:
        for surface in moving:
            vertices = surface.vertices(frame)
            if not np.isfinite(vertices).all():
                raise StyleError(f"frame {frame} cannot be drawn: positions of '{surface.name}' are not finite")
            kept.append(vertices)
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


def followed_part(recording: Recording, surfaces: Sequence[RecordedSurface], name: str) -> FollowedPart:
    """A body, or the tip of a finger, "finger.tip".

    Raises:
        StyleError: the body has no tip, since nothing holds it.
    """
    if not name.endswith(TIP):
        surface = next(surface for surface in surfaces if surface.name == name)
        shape = surface.vertices(0)
        return lambda frame: surface.vertices(frame).mean(axis=0), NEAR * radius_around_mean(shape)
    body = next(body for body in recording.soft_bodies if body.name == name.removesuffix(TIP))
    tips = recorded_fingertips(recording, [body]).nodes
    if not tips:
        raise StyleError(f"view 'follow:{name}': '{body.name}' has no tip, since it has neither anchors nor `tip`")
    (nodes,), radius = tips, NEAR_TIP * radius_around_mean(body.rest_position)
    return lambda frame: recording.row("position", frame)[nodes].mean(axis=0), radius


def _following(part: FollowedPart, up: np.ndarray, aspect: float) -> CameraPath:
    middle, radius = part
    near = fit_camera(radius * np.concatenate([np.eye(3), -np.eye(3)]), up, "iso", aspect)
    return lambda frame: PictureCamera(near.eye + middle(frame), near.target + middle(frame), near.up)
