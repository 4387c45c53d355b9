"""Valid ranges of the numbers of data."""

from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Bounds:
    """A range of numbers.

    Attributes:
        lowest: smallest number.
        highest: largest number.
        ends: whether `lowest` and `highest` themselves are valid.
        infinite: whether infinity is valid, for no limit.
    """

    lowest: float = -np.inf
    highest: float = np.inf
    ends: bool = True
    infinite: bool = False

    def problem(self, value: Any) -> str:
        """Error in a number or an array of numbers, with the valid range; "" if valid."""
        numbers = np.asarray(value)
        if numbers.dtype.kind not in "fiu" or not numbers.size:
            return ""
        within = (numbers >= self.lowest) & (numbers <= self.highest)
        if not self.ends:
            within &= (numbers != self.lowest) & (numbers != self.highest)
        if not self.infinite:
            within &= np.isfinite(numbers)
        return "" if within.all() else f"{numbers[~within].flat[0]:g} must be {self._valid()}"

    def _valid(self) -> str:
        low, high = np.isfinite([self.lowest, self.highest])
        if low and high:
            return (
                f"{'from' if self.ends else 'between'} {self.lowest:g} {'to' if self.ends else 'and'} {self.highest:g}"
            )
        if low:
            return f"{self.lowest:g} or more" if self.ends else f"above {self.lowest:g}"
        return "a number" if self.infinite else "a finite number"


FINITE = Bounds()
FROM_0 = Bounds(0.0)
ABOVE_0 = Bounds(0.0, ends=False)
LIMIT = Bounds(infinite=True)
LIMIT_FROM_0 = Bounds(0.0, infinite=True)
RATIO = Bounds(-1.0, 0.5, ends=False)
"""Poisson's ratios."""
