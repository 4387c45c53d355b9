"""The plots of a page: efforts of actuators, forces on the main object, and its height over time."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from taichisoft.actuators import ACTUATOR_KINDS, ActuatorKind
from taichisoft.control import Pair
from taichisoft.scenes import Scene
from taichisoft_outputs.web.frame import PageFrame, PageScene

MOST_POINTS = 300
"""Most points that are drawn at once; beyond that every second one goes, so that a plot reaches back to the start."""

LINES = ("#0077bb", "#ee7733", "#009988", "#cc3311", "#33bbee", "#ee3377", "#999933", "#555555")


def plotted_row(
    scene: Scene,
    efforts: Sequence[float],
    normal_forces: "Mapping[Pair, float]",
    rigid_position: np.ndarray,
) -> np.ndarray:
    """The figures that are plotted at one time, in a row.

    Args:
        scene: the scene of the run.
        efforts: of all actuators: pressures [kPa], tensions at pulled ends [mN].
        normal_forces: normal force of each pair of bodies [mN].
        rigid_position: centres of mass [mm], shape (rigid_count, 3).

    Returns:
        Efforts [kPa] or [mN], force of each soft body on the main object [mN], and the height of that [mm].
    """
    if scene.main_object is None:
        return np.array([*efforts, *(0.0 for _ in scene.soft_bodies), 0.0])
    pressed = {frozenset(pair): force for pair, force in normal_forces.items()}
    forces = (pressed.get(frozenset((name, scene.main_object)), 0.0) for name in scene.soft_bodies)
    height = rigid_position[list(scene.rigid_bodies).index(scene.main_object)] @ scene.up
    return np.array([*efforts, *forces, height])


class History:
    """What the plots show of the frames since the last start.

    Attributes:
        times: times of the frames that are kept [s].
        rows: their rows of `plotted_row`, with heights over that of the first frame of all.
    """

    def __init__(self, first: PageFrame):
        """Begin without any frame; heights are counted from that in `first`."""
        self._start = first.plotted[-1]
        self.times: list[float] = []
        self.rows: list[np.ndarray] = []
        self._last = -math.inf
        self._count, self._stride = 0, 1

    def add(self, frame: PageFrame) -> None:
        """Add a frame; an earlier time than the last clears the plots, and the same time is ignored."""
        if frame.time < self._last:
            self.times, self.rows, self._last, self._count, self._stride = [], [], -math.inf, 0, 1
        if frame.time == self._last:
            return
        self._last = frame.time
        if self._count % self._stride == 0:
            row = frame.plotted.copy()
            row[-1] -= self._start
            self.times.append(frame.time)
            self.rows.append(row)
        self._count += 1
        if len(self.times) > MOST_POINTS:
            self.times, self.rows = self.times[::2], self.rows[::2]
            self._stride *= 2


class Curves:
    """Plots in the panel of a page; plots without data are left out."""

    def __init__(self, gui: Any, content: PageScene):
        """Add empty plots to a panel of viser."""
        shown, soft = content.scene.main_object, tuple(content.scene.soft_bodies)
        start, self._plots = 0, []
        groups: Iterable[tuple[str, Sequence[str], int]] = (
            *(_group(content, kind) for kind in ACTUATOR_KINDS),
            (f"pressed on {shown} [mN]", soft if shown is not None else (), len(soft)),
            (f"{shown} lifted by [mm]", (shown,) if shown is not None else (), 1),
        )
        for title, names, width in groups:
            if names:
                columns = slice(start, start + width)
                self._plots.append((columns, _add_plot(gui, title, names)))
            start += width

    def show(self, times: np.ndarray, rows: np.ndarray) -> None:
        """Draw rows of `plotted_row`, shape (count, columns), over times [s], shape (count,)."""
        if len(times) > 1:
            for columns, plot in self._plots:
                plot.data = (times, *rows.T[columns])


def _group(content: PageScene, kind: ActuatorKind) -> tuple[str, Sequence[str], int]:
    """Title, names and number of the columns with the efforts of a kind."""
    names = content.actuators.names_of(kind)
    return f"{kind.effort.words} [{kind.effort.unit}]", names, len(names)


def _add_plot(gui: Any, title: str, names: Sequence[str]) -> Any:
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
