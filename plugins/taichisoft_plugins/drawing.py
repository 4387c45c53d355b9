"""Drawing frames of a recording: what stands on the stage, and one camera for all the frames."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from taichisoft_plugins.camera import fit_camera, scene_axes
from taichisoft_plugins.recording_reader import RecordedPlane, Recording
from taichisoft_plugins.stage import Stage
from taichisoft_plugins.style import Style

SQUARE, HORIZON = 2.2, 40.0
"""Half widths of the drawn parts of a plane, in radii of what stands on it [-]."""


class Drawer:
    """Draws frames of a recording as its style says; a process can have only one.

    Args:
        recording: stays open as long as frames are drawn.
        style: what the user chose.
        frames: all frames that will be drawn, in order: the camera and the ranges of the colours suit them all.
    """

    def __init__(self, recording: Recording, style: Style, frames: Sequence[int]):
        self._recording = recording
        self._points = np.concatenate(
            [s.vertices(frame) for s in recording.surfaces if s.kind in ("soft", "rigid") for frame in frames]
        )
        self._camera = fit_camera(self._points, recording.up, style.view, style.size[0] / style.size[1])
        self._stage = Stage(style.size, recording.up)

    def image(self, frame: int) -> np.ndarray:
        """The picture of one of the frames: red, green and blue, shape (height, width, 3), dtype uint8."""
        recording, stage = self._recording, self._stage
        stage.clear()
        for plane in recording.planes:
            vertices, square, ring = floor_and_horizon(plane, self._points, recording.up)
            stage.add(plane.name, vertices, square, "floor")
            if len(ring):
                stage.add(f"{plane.name} to the horizon", vertices, ring, "horizon")
        for surface in recording.surfaces:
            stage.add(surface.name, surface.vertices(frame), surface.triangles, surface.kind)
        return stage.image(self._camera)


def draw_frames(recording: Recording, frames: dict[str, int], folder: Path, size: tuple[int, int], view: str) -> None:
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
            vertices, square, ring = floor_and_horizon(plane, points, recording.up)
            stage.add(plane.name, vertices, square, "floor")
            if len(ring):
                stage.add(f"{plane.name} to the horizon", vertices, ring, "horizon")
        for surface in recording.surfaces:
            stage.add(surface.name, surface.vertices(frame), surface.triangles, surface.kind)
        stage.draw(camera, folder / f"{name}.png")


def floor_and_horizon(
    plane: RecordedPlane, points: np.ndarray, up: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The part of an infinite plane that is drawn: a square, and a ring around it as far as the horizon.

    They are apart because only the square takes shadows: the finer is what the light must resolve. The
    ring is only for a floor; around a slope or a wall it would hide the scene.

    Args:
        plane: what is drawn.
        points: what must stand on it [mm], shape (point_count, 3).
        up: unit vector against gravity, shape (3,).

    Returns:
        Vertices [mm], (8, 3); triangles of the square, (2, 3), and of the ring, (8, 3) or (0, 3).
    """
    middle = points.mean(axis=0)
    radius = np.linalg.norm(points - middle, axis=1).max()
    centre = middle - plane.normal * ((middle - plane.point) @ plane.normal)
    right, front, _ = scene_axes(plane.normal)
    # Front is right x up: seen from the side of the normal, right -> back -> left turns against the clock.
    corners = np.array([right - front, -right - front, front - right, right + front])
    vertices = np.concatenate([centre + SQUARE * radius * corners, centre + HORIZON * radius * corners])
    square = np.array([[0, 1, 2], [0, 2, 3]])
    if plane.normal @ up < 0.99:
        return vertices, square, np.empty((0, 3), dtype=int)
    start = np.arange(4)
    stop = np.roll(start, -1)
    ring = np.concatenate([np.stack([start, start + 4, stop + 4], 1), np.stack([start, stop + 4, stop], 1)])
    return vertices, square, ring
