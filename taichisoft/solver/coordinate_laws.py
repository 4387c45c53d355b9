"""Rows of actuators whose effort and coordinate follow a law of their own, such as the air in a cavity.

A law gives the coordinate by the effort, and falls: the more air is pressed, the less space it takes. The bodies give
the coordinate by the effort, too, and there it rises. The row of the constraint problem is the law's tangent, an own
compliance as that of a stretchy cable, and where law and bodies meet is found by Newton's method: solve, take the
tangent at the effort found, and solve again. Where a tangent leads out of the bracket of efforts known to be too low
and too high, or hardly shrinks it, the chord between them takes its place, whose solution lies inside (as in Dekker's
method for one unknown).
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from taichisoft.actuators.kind import CoordinateLaw

# Distance from the law at which a row follows it, over the scale of the coordinate, or over the effort: round-off.
FOLLOWS, EFFORT_FOLLOWS = 1e-11, 1e-13
# A tangent that leaves more than this share of a bracket gives way to the chord.
SHRINKS = 0.5
# Where an effort is too low for the law, the next tangent is so much of the last effort above the lowest.
NEARER = 0.1


@dataclass(frozen=True)
class FollowedLaw:
    """A law and the line that stands for it in a row of the constraint problem.

    Attributes:
        row: number of the row among the actuators'.
        law: the law.
        effort, coordinate, slope: a point of the line, and its slope.
        too_low, too_high: bracket of efforts.
        missed: distance between line and law where a line was last solved with, over the scale of the coordinate or of
            the effort.
        is_chord: whether the line is the chord of the bracket instead of a tangent.
    """

    row: int
    law: CoordinateLaw
    effort: float
    coordinate: float
    slope: float
    too_low: float = -math.inf
    too_high: float = math.inf
    missed: float = math.inf
    is_chord: bool = False

    @classmethod
    def tangent(cls, row: int, law: CoordinateLaw, effort: float) -> "FollowedLaw":
        """The law's tangent at an effort."""
        return cls(row, law, effort, *law.growth(effort))

    @property
    def holds(self) -> bool:
        """Whether the law holds where the line was last solved with."""
        return self.missed <= FOLLOWS

    @property
    def at_zero(self) -> float:
        """Coordinate of the line where the effort is 0."""
        return self.coordinate - self.slope * self.effort

    def moved(self, effort: float) -> "FollowedLaw":
        """The tangent at another effort; this line where the effort is too low for the law."""
        return self.tangent(self.row, self.law, float(effort)) if effort > self.law.lowest_effort else self

    def compliance(self, stage: float) -> np.ndarray:
        """The line as own compliance of the row, by impulses [mm^3/s per kPa s], shape (1, 1); see `Time.stage`."""
        return np.array([[-self.slope / stage**2]])

    def solved(self, effort: float) -> "FollowedLaw":
        """The line to go on with after the problem was solved with this one, and the row found an effort."""
        if not effort > self.law.lowest_effort:
            nearer = self.law.lowest_effort + NEARER * (self.effort - self.law.lowest_effort)
            return replace(self.tangent(self.row, self.law, nearer), too_high=self.too_high)
        coordinate, slope = self.law.growth(effort)
        above = self.coordinate + self.slope * (effort - self.effort) - coordinate
        # Where the coordinate changes fast with the effort, round-off of the effort is much of the coordinate.
        missed = abs(above) / max(self.law.scale, -EFFORT_FOLLOWS / FOLLOWS * slope * (effort - self.law.lowest_effort))
        if missed <= FOLLOWS:
            return replace(self, missed=missed)
        if self._is_outside(effort) and not self.is_chord:
            return replace(self._chord(), missed=missed)
        # What lies outside although a chord was solved with tells that other rows have moved the bracket.
        low, high = (-math.inf, math.inf) if self._is_outside(effort) else (self.too_low, self.too_high)
        low, high = (low, effort) if above > 0.0 else (effort, high)
        line = FollowedLaw(self.row, self.law, effort, coordinate, slope, low, high, missed)
        # Where a law is steepest, as that of a valve between equal pressures, tangents lead to and fro across it.
        is_slow = not self.is_chord and high - low > SHRINKS * (self.too_high - self.too_low)
        return line._chord() if is_slow and high - low < math.inf else line

    def _is_outside(self, effort: float) -> bool:
        """Whether an effort lies outside a bracket with two ends."""
        has_ends = -math.inf < self.too_low < self.too_high < math.inf
        return has_ends and not self.too_low < effort < self.too_high

    def _chord(self) -> "FollowedLaw":
        """The line through the law at both ends of the bracket."""
        (low, _), (high, _) = self.law.growth(self.too_low), self.law.growth(self.too_high)
        slope = (high - low) / (self.too_high - self.too_low)
        return replace(self, effort=self.too_low, coordinate=low, slope=slope, is_chord=True)
