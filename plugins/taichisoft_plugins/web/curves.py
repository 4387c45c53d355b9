"""The plots of a page: pressures, forces on the gripped object, and its height over time."""

import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from taichisoft_plugins.web.frame import Cast, Frame, grip_forces

MOST_POINTS = 300
"""Drawn at once; beyond that every second one goes, so that a plot reaches back to the start."""

LINES = ("#0077bb", "#ee7733", "#009988", "#cc3311", "#33bbee", "#ee3377", "#999933", "#555555")


def row_of(
    cast: Cast, pressures: Mapping[str, float], normal_forces: Mapping[str, float], rigid_position: np.ndarray
) -> np.ndarray:
    """What is plotted of a moment: pressures [kPa], forces [mN], and the height [mm] of the gripped body, in a row."""
    height = 0.0 if cast.gripped is None else float(rigid_position[cast.gripped_index] @ cast.up)
    return np.array([*(pressures.get(name, 0.0) for name in cast.cavities), *grip_forces(cast, normal_forces), height])


class History:
    """What the plots show of the frames since the last start.

    Attributes:
        times: [s], of the frames that were kept.
        rows: of each, see `row_of`; heights over that of the first frame.
    """

    def __init__(self, cast: Cast, first: Frame):
        """Empty; the first frame is the one that heights are counted from."""
        self._cast = cast
        self._start = self._row(first)[-1]
        self.times: list[float] = []
        self.rows: list[np.ndarray] = []
        self._last = -math.inf
        self._count, self._stride = 0, 1

    def add(self, frame: Frame) -> None:
        """Take a frame; one before the last one begins anew, and the same moment again is nothing new."""
        if frame.time < self._last:
            self.times, self.rows, self._last, self._count, self._stride = [], [], -math.inf, 0, 1
        if frame.time == self._last:
            return
        self._last = frame.time
        if self._count % self._stride == 0:
            row = self._row(frame)
            row[-1] -= self._start
            self.times.append(frame.time)
            self.rows.append(row)
        self._count += 1
        if len(self.times) > MOST_POINTS:
            self.times, self.rows = self.times[::2], self.rows[::2]
            self._stride *= 2

    def _row(self, frame: Frame) -> np.ndarray:
        return row_of(self._cast, frame.pressures, frame.normal_forces, frame.rigid_position)


class Curves:
    """Three plots in the panel of a page; those without anything to show are left out."""

    def __init__(self, gui: Any, cast: Cast):
        """Empty ones."""
        forces = cast.soft_bodies if cast.gripped is not None else ()
        heights = (cast.gripped,) if cast.gripped is not None else ()
        start, self._plots = 0, []
        groups: Iterable[tuple[str, tuple[str, ...], int]] = (
            ("pressure [kPa]", cast.cavities, len(cast.cavities)),
            (f"pressed on {cast.gripped} [mN]", forces, len(cast.soft_bodies)),
            (f"{cast.gripped} lifted by [mm]", heights, 1),
        )
        for title, names, width in groups:
            if names:
                columns = slice(start, start + width)
                self._plots.append((columns, _add_plot(gui, title, names)))
            start += width

    def show(self, times: np.ndarray, rows: np.ndarray) -> None:
        """Draw rows of `row_of`, shape (count, columns), over times [s], shape (count,)."""
        if len(times) > 1:
            for columns, plot in self._plots:
                plot.data = (times, *rows.T[columns])


def _add_plot(gui: Any, title: str, names: tuple[str, ...]) -> Any:
    from viser import uplot

    lines = [
        uplot.Series(label=name, stroke=LINES[index % len(LINES)], width=1.5, points={"show": False})
        for index, name in enumerate(names)
    ]
    nothing = np.zeros(2)
    return gui.add_uplot(
        data=(np.array([0.0, 1.0]), *(nothing for _ in names)),
        series=(uplot.Series(label="time [s]"), *lines),
        scales={"x": uplot.Scale(time=False, auto=True), "y": uplot.Scale(auto=True)},
        title=title,
        legend=uplot.Legend(show=False),
        aspect=2.2,
    )
