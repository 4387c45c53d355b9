"""The camera: named views, paths, and the distance from which everything fits into the picture."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from taichisoft.base import right_of
from taichisoft.mesh import SectionPlane
from taichisoft_outputs.drawing.style import TIP, Style, StyleError
from taichisoft_outputs.recording.reader import RecordedSurface, Recording, recorded_fingertips

# Where the camera stands: named views, and the distance from which everything fits into the picture.

VERTICAL_ANGLE = 28.0
"""Field of view [degrees]: narrow, so that parallel fingers look parallel."""

MARGIN = 0.08
"""Part of the picture that stays free along each edge [-]."""

VIEW_DIRECTIONS = {
    "iso": (-0.58, 1.0, 0.5),
    "front": (0.0, 1.0, 0.06),
    "top": (0.0, 0.0, 1.0),
}
"""Directions from the scene to the camera in the axes (right, front, up) of `scene_axes`."""


@dataclass(frozen=True)
class PictureCamera:
    """A perspective camera.

    Attributes:
        eye: position of the camera [mm], shape (3,).
        target: point that it looks at [mm], shape (3,).
        up: direction that is up in the picture [-], shape (3,).
    """

    eye: np.ndarray
    target: np.ndarray
    up: np.ndarray

    @property
    def axes(self) -> np.ndarray:
        """Orthonormal rows right, up and backward of the picture, shape (3, 3)."""
        backward = self.eye - self.target
        return _picture_axes(backward / np.linalg.norm(backward), self.up)


def focal_length(height: int) -> float:
    """Focal length of a picture so many pixels high [pixels]."""
    return float(height / 2 / np.tan(np.radians(VERTICAL_ANGLE / 2)))


def scene_axes(up: np.ndarray) -> np.ndarray:
    """Orthonormal rows right, front and up of a scene with the unit vector `up` against gravity, shape (3, 3)."""
    right = right_of(up)
    return np.array([right, np.cross(right, up), up])


def radius_around_mean(points: np.ndarray) -> float:
    """Largest distance of points [mm], shape (point_count, 3), from their mean [mm]."""
    return float(np.linalg.norm(points - points.mean(axis=0), axis=1).max())


def fit_camera(points: np.ndarray, up: np.ndarray, view: str, aspect: float) -> PictureCamera:
    """The nearest camera of a named view that has all points in the picture, with its margins free."""
    backward, up_in_picture = view_direction(up, view)
    axes = _picture_axes(backward, up_in_picture)
    coordinates = points @ axes.T
    depth = coordinates[:, 2]
    # The camera at (x0, z0) sees a point at (x, z) when |x - x0| <= slope (z0 - z).
    centres, distances = [], []
    for axis, slope in enumerate(_slopes(aspect)):
        high = np.max(coordinates[:, axis] + slope * depth)
        low = np.min(coordinates[:, axis] - slope * depth)
        centres.append((high + low) / 2)
        distances.append((high - low) / (2 * slope))
    # Something long seen from its end would have the camera at its very tip.
    eye = np.array([*centres, max(*distances, depth.max() + radius_around_mean(points) / 2)]) @ axes
    middle = np.array([*centres, depth.mean()]) @ axes
    return PictureCamera(eye, middle, up_in_picture)


def distance_to_see(points: np.ndarray, camera: PictureCamera, aspect: float) -> float:
    """Distance from its target [mm] at which a camera that looks in this direction has all points in the picture."""
    x, y, depth = ((points - camera.target) @ camera.axes.T).T
    slope_x, slope_y = _slopes(aspect)
    needed = depth + np.maximum(np.abs(x) / slope_x, np.abs(y) / slope_y)
    return float(max(needed.max(), depth.max() + radius_around_mean(points) / 2))


def view_direction(up: np.ndarray, view: str, turned: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """The unit vector from the scene to the camera, and the direction that is up in the picture.

    Args:
        turned: angle about `up`, counterclockwise as seen from above [rad].
    """
    x, y, z = VIEW_DIRECTIONS[view]
    # From above, front is a quarter of a turn clockwise from right.
    cosine, sine = np.cos(turned), np.sin(turned)
    backward = np.array([cosine * x + sine * y, cosine * y - sine * x, z]) @ scene_axes(up)
    backward /= np.linalg.norm(backward)
    return backward, picture_up(backward, up)


def picture_up(backward: np.ndarray, up: np.ndarray) -> np.ndarray:
    """The direction that is up in a picture, shape (3,): against gravity, unless one looks along it.

    Args:
        backward: unit vector from the scene to the camera, shape (3,).
    """
    # Seen from the top, what is in front lies at the bottom of the picture.
    return up if abs(backward @ up) < 0.999 else -scene_axes(up)[1]


def seen_from_front(camera: PictureCamera, corners: np.ndarray) -> np.ndarray:
    """Which triangles turn their front to the camera, shape (triangle_count,), of corners (triangle_count, 3, 3)."""
    a, b, c = np.moveaxis(corners, 1, 0)
    return np.einsum("ij,ij->i", np.cross(b - a, c - a), camera.eye - a) > 0


def pixel_matrix(
    camera: PictureCamera, origin: np.ndarray, directions: np.ndarray, size: tuple[int, int]
) -> np.ndarray:
    """The projection from coordinates on a plane, or in space, to pixels.

    Args:
        origin: point where the coordinates are 0 [mm], shape (3,).
        directions: directions of the coordinates, shape (count, 3).

    Returns:
        Shape (3, count + 1): times (coordinates..., 1) it gives (w x, w y, w) with the pixel (x, y), to the right of
        the left edge and below the upper edge, and the distance w in front of the camera [mm].
    """
    vectors = np.concatenate([directions, [origin - camera.eye]]) @ camera.axes.T
    scale = focal_length(size[1])
    depth = -vectors[:, 2]
    return np.array([size[0] / 2 * depth + scale * vectors[:, 0], size[1] / 2 * depth - scale * vectors[:, 1], depth])


def project(camera: PictureCamera, points: np.ndarray, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Where the camera sees points.

    Returns:
        Pixels to the right of the left edge and below the upper edge, shape (point_count, 2), and distances in front of
        the camera [mm], shape (point_count,); what is beside or behind the camera is said to be just before it.
    """
    matrix = pixel_matrix(camera, np.zeros(3), np.eye(3), size)
    x, y, depth = matrix[:, :3] @ points.T + matrix[:, 3:]
    depth = np.maximum(depth, 1e-6)
    return np.stack([x / depth, y / depth], axis=1), depth


