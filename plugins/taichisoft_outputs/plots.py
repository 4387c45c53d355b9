"""The curves of a run: one small panel for each quantity, made from the recording's columns."""

import csv
import io
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import pairwise, zip_longest
from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft.base import extra, printable, require
from taichisoft.control import AIR_NODES, AIR_PARTS, BASE, FIGURES, PAIRS, Figure, text_of
from taichisoft.errors import TaichisoftError
from taichisoft.mechanics import ACTUATOR_KINDS, StateFigure, Stretches
from taichisoft_outputs.recording.reader import Recording, recorded_fingertips, tip_state
from taichisoft_outputs.run_figures import last_at_rest
from taichisoft_outputs.stress import COMPONENTS, StressLine

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Picture

# Panels of curves, drawn as small multiples in one picture.

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
"""Colours of the bodies, in turn: the palette of Okabe and Ito, which the colour-blind can distinguish."""
NEUTRAL = "#404040"
LINE_STYLES = ("-", "--", ":", "-.")
"""Styles of the curves of one colour in a panel, in turn."""
DASHES: Sequence[Any] = ("-", (0, (6, 6)), (0, (3, 9)))
"""Styles of curves that lie on each other, in turn: each leaves parts of those before it to be seen."""
NEAR = 0.015
"""Largest distance of curves that lie on each other, over the height of all curves of a panel [-]."""

COLUMNS = 2
PANEL_SIZE = (5.6, 2.9)  # inches
LEGEND_CHARACTERS = 76
"""Most characters that stand beside each other above a panel."""

NOISE = {"mm": 1e-3, "mN": 0.1, "mN mm": 1.0, "kPa": 1e-3, "degrees": 1e-3, "cm³": 1e-5, "mg": 1e-4, "mg/s": 1e-3}
"""By unit, what no curve shows as a signal: a panel whose values differ by less has a flat line."""

EARLIER_START = 0.3
"""Opacity of what happened before the last start of the run."""


@dataclass(frozen=True)
class PlotCurve:
    """A line.

    Attributes:
        label: name of the line in the legend.
        body: name of the body whose colour it has; "" for a line of no body.
        x, y: points, each of shape (count,); NaN leaves a gap.
        time: time of each point [s]; where it goes back, the run was restarted.
    """

    label: str
    body: str
    x: np.ndarray
    y: np.ndarray
    time: np.ndarray


@dataclass(frozen=True)
class Panel:
    """Axes with curves.

    Attributes:
        x_axis, y_axis: names of the axes, with units.
        curves: the lines.
        equal_scales: whether both axes have the same scale, as paths need it.
        logarithmic: whether the vertical axis is logarithmic.
        level: height and label of a horizontal line; None for no such line.
    """

    x_axis: str
    y_axis: str
    curves: list[PlotCurve]
    equal_scales: bool = False
    logarithmic: bool = False
    level: tuple[float, str] | None = None


def pieces(time: np.ndarray) -> list[tuple[int, int]]:
    """First and last+1 index of each part in which the time does not go back."""
    return list(pairwise([0, *(np.flatnonzero(np.diff(time) < 0.0) + 1).tolist(), len(time)]))


