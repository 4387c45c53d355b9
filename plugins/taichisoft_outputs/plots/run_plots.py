"""Plots of a run: all panels for which its recording has something to draw, in one picture."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from taichisoft.errors import TaichisoftError
from taichisoft_outputs.plots.figure import COLUMNS, Panel, draw_figure, figure_bytes
from taichisoft_outputs.plots.panels import RunCurves, against, expected, panels_of
from taichisoft_outputs.recording.reader import Recording

FORMATS = ("png", "svg")


class PlotError(TaichisoftError):
    """A run cannot be plotted as asked."""


@dataclass(frozen=True)
class Plots:
    """The plots of a run.

    Attributes:
        pictures: content of the file, in the format that was asked for; or of one for each column.
        shown: names of the panels in it.
        left_out: names of the panels without data in this run; panels of cables are listed only where the run has
            cables, or where they were chosen.
    """

    pictures: tuple[bytes, ...]
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

    Raises:
        PlotError: the format or panel is unknown, or nothing is to be drawn.
    """
    if format not in FORMATS:
        raise PlotError(f"--format {format}: there are: {', '.join(FORMATS)}")
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
    panels = {name: _with_something_in_it(panel) for name, panel in made.items()}
    left_out = tuple(name for name, panel in panels.items() if not panel.curves)
    shown = {name: panel for name, panel in panels.items() if panel.curves}
    if not shown:
        raise PlotError(f"{recording.path}: nothing to plot: this run has nothing of {', '.join(left_out)}")
    drawn, bodies = list(shown.values()), _bodies(recording)
    if columns_apart:
        figures = [draw_figure(drawn[one::COLUMNS], bodies, 1) for one in range(min(COLUMNS, len(drawn)))]
    else:
        figures = [draw_figure(drawn, bodies)]
    return Plots(tuple(figure_bytes(figure, format) for figure in figures), tuple(shown), left_out)


def _with_something_in_it(panel: Panel) -> Panel:
    """The panel without curves that have no finite value."""
    return replace(panel, curves=[curve for curve in panel.curves if np.isfinite(curve.y).any()])


def _bodies(recording: Recording) -> list[str]:
    """Names of the bodies with colours of their own."""
    return [*recording.scene.soft_bodies, *recording.scene.rigid_bodies]