def _picture_axes(backward: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Orthonormal rows right, up and backward of a picture that is seen against the unit vector `backward`."""
    right = np.cross(up, backward)
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(backward, right), backward])


def _slopes(aspect: float) -> tuple[float, float]:
    """Tangents of the half angles to the right and up within which things are to be seen."""
    tangent = np.tan(np.radians(VERTICAL_ANGLE / 2)) * (1 - 2 * MARGIN)
    return tangent * aspect, tangent


# Where the camera stands in each instant, so that nothing that moves is cut off in any of them.

ORBIT_DIRECTIONS = 72
"""Number of directions from which the distance of an orbit is chosen."""
POINTS_AT_A_TIME = 100_000
"""Number of points that are kept before they are reduced to their outermost."""

NEAR, NEAR_TIP = 1.6, 0.6
"""Radius of what is seen around a body that is followed, in its radii, and around a tip, in radii of its finger [-]."""

CameraPath = Callable[[int], PictureCamera]
"""Gives the camera of an instant."""
FollowedPart = tuple[Callable[[int], np.ndarray], float]
"""Gives the middle of what a camera moves with in an instant [mm], shape (3,); and the radius that it sees [mm]."""


def camera_path(
    style: Style,
    instants: Sequence[int],
    points: np.ndarray,
    up: np.ndarray,
    aspect: float,
    followed: FollowedPart | None = None,
    times: Sequence[float] | np.ndarray = (),
) -> CameraPath:
    """The path that a style asks for.

    Args:
        points: `outermost_points` of these [mm], shape (point_count, 3).
        followed: what the camera moves with; None where it does not.
        times: time of each instant of the recording [s], for key frames.
    """
    if style.key_frames:
        return _through(np.array(style.key_frames), {instant: float(times[instant]) for instant in instants}, up)
    if followed is not None:
        return _following(followed, up, aspect)
    if style.eye is None and style.view == "orbit":
        return _orbiting(points, instants, up, aspect)
    if style.eye is not None:
        camera = _explicit(style, points, up)
    else:
        camera = fit_camera(points, up, style.view or "iso", aspect)
    return lambda instant: camera


def outermost_points(surfaces: Iterable[RecordedSurface], instants: Iterable[int]) -> np.ndarray:
    """The corners of the convex hull of all that moves, over all instants [mm], shape (point_count, 3).

    Args:
        surfaces: surfaces of a recording; obstacles may be large and are left out, unless there is nothing else.
    """
    surfaces = list(surfaces)
    moving = [surface for surface in surfaces if surface.kind in ("soft", "rigid", "line")] or surfaces
    kept: list[np.ndarray] = []
    for instant in instants:
        for surface in moving:
            vertices = surface.vertices(instant)
            if not np.isfinite(vertices).all():
                raise StyleError(f"instant {instant} cannot be drawn: positions of '{surface.name}' are not finite")
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
    return _looking(eye, points.mean(axis=0) if style.target is None else np.array(style.target), up)


def _looking(eye: np.ndarray, target: np.ndarray, up: np.ndarray) -> PictureCamera:
    return PictureCamera(eye, target, picture_up((eye - target) / np.linalg.norm(eye - target), up))


def _through(key_frames: np.ndarray, times: Mapping[int, float], up: np.ndarray) -> CameraPath:
    """Through key frames on smooth curves without overshoot; before the first and after the last it stands."""
    from scipy.interpolate import PchipInterpolator

    curve = PchipInterpolator(key_frames[:, 0], key_frames[:, 1:])
    cameras = {}
    for instant, time in times.items():
        eye, target = curve(np.clip(time, *key_frames[[0, -1], 0])).reshape(2, 3)
        if np.linalg.norm(eye - target) < 0.1:
            raise StyleError(f"key frames: at {time:g} s the camera meets its target; lead it around by another line")
        cameras[instant] = _looking(eye, target, up)
    return cameras.__getitem__


def _orbiting(points: np.ndarray, instants: Sequence[int], up: np.ndarray, aspect: float) -> CameraPath:
    middle = (points.min(axis=0) + points.max(axis=0)) / 2

    def looking(turned: float, distance: float) -> PictureCamera:
        backward, up_in_picture = view_direction(up, "iso", turned)
        return PictureCamera(middle + distance * backward, middle, up_in_picture)

    turns = np.linspace(0, 2 * np.pi, ORBIT_DIRECTIONS, endpoint=False)
    distance = max(distance_to_see(points, looking(turned, 1.0), aspect) for turned in turns)
    place = {instant: index for index, instant in enumerate(instants)}
    return lambda instant: looking(2 * np.pi * place[instant] / len(instants), distance)


def depth_of_scale(camera: PictureCamera, section: SectionPlane | None) -> float:
    """Distance along the view at which lengths are compared [mm]: of what is looked at, or the section next to it."""
    target = camera.target
    if section is not None:
        target = target - section.height(target) * np.array(section.normal)
    depth = float((camera.eye - target) @ camera.axes[2])
    return depth if depth > 0.0 else float(np.linalg.norm(camera.eye - camera.target))


def seen_radius(style: Style, points: np.ndarray, followed: FollowedPart | None) -> float:
    """Radius of what a style's camera sees of points [mm], which the lengths of arrows suit [mm]."""
    ends = [np.reshape(row[1:], (2, 3)) for row in style.key_frames]
    if style.eye is not None:
        ends.append(np.array([style.eye, points.mean(axis=0) if style.target is None else style.target]))
    slope = np.tan(np.radians(VERTICAL_ANGLE / 2))
    radii = [slope * np.linalg.norm(eye - target) for eye, target in ends]
    return float(min([radius_around_mean(points), *radii, *(followed[1:] if followed is not None else ())]))


def followed_part(recording: Recording, surfaces: Sequence[RecordedSurface], name: str) -> FollowedPart:
    """A body, or the tip of a finger, "finger.tip"."""
    if not name.endswith(TIP):
        surface = next(surface for surface in surfaces if surface.name == name)
        shape = surface.vertices(0)
        return lambda instant: surface.vertices(instant).mean(axis=0), NEAR * radius_around_mean(shape)
    body = next(body for body in recording.soft_bodies if body.name == name.removesuffix(TIP))
    tips = recorded_fingertips(recording, [body]).nodes
    if not tips:
        raise StyleError(f"view 'follow:{name}': '{body.name}' has no tip, since it has neither anchors nor `tip`")
    (nodes,), radius = tips, NEAR_TIP * radius_around_mean(body.rest_position)
    return lambda instant: recording.row("position", instant)[nodes].mean(axis=0), radius


def _following(part: FollowedPart, up: np.ndarray, aspect: float) -> CameraPath:
    middle, radius = part
    near = fit_camera(radius * np.concatenate([np.eye(3), -np.eye(3)]), up, "iso", aspect)
    return lambda instant: PictureCamera(near.eye + middle(instant), near.target + middle(instant), near.up)
