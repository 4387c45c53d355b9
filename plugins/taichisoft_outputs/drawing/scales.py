"""Scales that hold for all frames that are drawn: colours for numbers, round ends, frames to look at."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

SOFT = ((0.93, 0.92, 0.88), (0.98, 0.82, 0.42), (0.93, 0.46, 0.24), (0.70, 0.13, 0.30), (0.33, 0.06, 0.32))
"""Colours from silicone's own over yellow and red to violet: brightness falls all the way."""

AIR = ((0.60, 0.70, 0.72), (0.24, 0.66, 0.62), (0.02, 0.50, 0.38), (0.00, 0.27, 0.22))
"""Colours from grey to dark green: none of them is among the colours of the silicone around the air."""

LINE = ((0.42, 0.43, 0.46), (0.62, 0.25, 0.55), (0.72, 0.02, 0.50), (0.36, 0.00, 0.32))
"""Colours from grey over magenta to purple, which neither silicone nor air has."""


STEPS = (1.0, 1.2, 1.5, 1.8, 2.0, 2.5, 3.0, 3.5, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0)


@dataclass(frozen=True)
class ColourScale:
    """Colours that run linearly from the lowest to the highest value.

    Attributes:
        title: what the values are, with their unit.
        low, high: values of the first and the last colour; `low` < `high`.
        steps: red, green and blue [-] of evenly spaced values.
        highest: the highest value that is shown; above `high` it has the colour of that, and the bar says so.
    """

    title: str
    low: float
    high: float
    steps: Sequence[tuple[float, float, float]]
    highest: float = -np.inf

    @property
    def stops(self) -> np.ndarray:
        """The values between which colours run linearly, shape (step_count,)."""
        return np.linspace(self.low, self.high, len(self.steps))

    @property
    def top(self) -> str:
        """The number at the high end: with a sign where higher values are shown."""
        return f"{'>= ' if self.highest > self.high * (1 + 1e-9) else ''}{self.high:g}"

    def colours(self, values: np.ndarray) -> np.ndarray:
        """Red, green and blue [-], shape (count, 3), of values (count,); values outside get the colour of the end."""
        return np.stack([np.interp(values, self.stops, part) for part in np.array(self.steps).T], axis=1)


def round_up(value: float) -> float:
    """The next of STEPS times a power of ten, for the high end of a scale: no more than a quarter above the value."""
    power = 10.0 ** np.floor(np.log10(value))
    step = next(step for step in STEPS if value <= step * power * (1 + 1e-9))
    return float(f"{step * power:.6g}")  # the decimal number, not 0.7000000000000001


def scale_of(title: str, values: np.ndarray, steps: Sequence[tuple[float, float, float]]) -> ColourScale | None:
    """A scale from the lowest to the highest of the values, and zero, with round ends; None where all are zero."""
    lowest, highest = np.min(values, initial=0.0), np.max(values, initial=0.0)
    if highest == lowest:
        return None
    ends = [round_up(abs(end)) * np.sign(end) if end else 0.0 for end in (lowest, highest)]
    return ColourScale(title, float(ends[0]), float(ends[1]), steps)


def round_down(value: float) -> float:
    """The last of 1, 2, 5 and 10 times a power of ten, for a value that a scale shows."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(step for step in (1.0, 2.0, 5.0) if step * power <= value * (1 + 1e-9)))


def sample_frames(frames: Sequence[int], count: int) -> list[int]:
    """At most `count` of the frames, evenly spaced from the first to the last."""
    return [frames[index] for index in np.unique(np.linspace(0, len(frames) - 1, count).astype(int))]
