"""Panels of curves, drawn as small multiples in one picture."""

import io
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from taichisoft.optional_packages import require

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
"""Colours of the bodies, in turn: the palette of Okabe and Ito, which the colour-blind can distinguish."""
NEUTRAL = "#404040"
LINE_STYLES = ("-", "--", ":", "-.")
"""Styles of the curves of one colour in a panel, in turn."""

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


def draw_figure(panels: Sequence[Panel], bodies: Sequence[str], columns: int = COLUMNS) -> "Figure":
    """A figure with all panels, in rows of so many columns; `bodies` get their colours in this order."""
    require("a plot", "matplotlib")
    import matplotlib
    from matplotlib.figure import Figure

    colours = {body: COLOURS[index % len(COLOURS)] for index, body in enumerate(bodies)}
    with matplotlib.rc_context(_style()):
        columns = min(columns, len(panels))
        rows = -(-len(panels) // columns)
        figure = Figure(figsize=(columns * PANEL_SIZE[0], rows * PANEL_SIZE[1]), layout="constrained")
        figure.get_layout_engine().set(w_pad=0.1, h_pad=0.04)  # type: ignore[union-attr, call-arg]
        grid = figure.subplots(rows, columns, squeeze=False)
        for axes, panel in zip(grid.flat, panels, strict=False):
            _draw_panel(axes, panel, colours)
        for axes in grid.flat[len(panels) :]:
            axes.set_visible(False)
    return figure


def figure_bytes(figure: "Figure", format: str) -> bytes:
    """The figure as a "png" or "svg" file; equal figures give equal bytes."""
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
    seen: dict[str, int] = {}
    for index, (curve, labels) in enumerate(drawn):
        colour = colours.get(curve.body, NEUTRAL)
        style = LINE_STYLES[seen.get(colour, 0) % len(LINE_STYLES)]
        seen[colour] = seen.get(colour, 0) + 1
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
    """Put the legend above the axes, where it hides nothing."""
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


def _equal(one: np.ndarray, other: np.ndarray) -> bool:
    return bool(one.shape == other.shape and np.allclose(one, other, rtol=1e-9, atol=0.0, equal_nan=True))