def draw_figure(panels: Sequence[Panel], bodies: Sequence[str], columns: int = COLUMNS) -> "Picture":
    """A picture with all panels, in rows of so many columns; `bodies` get their colours in this order."""
    require("a plot", "matplotlib")
    import matplotlib
    from matplotlib.figure import Figure as Picture

    colours = {body: COLOURS[index % len(COLOURS)] for index, body in enumerate(bodies)}
    with matplotlib.rc_context(_style()):
        columns = min(columns, len(panels))
        rows = -(-len(panels) // columns)
        figure = Picture(figsize=(columns * PANEL_SIZE[0], rows * PANEL_SIZE[1]), layout="constrained")
        figure.get_layout_engine().set(w_pad=0.1, h_pad=0.04)  # type: ignore[union-attr, call-arg]
        grid = figure.subplots(rows, columns, squeeze=False)
        for axes, panel in zip(grid.flat, panels, strict=False):
            _draw_panel(axes, panel, colours)
        for axes in grid.flat[len(panels) :]:
            axes.set_visible(False)
    return figure


def figure_bytes(figure: "Picture", format: str) -> bytes:
    """The picture as a "png" or "svg" file; equal figures give equal bytes."""
    import matplotlib

    target = io.BytesIO()
    metadata = {"Date": None, "Creator": None} if format == "svg" else {"Software": None}
    with matplotlib.rc_context(_style()):
        figure.savefig(target, format=format, dpi=130, metadata=metadata)
    return target.getvalue()


def _style() -> Any:
    """Settings that leave text of SVG as text and fix its identities: small files that change only with the figures."""
    return {
        "svg.fonttype": "none",
        "svg.hashsalt": "taichisoft",
        "font.size": 9.0,
        "axes.axisbelow": True,
        "text.parse_math": False,  # a $ in a name is a $
    }


def _draw_panel(axes: "Axes", panel: Panel, colours: dict[str, str]) -> None:
    drawn = _without_doubles(panel.curves)
    values = np.concatenate([curve.y[np.isfinite(curve.y)] for curve in panel.curves] or [np.zeros(1)])
    near = NEAR * float(np.ptp(values)) if len(values) else 0.0
    seen: dict[str, int] = {}
    for index, (curve, labels) in enumerate(drawn):
        colour = colours.get(curve.body, NEUTRAL)
        style = LINE_STYLES[seen.get(colour, 0) % len(LINE_STYLES)]
        seen[colour] = seen.get(colour, 0) + 1
        below = sum(_equal(curve.x, one.x) and _equal(curve.y, one.y, near) for one, _ in drawn[:index])
        if below:
            style = DASHES[below % len(DASHES)]
        # Curves that nearly coincide show as nested lines.
        width = 1.2 + 1.0 * (len(drawn) - 1 - index) / max(len(drawn) - 1, 1)
        _draw_curve(axes, curve, ", ".join(labels), panel.equal_scales, color=colour, linestyle=style, linewidth=width)
    if panel.level is not None:
        axes.axhline(panel.level[0], color=NEUTRAL, linestyle=":", linewidth=1.0, label=panel.level[1])
    if panel.logarithmic:
        _make_logarithmic(axes)
    else:
        _show_no_noise(axes, panel)
    if panel.equal_scales:
        axes.set_aspect("equal", adjustable="datalim")
    else:  # the whole time also where a curve begins later
        places = np.concatenate([curve.x[np.isfinite(curve.x)] for curve in panel.curves] or [np.zeros(1)])
        low, high = _ends(places, panel.x_axis)
        margin = 0.01 * (high - low) or 1.0
        axes.set_xlim(low - margin, high + margin)
    axes.set_xlabel(panel.x_axis)
    axes.set_ylabel(panel.y_axis)
    axes.grid(alpha=0.3, linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    _add_legend(axes)


def _draw_curve(axes: "Axes", curve: PlotCurve, label: str, marked: bool, **look: Any) -> None:
    """Draw each start by itself, so that no line runs back; a path has a dot where its last start was."""
    parts = pieces(curve.time)
    for start, end in parts:
        last = end == len(curve.time)
        opacity = 1.0 if last else EARLIER_START
        x, y = curve.x[start:end], curve.y[start:end]
        marker = "." if len(x) == 1 else None  # a line of one point is invisible
        axes.plot(x, y, label=label if last else None, alpha=opacity, marker=marker, **look)
        if last and marked and len(x):
            axes.plot(x[:1], y[:1], marker="o", markersize=5, color=look["color"])


def _show_no_noise(axes: "Axes", panel: Panel) -> None:
    """Let the vertical axis reach so far that noise of the solver is a line; numbers stand whole at their ticks.

    By itself matplotlib takes out a common exponent or offset and prints it over the legend.
    """
    from matplotlib.ticker import FuncFormatter

    values = np.concatenate([curve.y[np.isfinite(curve.y)] for curve in panel.curves] or [np.zeros(0)])
    if len(values):
        low, high = _ends(values, panel.y_axis)
        if (low, high) != (values.min(), values.max()):
            axes.set_ylim(low, high)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{round(value, 12) + 0.0:.6g}"))


def _ends(values: np.ndarray, axis: str) -> tuple[float, float]:
    """The least and the greatest value, or a range around them that is wide enough for noise to be unseen."""
    low, high = float(values.min()), float(values.max())
    unit = axis.rpartition("[")[2].rstrip("]")
    least = max(NOISE.get(unit, 0.0), 1e-6 * max(abs(low), abs(high)))
    if high - low >= least:
        return low, high
    middle = (low + high) / 2
    return middle - 5 * least, middle + 5 * least


def _make_logarithmic(axes: "Axes") -> None:
    """Put ticks at 1, 2, 5, 10 and so on, as plain numbers: the range is often less than a factor of ten."""
    from matplotlib.ticker import FormatStrFormatter, LogLocator, NullLocator

    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(FormatStrFormatter("%g"))
    axes.yaxis.set_minor_locator(NullLocator())


def _add_legend(axes: "Axes") -> None:
    handles, labels = axes.get_legend_handles_labels()
    if labels:
        columns = max(1, min(len(labels), LEGEND_CHARACTERS // (max(map(len, labels)) + 6)))
        axes.legend(
            handles,
            labels,
            loc="lower left",
            bbox_to_anchor=(0.0, 1.0),
            ncols=columns,
            frameon=False,
            borderaxespad=0.2,
            fontsize=8,
            handlelength=1.6,
            columnspacing=1.4,
        )


def _without_doubles(curves: Sequence[PlotCurve]) -> list[tuple[PlotCurve, list[str]]]:
    """The different curves, each with the labels of all that are equal to it: only one of them would be seen."""
    groups: list[tuple[PlotCurve, list[str]]] = []
    for curve in curves:
        for first, labels in groups:
            if _equal(curve.x, first.x) and _equal(curve.y, first.y):
                labels.append(curve.label)
                break
        else:
            groups.append((curve, [curve.label]))
    return groups


def _equal(one: np.ndarray, other: np.ndarray, least: float = 0.0) -> bool:
    return bool(one.shape == other.shape and np.allclose(one, other, rtol=1e-9, atol=least, equal_nan=True))


TIME_AXIS = "time [s]"
STRETCH_INSTANTS = 100
"""Most instants of a long run whose elements are looked at, evenly spaced."""
TIP_INSTANTS = 600
"""Most instants of a long run whose fingertips are looked at, evenly spaced: each takes reading all positions."""


class RunCurves:
    """Makes the panels of a recording.

    Attributes:
        times: times of its instants [s], shape (instant_count,).
        objects: names of the rigid bodies that no frame carries.
        object_columns: their numbers among all rigid bodies.
    """

    def __init__(self, recording: Recording):
        """Prepare; tips are read when a panel needs them."""
        self.recording = recording
        self.times = recording.times
        self.objects = recording.scene.objects
        self.object_columns = [list(recording.scene.rigid_bodies).index(name) for name in self.objects]

    @cached_property
    def tips(self) -> tuple[Sequence[str], np.ndarray, np.ndarray, np.ndarray]:
        """Tips of the fingers in up to TIP_INSTANTS instants, as a controller would have observed them.

        Names of the fingers, and of shape (count, ...): times [s], positions [mm] of each finger, bending angles [rad].
        """
        observer = recorded_fingertips(self.recording, self.recording.soft_bodies)
        instants = _evenly_spaced(self.times, TIP_INSTANTS)
        observed = [observer.observe(tip_state(self.recording, instant)) for instant in instants]
        positions, _, bending_angles = (np.array(values) for values in zip(*observed, strict=True))
        return observer.names, self.times[instants], positions, bending_angles

    @cached_property
    def sideways(self) -> tuple[tuple[str, np.ndarray], tuple[str, np.ndarray]]:
        """Names and directions of two horizontal axes."""
        up = self.recording.scene.up
        if np.isclose(np.abs(up).max(), 1.0):
            vertical = int(np.argmax(np.abs(up)))
            first, second = ((vertical + 1) % 3, (vertical + 2) % 3)
            return ("xyz"[first], np.eye(3)[first]), ("xyz"[second], np.eye(3)[second])
        across, along = np.linalg.svd(up[None])[2][1:]
        return ("across", across), ("along", along)

    def over_time(self, y_axis: str, values: np.ndarray, names: Sequence[str], bodies: Sequence[str]) -> Panel:
        """A panel of columns (frame_count, len(names)); a recording without such bodies may have an empty one more."""
        curves = [
            PlotCurve(name, body, self.times, values[:, column], self.times)
            for column, (name, body) in enumerate(zip(names, bodies, strict=True))
        ]
        return Panel(TIME_AXIS, y_axis, curves)


def _of_figure(figure: Figure, run: RunCurves) -> Panel:
    """A figure of the actuators of a kind, of pairs that ever touched, of the base, or the amount of that of frames."""
    names, values = run.recording.figure(figure, np.arange(len(run.times)))
    if figure.per is BASE:
        return run.over_time(figure.drawn, values[:, 0], figure.axes, [""] * 3)
    if figure.axes:
        return run.over_time(figure.drawn, np.linalg.norm(values, axis=2), names, [""] * len(names))
    if figure.per is PAIRS:
        touching = np.flatnonzero(values.any(axis=0))
        names, values = [names[index] for index in touching.tolist()], values[:, touching]
        return run.over_time(figure.drawn, values, [*map(text_of, names)], [first for first, _ in names])
    return run.over_time(figure.drawn, figure.factor * values, names, [name.partition(".")[0] for name in names])


def _over_tips(run: RunCurves, y_axis: str, values: np.ndarray) -> Panel:
    names, times, _, _ = run.tips
    curves = [PlotCurve(name, name, times, of_tip, times) for name, of_tip in zip(names, values.T, strict=True)]
    return Panel(TIME_AXIS, y_axis, curves)


def bending(run: RunCurves) -> Panel:
    """Angles by which the tips have turned against the base."""
    return _over_tips(run, "bending angle [degrees]", np.degrees(run.tips[3]))


def _tip(axis: int, run: RunCurves) -> Panel:
    return _over_tips(run, f"{'xyz'[axis]} of the tip [mm]", run.tips[2][..., axis])


def against(x: Panel, y: Panel) -> Panel:
    """One panel over time against another: each curve over that of the same body, or over the only one.

    Args:
        x, y: panels over time; where they have different times, x is interpolated.
    """
    curves = []
    for curve in y.curves:
        own = [one for one in x.curves if one.body == curve.body] or (x.curves if len(x.curves) == 1 else [])
        for one in own:
            over = one.y
            if not np.array_equal(one.time, curve.time):
                over = np.interp(_clock(curve.time), _clock(one.time), one.y)
            label = curve.label if len(own) == 1 else f"{curve.label} over {one.label}"
            curves.append(PlotCurve(label, curve.body, over, curve.y, curve.time))
    return Panel(x.y_axis, y.y_axis, curves)


def _clock(time: np.ndarray) -> np.ndarray:
    """Times [s] that go on over new starts, so that they only rise."""
    return np.concatenate([[0.0], np.cumsum(np.where(np.diff(time) < 0.0, 1e-9, np.diff(time)))])


def stretch(run: RunCurves) -> Panel:
    """Largest principal stretches of the soft bodies, in up to STRETCH_INSTANTS instants."""
    instants = _evenly_spaced(run.times, STRETCH_INSTANTS)
    rows = [run.recording.row("position", int(instant)) for instant in instants]
    curves = []
    for body in run.recording.soft_bodies:
        stretches = Stretches(body.rest_position, body.elements)
        largest = np.array([stretches.largest(row[body.nodes]).max() for row in rows])
        curves.append(PlotCurve(body.name, body.name, run.times[instants], largest, run.times[instants]))
    return Panel(TIME_AXIS, "largest stretch [-]", curves)


def height(run: RunCurves) -> Panel:
    """Heights of objects and base over those of the moment before the base moves, as in metrics.json."""
    names, up = run.objects, run.recording.scene.up
    levels = run.recording.column("rigid_position") @ up
    rises = [_since_rest(run, levels[:, body]) for body in run.object_columns]
    base = _since_rest(run, run.recording.base_translation @ up)
    if not names and not base.any():
        base = np.full_like(base, np.nan)  # nothing rises, so there is nothing to see
    return run.over_time("risen by [mm]", np.column_stack([*rises, base]), [*names, "base"], [*names, ""])


def slip(run: RunCurves) -> Panel:
    """How far objects have slid down the fingers since the moment before the base moves, as in metrics.json."""
    base, names = run.recording.base_translation, run.objects
    slide = (-run.recording.column("slide") @ run.recording.scene.up)[:, run.object_columns]
    behind = np.full((len(run.times), len(names)), np.nan)
    for start, end in pieces(run.times):
        rest = last_at_rest(base[start:end])
        if rest is not None:
            before = start + rest
            behind[before:end] = np.cumsum(slide[before:end], axis=0) - slide[before]
    return run.over_time("slip against the fingers [mm]", behind, names, names)


def _tips_side(run: RunCurves) -> Panel:
    (name, direction), _ = run.sideways
    return _paths(run, name, direction, "height", run.recording.scene.up)


def _tips_above(run: RunCurves) -> Panel:
    (first, along), (second, across) = run.sideways
    return _paths(run, first, along, second, across)


def step_time(run: RunCurves) -> Panel:
    """Time that each step took to compute, beside the time that it simulated."""
    values = 1e3 * np.where(run.recording.column("step_time") > 0.0, run.recording.column("step_time"), np.nan)
    every = run.recording.every
    label = "each step" if every == 1 else f"mean of {every} steps"
    curves = [PlotCurve(label, "", run.times, values, run.times)]
    level = (1e3 * run.recording.step_size, "real time")
    return Panel(TIME_AXIS, "time per step [ms]", curves, logarithmic=True, level=level)


def _signal(column: int, run: RunCurves) -> Panel:
    """A signal of the controller, in its own unit."""
    name = run.recording.signals[column]
    return run.over_time(f"signal {name}", run.recording.column("signals")[:, [column]], [name], [""])


def panel_name(figure: Figure) -> str:
    """The name of the panel of a figure."""
    other = {"peak_pressure": "contact-pressure"}
    return figure.name if figure.per.kind else other.get(figure.name, figure.name.replace("_", "-"))


def _panels(is_one: Callable[[Figure], Any]) -> dict[str, Callable[[RunCurves], Panel]]:
    chosen = [figure for figure in FIGURES if figure.drawn and is_one(figure)]
    return {panel_name(figure): partial(_of_figure, figure) for figure in chosen}


PANELS: dict[str, Callable[[RunCurves], Panel]] = {
    **_panels(lambda figure: figure.per.kind),
    "bending": bending,
    "tip-x": partial(_tip, 0),
    "tip-y": partial(_tip, 1),
    "tip-z": partial(_tip, 2),
    "stretch": stretch,
    "height": height,
    "tips-side": _tips_side,
    "tips-above": _tips_above,
    **_panels(lambda figure: figure.per in (AIR_NODES, AIR_PARTS)),
    **_panels(lambda figure: figure.per is PAIRS),
    "slip": slip,
    **_panels(lambda figure: figure.axes),
    "step-time": step_time,
}
"""The functions that make the panels, by name."""


def panels_of(recording: Recording) -> dict[str, Callable[[RunCurves], Panel]]:
    """PANELS, and a panel "signal NAME" for each signal of the controller."""
    return PANELS | {f"signal {name}": partial(_signal, column) for column, name in enumerate(recording.signals)}


def expected(name: str, recording: Recording) -> bool:
    """Whether somebody expects a panel: that of cables, frames or networks only where there are some, of air with its
    own law.

    Coordinates of tips are there for other axes than time; two panels show the paths.
    """
    if name in ("tip-x", "tip-y", "tip-z"):
        return False
    for kind in ACTUATOR_KINDS:
        tables = recording.scene.actuators(kind.plural).values()
        for figure in kind.measured:
            if figure.name == name:
                matters = figure.matters if isinstance(figure, StateFigure) else bool
                return (kind.always_driven and figure not in kind.figures) or any(map(matters, tables))
    if name in ("network-pressure", "network-flow"):
        return bool(recording.scene.air.parts)
    return name != "frame-force" or bool(recording.scene.frames)


def _evenly_spaced(times: np.ndarray, count: int) -> np.ndarray:
    """Indices of at most `count` instants from the first to the last."""
    return np.unique(np.linspace(0, len(times) - 1, count).astype(int))


def _since_rest(run: RunCurves, level: np.ndarray) -> np.ndarray:
    """Heights (instant_count,) above that before the base moves, in each start of the run."""
    base = run.recording.base_translation
    starts = [(start, end, last_at_rest(base[start:end]) or 0) for start, end in pieces(run.times)]
    return np.concatenate([level[start:end] - level[start + rest] for start, end, rest in starts])


def _paths(run: RunCurves, x_name: str, x_axis: np.ndarray, y_name: str, y_axis: np.ndarray) -> Panel:
    names, times, positions, _ = run.tips
    curves = [
        PlotCurve(name, name, path @ x_axis, path @ y_axis, times)
        for name, path in zip(names, positions.swapaxes(0, 1), strict=True)
    ]
    return Panel(f"{x_name} of the tips [mm]", f"{y_name} of the tips [mm]", curves, equal_scales=True)


# Plots of a run: all panels for which its recording has something to draw, in one picture.

FORMATS = ("png", "svg", "csv", "xlsx")
LONGEST_NAME = 28
"""Characters of the name of a sheet, of 31 that a spreadsheet takes: three may number equal ones."""


class PlotError(TaichisoftError):
    """A run cannot be plotted as asked."""


@dataclass(frozen=True)
class Plots:
    """The plots of a run.

    Attributes:
        files: content of the file, in the format that was asked for; or of one for each column.
        shown: names of the panels in it.
        left_out: names of the panels without data in this run; panels of cables are listed only where the run has
            cables, or where they were chosen.
    """

    files: tuple[bytes, ...]
    shown: tuple[str, ...]
    left_out: tuple[str, ...]


def draw_plots(
    recording: Recording,
    format: str,
    only: Sequence[str] | None = None,
    over: str | None = None,
    columns_apart: bool = False,
) -> Plots:
    """Draw the panels called `only`, or all that there is something for; over time, or over the panel called `over`.

    With `columns_apart` each column is a picture of its own, so that a narrow page can put one below the other.
    """
    known = panels_of(recording)
    for option, name in [("--only" if over is None else "--y", name) for name in only or ()] + [("--x", over)] * (
        over is not None
    ):
        if name not in known:
            raise PlotError(f"{option} {name}: there are: {', '.join(known)}")
    run = RunCurves(recording)
    names = only or [name for name in known if expected(name, recording)]
    made = {name: known[name](run) for name in names}
    if over is not None:
        across = known[over](run)
        for name, panel in {over: across, **made}.items():
            if panel.equal_scales:
                raise PlotError(f"{name} is a path, not a figure over time; take tip-x, tip-y or tip-z")
        made = {name: against(across, panel) for name, panel in made.items()}
    panels = {
        name: replace(panel, curves=[curve for curve in panel.curves if np.isfinite(curve.y).any()])
        for name, panel in made.items()
    }
    left_out = tuple(name for name, panel in panels.items() if not panel.curves)
    shown = {name: panel for name, panel in panels.items() if panel.curves}
    if not shown:
        raise PlotError(f"{recording.path}: nothing to plot: this run has nothing of {', '.join(left_out)}")
    bodies = [*recording.scene.soft_bodies, *recording.scene.rigid_bodies]
    return Plots(files_of(shown, bodies, format, columns_apart), tuple(shown), left_out)


def files_of(
    panels: Mapping[str, Panel], bodies: Sequence[str], format: str, columns_apart: bool = False
) -> tuple[bytes, ...]:
    """Content of the file with panels by name, or with `columns_apart` of a picture for each column."""
    if format not in FORMATS:
        raise PlotError(f"--format {format}: there are: {', '.join(FORMATS)}")
    if format == "xlsx":
        return (_workbook(panels),)
    if format == "csv":
        table = io.StringIO(newline="")
        for row in _rows(panels.values()):
            shown = [f"{round(one, 9) + 0.0:.9g}" if isinstance(one, float) else one for one in row]
            csv.writer(table).writerow(shown)
        return (table.getvalue().encode(),)
    drawn = list(panels.values())
    columns = [drawn[one::COLUMNS] for one in range(min(COLUMNS, len(drawn)))] if columns_apart else [drawn]
    figures = [draw_figure(one, bodies, 1 if columns_apart else COLUMNS) for one in columns]
    return tuple(figure_bytes(figure, format) for figure in figures)


def _workbook(panels: Mapping[str, Panel]) -> bytes:
    require("--format xlsx", "openpyxl", install=extra("xlsx"))
    from openpyxl import Workbook

    book, target = Workbook(write_only=True), io.BytesIO()
    for name, panel in panels.items():
        sheet = book.create_sheet(re.sub(r"[\[\]:*?/\\]", "-", printable(name))[:LONGEST_NAME])
        for row in _rows([panel]):
            sheet.append(row)
    book.save(target)
    return target.getvalue()


def _rows(panels: Iterable[Panel]) -> Iterator[list[Any]]:
    """The curves in columns with titles, those over the same values behind these; None where there is no value."""
    columns: list[list[Any]] = []
    over = None
    for panel in panels:
        for curve in panel.curves:
            if over is None or not np.array_equal(curve.x, over, equal_nan=True):
                over = curve.x
                columns.append([panel.x_axis, *over.tolist()])
            columns.append([printable(f"{panel.y_axis}, {curve.label}"), *curve.y.tolist()])
    for row in zip_longest(*columns):
        yield [None if value is None or value != value else value for value in row]


def line_panels(line: StressLine) -> dict[str, Panel]:
    """Stress along a line over the distance, in a colour for each instant."""
    panels: dict[str, Panel] = {}
    for name, values in line.figures().items():
        group = name if name not in COMPONENTS else "normal" if name[0] == name[1] else "shear"
        panel = panels.setdefault(group, Panel("distance along the line at rest [mm]", f"{group} stress [kPa]", []))
        for time, stress in zip(line.times, values, strict=True):
            at, always = f"{time:g} s", np.full(len(stress), time)
            panel.curves.append(PlotCurve(at if group == name else f"{name}, {at}", at, line.along, stress, always))
    return panels
