"""The targets of a script as one array: pressures [kPa], base translation [mm] and base rotation vector [rad]."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from taichisoft.control.control import Control

PRESSURES, TRANSLATION, ROTATION = slice(None, -6), slice(-6, -3), slice(-3, None)
"""The parts of an array of shape (cavity_count + 6,)."""

Share = TypeVar("Share", float, np.ndarray)


def as_control(cavities: Sequence[str], values: np.ndarray, signals: Mapping[str, float] | None = None) -> Control:
    """The control that asks for values, shape (cavity_count + 6,)."""
    return Control(
        pressure=dict(zip(cavities, values[PRESSURES].tolist(), strict=True)),
        base_translation=values[TRANSLATION],
        base_rotation=values[ROTATION],
        signals=signals or {},
    )


def smoothed(share: Share) -> Share:
    """The share of a way that is done after a share of its time, at rest at both ends."""
    return share * share * (3.0 - 2.0 * share)


@dataclass(frozen=True)
class Ramp:
    """The way of values from `start` to `target`, each within a time of its own.

    Attributes:
        start, target: values at both ends, shape (value_count,).
        durations: time of each value's way [s], shape (value_count,); 0 where it does not move.
        smooth: whether it starts and ends at rest, instead of going at a constant rate.
    """

    start: np.ndarray
    target: np.ndarray
    durations: np.ndarray
    smooth: bool

    @property
    def length(self) -> float:
        """The time until the last value is there [s]."""
        return float(self.durations.max(initial=0.0))

    def at(self, elapsed: float) -> np.ndarray:
        """The values some time after the start [s], shape (value_count,)."""
        moving = elapsed < self.durations
        share = np.divide(elapsed, self.durations, out=np.ones_like(self.durations), where=moving)
        if self.smooth:
            share = smoothed(share)
        return np.where(moving, self.start + share * (self.target - self.start), self.target)
