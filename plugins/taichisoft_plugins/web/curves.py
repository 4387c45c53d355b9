"""The plots of a page: pressures, forces on the gripped object, and its height over time."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from taichisoft_plugins.web.frame import Cast, Frame, grip_forces

MOST_POINTS = 300
"""Drawn at once; beyond that every second one goes, so that a plot reaches back to the start."""

LINES = ("#0077bb", "#ee7733", "#009988", "#cc3311", "#33bbee", "#ee3377", "#999933", "#555555")


class History:
    """What the plots show of the frames since the last start.

    Attributes:
        times: [s], of the frames that were kept.
        rows: of each: pressures [kPa], forces [mN], height [mm], in one array.
    """

    def __init__(self, cast: Cast, first: Frame):
        """Heights are counted from the first frame."""
        self._cast = cast
        self._start = self._place(first)
        self._stride = self._skipped = 0
        self.times: list[float] = []
        self.rows: list[np.ndarray] = []

    def add(self, frame: Frame) -> None:
        """Take a frame; one before the last one begins anew, and the same moment again is nothing new."""
        if self.times and frame.time < self.times[-1]:
            self.times, self.rows, self._stride, self._skipped = [], [], 0, 0
        if self.times and (frame.time == self.times[-1] or self._skipped < self._stride):
            self._skipped += frame.time != self.times[-1]
            return
        self._skipped = 0
        self.times.append(frame.time)
        self.rows.append(self.row(frame))
        if len(self.times) > MOST_POINTS:
            self.times, self.rows = self.times[::2], self.rows[::2]
            self._stride = 2 * self._stride + 1

    def row(self, frame: Frame) -> np.ndarray:
        """Pressures, forces and height of a frame."""
        pressures = [frame.pressures.get(name, 0.0) for name in self._cast.cavities]
        height = self._place(frame) - self._start
        return np.array([*pressures, *grip_forces(self._cast, frame.normal_forces), height])

    def _place(self, frame: Frame) -> float:
        if self._cast.gripped is None:
            return 0.0
        return float(frame.rigid_position[self._cast.gripped_index] @ self._cast.up)


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

    def show(self, history: History) -> None:
        """Draw all that is kept."""
        if len(history.times) < 2:
            return
        times, rows = np.array(history.times), np.array(history.rows)
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
