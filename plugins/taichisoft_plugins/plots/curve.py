"""Curves and the panels that they stand in; `plots_panels` makes them, `plots_figure` draws them."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np


@dataclass(frozen=True)
class Curve:
    """A line.

    Attributes:
        label: its name in the legend.
        body: the body whose colour it has; "" for what belongs to none.
        x, y: its points, each of shape (count,); NaN leaves a gap.
        time: of the points [s]; where it goes back, the run was started anew.
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
        curves: what is drawn.
        equal_scales: a path, to be drawn with the same scale in both directions.
        logarithmic: of the vertical axis.
        level: a horizontal line with its label.
    """

    x_axis: str
    y_axis: str
    curves: list[Curve]
    equal_scales: bool = False
    logarithmic: bool = False
    level: tuple[float, str] | None = None


def pieces(time: np.ndarray) -> list[tuple[int, int]]:
    """First and last+1 index of each part in which the time does not go back."""
    return list(pairwise([0, *(np.flatnonzero(np.diff(time) < 0.0) + 1).tolist(), len(time)]))
