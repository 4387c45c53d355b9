"""What ParaView gets of a frame: soft bodies, cavities, surfaces of the other bodies, and contacts.

`body` numbers the bodies in the order of the scene: soft bodies, rigid bodies, obstacles. Units are mm, mm/s, kPa, mm^3
and mN. What a recording leaves out (`--fields`) is left out here, too; positions are needed.
"""

import tomllib
from collections.abc import Callable

import numpy as np

from taichisoft_plugins.paraview.soft_bodies import SoftBodyGrid
from taichisoft_plugins.paraview.surfaces import SurfaceGrid
from taichisoft_plugins.paraview.vtu_file import VERTEX, Grid
from taichisoft_plugins.recording.reader import RecordedPlane, RecordedSurface, Recording

PLANE_SIZE = 2.0
"""Half the side of the square that stands for a plane, as a multiple of the largest extent of the bodies."""


def grid_makers(recording: Recording) -> dict[str, Callable[[int], Grid]]:
    """What makes the grid of a frame, by the name of the grid; only of those that the scene has something for.

    Raises:
        RecordingError: the recording has no positions, or an older version wrote it.
    """
    makers: dict[str, Callable[[int], Grid]] = {}
    if recording.soft_bodies:
        makers["soft_bodies"] = SoftBodyGrid(recording)
    cavities = [surface for surface in recording.surfaces if surface.kind == "cavity"]
    if cavities:
        makers["cavities"] = SurfaceGrid(cavities, "cavity", recording.cavities, _cavity_values(recording))
    others = [surface for surface in recording.surfaces if surface.kind in ("rigid", "obstacle")]
    others += [_square(plane, recording) for plane in recording.planes]
    if others:
        makers["rigid_bodies"] = SurfaceGrid(others, "body", body_names(recording))
    if recording.has("contact_offset"):
        makers["contacts"] = lambda frame: _contact_grid(*recording.contacts(frame))
    return makers


def body_names(recording: Recording) -> list[str]:
    """Names of all bodies of the scene, in the order of their numbers."""
    scene = tomllib.loads(recording.scene)
    return [name for kind in ("soft_bodies", "rigid_bodies", "obstacles") for name in scene.get(kind, {})]


def _cavity_values(recording: Recording) -> dict[str, Callable[[int], np.ndarray]]:
    """Pressures [kPa] and volumes [mm^3] of all cavities in a frame, as far as they were recorded."""

    def of_frame(name: str) -> Callable[[int], np.ndarray]:
        return lambda frame: recording.row(name, frame)

    return {name: of_frame(name) for name in ("pressure", "volume") if recording.has(name)}


def _contact_grid(points: np.ndarray, forces: np.ndarray) -> Grid:
    """A vertex at each contact [mm], with the force [mN] on the second body of its pair."""
    return Grid(points, np.arange(len(points))[:, None], VERTEX, point_data={"force": forces})


def _square(plane: RecordedPlane, recording: Recording) -> RecordedSurface:
    """A piece of an infinite plane, large enough to be seen below everything; its front is that of the plane."""
    everything = np.vstack([surface.vertices(0) for surface in recording.surfaces] or [plane.point[None]])
    middle, extent = everything.mean(axis=0), np.ptp(everything, axis=0).max()
    foot = middle - ((middle - plane.point) @ plane.normal) * plane.normal
    one, other = np.linalg.svd(plane.normal[None])[2][1:]
    if np.cross(one, other) @ plane.normal < 0.0:
        one, other = other, one
    corners = foot + PLANE_SIZE * extent * np.array([-one - other, one - other, one + other, other - one])
    return RecordedSurface(plane.name, "obstacle", np.array([[0, 1, 2], [0, 2, 3]]), lambda frame: corners)
