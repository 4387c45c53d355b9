"""The way from one set of values to another, each within a time of its own."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Ramp:
    """Values that go from `start` to `target`.

    Attributes:
        start, target: shape (value_count,).
        durations: of each value's way [s], shape (value_count,); 0 where it does not move.
        smooth: starts and ends at rest, instead of at a constant rate.
    """

    start: np.ndarray
    target: np.ndarray
    durations: np.ndarray
    smooth: bool

    @property
    def length(self) -> float:
        """Until the last value is there [s]."""
        return float(self.durations.max(initial=0.0))

    def at(self, elapsed: float) -> np.ndarray:
        """The values some time after the start [s], shape (value_count,)."""
        moving = elapsed < self.durations
        share = np.divide(elapsed, self.durations, out=np.ones_like(self.durations), where=moving)
        if self.smooth:
            share = share * share * (3.0 - 2.0 * share)
        return np.where(moving, self.start + share * (self.target - self.start), self.target)
