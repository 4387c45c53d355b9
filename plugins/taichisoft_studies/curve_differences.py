"""Curves of a run beside measured ones, row by row, and how their squares change with the curves of the run."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

OVER = "over"
"""The column of a run that its curves are drawn over; the others are named by their numbers, from "0" on."""


class Compared(NamedTuple):
    """Measured curves, as plain data that a job takes to its process.

    Attributes:
        over: what they are drawn over, (row_count,).
        curves: one after the other, (curve_count, row_count).
        scales: what differences are divided by, (curve_count,).
        relative: whether only changes since the first row count, (curve_count,).
    """

    over: Sequence[float]
    curves: Sequence[Sequence[float]]
    scales: Sequence[float]
    relative: Sequence[bool]


class CurveDifferences:
    """Scaled differences of the curves of a run from measured ones, between the run's steps by straight lines.

    Attributes:
        values: differences over their scales, shape (curve_count, row_count).
    """

    def __init__(self, columns: Mapping[str, np.ndarray], data: Compared):
        """Compare columns of a run, of which each has a value after each step, (step_count,)."""
        over = columns[OVER]
        rows = np.flatnonzero(np.append(np.diff(over) > 0.0, True))  # of values that are held the last, at rest
        place = np.clip(np.searchsorted(over[rows], data.over) - 1, 0, len(rows) - 2)
        self._columns, self._data, self._before, self._after = columns, data, rows[place], rows[place + 1]
        self._share = (np.array(data.over) - over[self._before]) / (over[self._after] - over[self._before])
        self.values = np.array([self._missed(number) for number in range(len(data.curves))])

    def _missed(self, number: int) -> np.ndarray:
        column = self._columns[str(number)]
        run = (1.0 - self._share) * column[self._before] + self._share * column[self._after]
        run -= run[0] if self._data.relative[number] else 0.0
        missed: np.ndarray = (run - self._data.curves[number]) / self._data.scales[number]
        return missed

    def slopes(self) -> dict[str, np.ndarray]:
        """Derivatives of half the sum of the squares by each value of each column, shape (step_count,)."""
        found = {name: np.zeros(len(column)) for name, column in self._columns.items()}
        for number, missed in enumerate(self.values):
            pull = missed / self._data.scales[number]
            pull[0] -= pull.sum() if self._data.relative[number] else 0.0
            rise = np.subtract(*(self._columns[str(number)][at] for at in (self._after, self._before)))
            steep = rise / np.subtract(*(self._columns[OVER][at] for at in (self._after, self._before)))
            for at, share in ((self._before, 1.0 - self._share), (self._after, self._share)):
                np.add.at(found[str(number)], at, share * pull)
                np.add.at(found[OVER], at, -share * steep * pull)
        return found
