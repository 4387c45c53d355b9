"""Surfaces of a frame as one grid of triangles."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from taichisoft_plugins.paraview.vtu_file import TRIANGLE, Grid
from taichisoft_plugins.recording.reader import RecordedSurface


class SurfaceGrid:
    """Makes the grid of any frame."""

    def __init__(
        self,
        surfaces: Sequence[RecordedSurface],
        number_name: str,
        numbered: Sequence[str],
        values: Mapping[str, Callable[[int], np.ndarray]] | None = None,
    ):
        """Put together the triangles.

        Args:
            surfaces: what the grid is made of.
            number_name: of the cell data that tell to which surface a triangle belongs.
            numbered: names of surfaces; the place of a name in this list is its number.
            values: further cell data by name; each gives, in a frame, one value for every entry of `numbered`.
        """
        self._surfaces = surfaces
        numbers = np.array([numbered.index(surface.name) for surface in surfaces], dtype=np.int32)
        self._number_name = number_name
        self._numbers = np.repeat(numbers, [len(surface.triangles) for surface in surfaces])
        self._values = dict(values or {})

    def __call__(self, frame: int) -> Grid:
        """The grid of a frame."""
        vertices = [surface.vertices(frame) for surface in self._surfaces]
        first = np.cumsum([0, *map(len, vertices)])
        cells = [surface.triangles + start for surface, start in zip(self._surfaces, first, strict=False)]
        values = {name: value(frame)[self._numbers] for name, value in self._values.items()}
        cell_data = {self._number_name: self._numbers, **values}
        return Grid(np.vstack(vertices), np.vstack(cells), TRIANGLE, cell_data=cell_data)
