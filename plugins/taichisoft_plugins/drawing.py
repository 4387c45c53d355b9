"""Drawing frames of a recording: what stands on the stage, and one camera for all the frames."""

from pathlib import Path

import numpy as np

from taichisoft_plugins.camera import fit_camera, scene_axes
from taichisoft_plugins.recording_reader import RecordedPlane, Recording
from taichisoft_plugins.stage import Stage


def draw_frames(
    recording: Recording, frames: dict[str, int], folder: Path, size: tuple[int, int], view: str
) -> None:
    """Write `folder/NAME.png` for every named frame, all seen from the same place.

    Args:
        recording: open.
        frames: frame index by name.
        folder: exists.
        size: width and height [pixels].
        view: a key of `camera.VIEWS`.
    """
    points = np.concatenate(
        [
            surface.vertices(frame)
            for surface in recording.surfaces
            if surface.kind in ("soft", "rigid")
            for frame in frames.values()
        ]
    )
    camera = fit_camera(points, recording.up, view, size[0] / size[1])
    stage = Stage(size, recording.up)
    for name, frame in frames.items():
        stage.clear()
        for plane in recording.planes:
            stage.add(plane.name, *plane_patch(plane, points, recording.up), "floor")
        for surface in recording.surfaces:
            stage.add(surface.name, surface.vertices(frame), surface.triangles, surface.kind)
        stage.draw(camera, folder / f"{name}.png")


def plane_patch(plane: RecordedPlane, points: np.ndarray, up: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The part of an infinite plane that is drawn: vertices [mm], (4, 3), and triangles, (2, 3).

    A floor reaches so far that its edge is out of the picture from above and a horizon from the front.
    A slope or a wall is only as large as what is in the scene, or it would hide it.
    """
    middle = points.mean(axis=0)
    radius = np.linalg.norm(points - middle, axis=1).max()
    half = radius * (40.0 if plane.normal @ up > 0.99 else 1.5)
    centre = middle - plane.normal * ((middle - plane.point) @ plane.normal)
    right, front, _ = scene_axes(plane.normal)
    corners = np.array([right + front, front - right, -right - front, right - front])
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    if np.cross(corners[1] - corners[0], corners[2] - corners[0]) @ plane.normal < 0:
        triangles = triangles[:, ::-1]
    return centre + half * corners, triangles
