"""The plots of a page: efforts of actuators, forces on the main object, and its height over time."""

from collections.abc import Iterable, Mapping, Sequence
from itertools import cycle
from typing import Any

import numpy as np

from taichisoft import Scene
from taichisoft.control import FIGURES, PAIRS, In
from taichisoft.mechanics import ACTUATOR_KINDS, ActuatorKind
from taichisoft_outputs.web.page_messages import PageInstant, PageScene

WINDOW = 20.0
"""The plots of a run show its last seconds [s]."""
MOST_POINTS = 300
"""Most points that are drawn at once."""

DECIMALS = 4
"""What figures are rounded to: a plot of something at rest would show its round-off, as large as its frame."""

LABEL_WIDTH = 64
"""Width of the numbers beside a plot [pixels]: room for "-100,000"."""

TICKS_APART = 15
"""Least distance of the numbers beside a plot [pixels]: the usual 30 leaves but one, and 20 in a narrow window."""

AXES = "#888888"
"""Colour of axes, which is seen on a light and on a dark page."""
DASHES = ((), (8.0, 8.0), (4.0, 12.0))
"""Lengths of lines and gaps [pixels], in turn: of equal curves each leaves parts of those before it to be seen."""
LINES = ("#0077bb", "#ee7733", "#009988", "#cc3311", "#33bbee", "#ee3377", "#999933", "#555555")

ON_PAGE = [figure for figure in FIGURES if In.PAGE in figure.recorded]
"""Figures of the base, and of soft bodies and the main object."""


def plotted_row(
    scene: Scene,
    efforts: np.ndarray,
    figures: Mapping[str, tuple[Sequence[Any], np.ndarray]],
    rigid_position: np.ndarray,
) -> np.ndarray:
    """The figures that are plotted at one time, in a row, or in a row for each of several times.

    Args:
        scene: the scene of the run.
        efforts: of all actuators: pressures [kPa], tensions at pulled ends [mN], shape (..., actuator_count).
        figures: names and values of the figures of `ON_PAGE`, see `Recording.figure`.
        rigid_position: centres of mass [mm], shape (..., rigid_count, 3).

    Returns:
        Efforts, figures of the base and of each soft body on the main object, and the height of the object [mm].
    """
    shown, times = scene.main_object, rigid_position.shape[:-2]
    columns, nothing = [efforts], np.zeros((*times, 1))
    for figure in ON_PAGE:
        names, values = figures[figure.name]
        if figure.per is PAIRS:
            places = {frozenset(pair): number for number, pair in enumerate(names)}
            numbers = [places.get(frozenset((body, shown))) for body in scene.soft_bodies]
            columns += [nothing if number is None else values[..., [number]] for number in numbers]
        else:
            columns.append(values.reshape(*times, -1))
    bodies = list(scene.rigid_bodies)
    columns.append(nothing if shown is None else rigid_position[..., [bodies.index(shown)], :] @ scene.up)
    return np.concatenate(columns, axis=-1)


class History:
    """What the plots show of the last instants since the last start.

    Attributes:
        times: times of the instants that are kept [s].
        rows: their rows of `plotted_row`, with heights over that of the first instant of all.
        signals: values of each signal of the controller in these instants, NaN where it had none.
    """

    def __init__(self, first: PageInstant):
        """Begin without any instant; heights are counted from that in `first`."""
        self._start = first.plotted[-1]
        self._clear()

    def _clear(self) -> None:
        self.times: list[float] = []
        self.rows: list[np.ndarray] = []
        self.signals: dict[str, list[float]] = {}

    def add(self, instant: PageInstant) -> None:
        """Add an instant; an earlier time than the last clears the plots, and the same time is ignored."""
        if self.times and instant.time < self.times[-1]:
            self._clear()
        if self.times and instant.time == self.times[-1]:
            return
        row = instant.plotted.copy()
        row[-1] -= self._start
        # The newest point always shows; it gives way to the next if it is too near to the one before.
        if len(self.times) > 1 and self.times[-1] - self.times[-2] < WINDOW / MOST_POINTS:
            self._remove(-1)
        self.times.append(instant.time)
        self.rows.append(row)
        for name in dict.fromkeys((*self.signals, *instant.signals)):
            values = self.signals.setdefault(name, [np.nan] * (len(self.times) - 1))
            values.append(instant.signals.get(name, np.nan))
        while self.times[-1] - self.times[0] > WINDOW:
            self._remove(0)

    def _remove(self, index: int) -> None:
        del self.times[index], self.rows[index]
        for values in self.signals.values():
            del values[index]


