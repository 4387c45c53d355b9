"""Plots of a run: which panels its recording has something for, in one picture."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from taichisoft.errors import TaichisoftError
from taichisoft_plugins.plots.curve import Panel
from taichisoft_plugins.plots.figure import draw_figure, figure_bytes
from taichisoft_plugins.plots.panels import PANELS, RunCurves
from taichisoft_plugins.recording.layout import RecordingError
from taichisoft_plugins.recording.reader import Recording

FORMATS = ("png", "svg")


class PlotError(TaichisoftError):
    """A run cannot be plotted as asked."""


@dataclass(frozen=True)
class Plots:
    """The plots of a run.

    Attributes:
        picture: the file's content, in the format that was asked for.
        shown: names of the panels in it.
        left_out: reasons by the names of those that are not.
    """

    picture: bytes
    shown: tuple[str, ...]
    left_out: dict[str, str]


def draw_plots(recording: Recording, format: str, only: Sequence[str] | None = None) -> Plots:
    """Draw the panels called `only`, or all that there is something for.

    Raises:
        PlotError: there is no such format or panel, or nothing to draw.
        RecordingError: the recording lacks what a panel needs that was asked for by name.
    """
    if format not in FORMATS:
        raise PlotError(f"--format {format}: there are: {', '.join(FORMATS)}")
    for name in only or ():
        if name not in PANELS:
            raise PlotError(f"--only {name}: there are: {', '.join(PANELS)}")
    if recording.frame_count == 0:
        raise PlotError(f"{recording.path}: has no frame; the run ended before the first one was written")
    run = RunCurves(recording)
    panels: dict[str, Panel] = {}
    left_out: dict[str, str] = {}
    for name in only or PANELS:
        try:
            panel = _with_something_in_it(PANELS[name](run))
        except RecordingError as error:
            if only:
                raise
            left_out[name] = str(error)
            continue
        if panel.curves:
            panels[name] = panel
        else:
            left_out[name] = "nothing of the kind in this run"
    if not panels:
        raise PlotError(f"{recording.path}: nothing to plot: {'; '.join(f'{n}: {why}' for n, why in left_out.items())}")
    figure = draw_figure(list(panels.values()), _bodies(recording))
    return Plots(figure_bytes(figure, format), tuple(panels), left_out)


def _with_something_in_it(panel: Panel) -> Panel:
    return replace(panel, curves=[curve for curve in panel.curves if np.isfinite(curve.y).any()])


def _bodies(recording: Recording) -> list[str]:
    """Bodies with colours of their own."""
    return [surface.name for surface in recording.surfaces if surface.kind in ("soft", "rigid")]
