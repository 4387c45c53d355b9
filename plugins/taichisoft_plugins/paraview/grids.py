"""Grids of a frame for ParaView: soft bodies, cavities, cables, surfaces of the other bodies, and contacts.

`body` numbers the bodies in the order of the scene: soft bodies, rigid bodies, obstacles. Units are mm, mm/s, kPa, mm^3
and mN.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from taichisoft.bodies.surfaces import Plane
from taichisoft_plugins.drawing.planes import square_of_plane
from taichisoft_plugins.paraview.soft_bodies import SoftBodyGrid
from taichisoft_plugins.paraview.vtu_file import LINE, TRIANGLE, VERTEX, Grid
from taichisoft_plugins.recording.reader import RecordedSurface, Recording

PLANE_SIZE = 4.0
"""Half the side of the square that stands for a plane, in radii of the bodies [-]."""


def grid_makers(recording: Recording) -> dict[str, Callable[[int], Grid]]:
    """The functions that make the grids of a frame, by the names of the grids; only those that show something."""
    scene = recording.scene
    makers: dict[str, Callable[[int], Grid]] = {}
    if recording.soft_bodies:
        makers["soft_bodies"] = SoftBodyGrid(recording)
    cavities = [surface for surface in recording.surfaces if surface.kind == "cavity"]
    if cavities:
        values = {name: partial(recording.row, name) for name in ("pressure", "volume")}
        makers["cavities"] = SurfaceGrid(cavities, "cavity", recording.cavities, values)
    if recording.cables:
        makers["cables"] = CableGrid(recording)
    others = [surface for surface in recording.surfaces if surface.kind in ("rigid", "obstacle")]
    others += [_square(plane, recording) for plane in recording.planes]
    if others:
        names = [*scene.soft_bodies, *scene.rigid_bodies, *scene.obstacles]
        makers["rigid_bodies"] = SurfaceGrid(others, "body", names, {})
    makers["contacts"] = lambda frame: _contact_grid(*recording.contacts(frame))
    return makers


class SurfaceGrid:
    """Makes one grid of triangles of several surfaces in any frame."""

    def __init__(
        self,
        surfaces: Sequence[RecordedSurface],
        number_name: str,
        numbered: Sequence[str],
        values: Mapping[str, Callable[[int], np.ndarray]],
    ):
        """Put together the triangles.

        Args:
            surfaces: the surfaces of which the grid is made.
            number_name: name of the cell data that tell to which surface a triangle belongs.
            numbered: names of surfaces; the place of a name in this list is its number.
            values: further cell data by name; each function gives a value for every entry of `numbered` in a frame.
        """
        self._surfaces = surfaces
        numbers = np.array([numbered.index(surface.name) for surface in surfaces], dtype=np.int32)
        self._number_name = number_name
        self._numbers = np.repeat(numbers, [len(surface.triangles) for surface in surfaces])
        self._values = values

    def __call__(self, frame: int) -> Grid:
        """The grid of a frame."""
        vertices = [surface.vertices(frame) for surface in self._surfaces]
        first = np.cumsum([0, *map(len, vertices)])
        cells = [surface.triangles + start for surface, start in zip(self._surfaces, first, strict=False)]
        values = {name: value(frame)[self._numbers] for name, value in self._values.items()}
        cell_data = {self._number_name: self._numbers, **values}
        return Grid(np.vstack(vertices), np.vstack(cells), TRIANGLE, cell_data=cell_data)


class CableGrid:
    """Makes one grid of lines of all cables in any frame: a line from each point to the next."""

    def __init__(self, recording: Recording):
        """Put together the lines."""
        self._recording = recording
        counts = [len(path.owner) for path in recording.cable_paths]
        after = np.arange(sum(counts))
        after = np.delete(after, np.cumsum([0, *counts[:-1]]))  # no line leads to the first point of a cable
        self._cells = np.stack([after - 1, after], axis=1)
        self._numbers = np.repeat(np.arange(len(counts), dtype=np.int32), np.array(counts) - 1)

    def __call__(self, frame: int) -> Grid:
        """The grid of a frame, with the tension of each line, and the pull of its cable."""
        points = np.vstack(self._recording.cable_points(frame))
        tension = np.concatenate(self._recording.segment_tensions(frame))
        pull = self._recording.row("pull", frame)[self._numbers]
        cell_data = {"cable": self._numbers, "tension": tension, "pull": pull}
        return Grid(points, self._cells, LINE, cell_data=cell_data)


def _contact_grid(points: np.ndarray, forces: np.ndarray) -> Grid:
    """A vertex at each contact [mm], with the force [mN] on the second body of its pair."""
    return Grid(points, np.arange(len(points))[:, None], VERTEX, point_data={"force": forces})


def _square(plane: Plane, recording: Recording) -> RecordedSurface:
    """A piece of an infinite plane, large enough to be seen below everything; its front is that of the plane."""
    everything = np.vstack([surface.vertices(0) for surface in recording.surfaces])
    corners, triangles = square_of_plane(plane, everything, [], PLANE_SIZE)
    return RecordedSurface(plane.name, "obstacle", triangles, lambda frame: corners)