class Curves:
    """Plots in the panel of a page; plots without data are left out."""

    def __init__(self, gui: Any, content: PageScene):
        """Add empty plots to a panel of viser."""
        shown, soft = content.scene.main_object, tuple(content.scene.soft_bodies)
        self._gui, self._folder = gui, None  # type: Any, Any
        self._signals: dict[str, Any] = {}
        start, self._plots = 0, []
        pressing = soft if shown is not None else ()
        is_carried = any(body.anchors for body in content.scene.soft_bodies.values())
        groups: Iterable[tuple[str, Sequence[str], int]] = (
            *(_group(content, kind) for kind in ACTUATOR_KINDS),
            *(
                (figure.drawn.replace(" [", f" on {shown} ["), pressing, len(soft))
                if figure.per is PAIRS
                else (figure.drawn, tuple(figure.axes) if is_carried else (), 3)
                for figure in ON_PAGE
            ),
            (f"{shown} lifted by [mm]", (shown,) if shown is not None else (), 1),
        )
        for title, names, width in groups:
            if names:
                columns = slice(start, start + width)
                self._plots.append((columns, _add_plot(gui, title, names)))
            start += width

    def show(self, times: np.ndarray, rows: np.ndarray, signals: Mapping[str, Any] | None = None) -> None:
        """Draw rows of `plotted_row`, shape (count, columns), and signals over times [s], shape (count,)."""
        if len(times) < 2:
            return
        shown = np.round(rows.T, DECIMALS) + 0.0  # no -0
        for columns, plot in self._plots:
            plot.data = (times, *shown[columns])
        for name, values in (signals or {}).items():
            if name not in self._signals:
                if self._folder is None:
                    self._folder = self._gui.add_folder("signals", order=101.0)
                with self._folder:
                    self._signals[name] = _add_plot(self._gui, name, (name,))
            signal = np.array(values, float)
            is_there = np.isfinite(signal)  # a plot with NaN in it has no scale
            if is_there.sum() > 1:
                self._signals[name].data = (times[is_there], signal[is_there])


def _group(content: PageScene, kind: ActuatorKind) -> tuple[str, Sequence[str], int]:
    names = content.actuators.names_of(kind)
    return f"{kind.effort.words} [{kind.effort.unit}]", names, len(names)


def _add_plot(gui: Any, title: str, names: Sequence[str]) -> Any:
    from viser import uplot

    lines = [
        uplot.Series(label=name, stroke=colour, dash=dash, width=1.5, points={"show": False})
        for name, colour, dash in zip(names, cycle(LINES), cycle(DASHES), strict=False)
    ]
    nothing = np.zeros(2)
    grey: Any = {"stroke": AXES, "grid": {"stroke": f"{AXES}40", "width": 1}, "ticks": {"stroke": AXES, "width": 1}}
    return gui.add_uplot(
        data=(np.array([0.0, 1.0]), *(nothing for _ in names)),
        series=(uplot.Series(label="time [s]"), *lines),
        scales={"x": uplot.Scale(time=False, auto=True), "y": uplot.Scale(auto=True)},
        axes=(uplot.Axis(**grey), uplot.Axis(size=LABEL_WIDTH, space=TICKS_APART, **grey)),
        title=title,
        legend=uplot.Legend(show=len(names) > 1, live=False),
        aspect=1.9,
        padding=(12, 10, 0, 0),  # room for half of the highest number
    )
