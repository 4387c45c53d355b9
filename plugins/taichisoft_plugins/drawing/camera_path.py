"""Where the camera stands in each frame, as a style says."""

from collections.abc import Callable, Sequence

import numpy as np

from taichisoft_plugins.drawing.camera import Camera, distance_to_see, fit_camera, scene_axes, view_direction
from taichisoft_plugins.drawing.framing import outermost_points
from taichisoft_plugins.drawing.style import Style
from taichisoft_plugins.recording.reader import RecordedSurface

ORBIT_LOOKS = 72
"""Directions from which the distance of an orbit is chosen."""

CameraPath = Callable[[int], Camera]
"""Gives the camera of a frame."""


def camera_path(
    style: Style,
    surfaces: Sequence[RecordedSurface],
    frames: Sequence[int],
    points: np.ndarray,
    up: np.ndarray,
    aspect: float,
) -> CameraPath:
    """The way of the camera.

    Args:
        style: says which; a body that it follows is there.
        surfaces: of the recording.
        frames: all that will be drawn, in order.
        points: `outermost_points` of these [mm], shape (point_count, 3).
        up: unit vector against gravity, shape (3,).
        aspect: width / height of the part of the picture that things are fitted into.
    """
    if style.eye is not None:
        return _standing(_explicit(style, points, up))
    if style.followed is not None:
        return _following(style.followed, surfaces, frames, up, aspect)
    if style.view == "orbit":
        return _orbiting(points, frames, up, aspect)
    return _standing(fit_camera(points, up, style.view, aspect))


def _standing(camera: Camera) -> CameraPath:
    return lambda frame: camera


def _explicit(style: Style, points: np.ndarray, up: np.ndarray) -> Camera:
    eye = np.array(style.eye)
    target = points.mean(axis=0) if style.target is None else np.array(style.target)
    backward = (eye - target) / np.linalg.norm(eye - target)
    return Camera(eye, target, up if abs(backward @ up) < 0.999 else -scene_axes(up)[1])


def _orbiting(points: np.ndarray, frames: Sequence[int], up: np.ndarray, aspect: float) -> CameraPath:
    middle = (points.min(axis=0) + points.max(axis=0)) / 2

    def looking(turned: float, distance: float) -> Camera:
        backward, picture_up = view_direction(up, "iso", turned)
        return Camera(middle + distance * backward, middle, picture_up)

    turns = np.linspace(0, 2 * np.pi, ORBIT_LOOKS, endpoint=False)
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
    return lambda frame: Camera(around_it.eye + middle(frame), around_it.target + middle(frame), around_it.up)
