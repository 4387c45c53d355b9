"""Figures of a run that are kept up with every step, so that a run of any length takes no more room."""

import math
from collections import Counter, deque
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from taichisoft.step import StepReport

RESOLUTION = 1e-3
"""Medians of times are exact to this share."""


class RunningMedian:
    """The median of many numbers that lie close together: how often each was there, to a resolution.

    Attributes:
        count: how many there were.
    """

    def __init__(self) -> None:
        self.count = 0
        self._times: Counter[int] = Counter()

    def add(self, value: float) -> None:
        """Include a positive number."""
        self.count += 1
        self._times[round(math.log(value) / RESOLUTION)] += 1

    @property
    def value(self) -> float:
        """The median, to `RESOLUTION`."""
        return 0.5 * sum(math.exp(RESOLUTION * key) for key in middle_keys(self._times))


def middle_keys(times: Counter[int]) -> tuple[int, int]:
    """The two numbers in the middle of all, by how often each was there; the same twice where their count is odd."""
    keys = sorted(times)
    passed = np.cumsum([times[key] for key in keys])
    total = int(passed[-1])
    first, second = np.searchsorted(passed, [(total - 1) // 2, total // 2], side="right")
    return keys[first], keys[second]


class StepFigures:
    """What the solver had to do in all steps.

    Attributes:
        steps: their number.
        max_penetration: the largest [mm].
        overlapping: steps with surfaces that overlap.
        unconverged: steps that did not converge.
        inverted_elements: most elements that were inside out after a step.
        linearisations: most in a step.
        worst_newton_residual: of the equations at the ends of steps [mm]; None where steps have one linearisation.
        unconverged_newton: steps whose linearisations were not enough.
        step_time: median of the wall-clock times [s].
        last: report of the last one; None before the first.
    """

    def __init__(self, contact_distance: float, newton_tolerance: float):
        """Begin before the first step.

        Args:
            contact_distance: surfaces overlap where they intrude by more [mm].
            newton_tolerance: largest residual of a step whose linearisations were enough [mm].
        """
        self.steps = self.overlapping = self.unconverged = 0
        self.inverted_elements = self.linearisations = self.unconverged_newton = 0
        self.max_penetration = 0.0
        self.worst_newton_residual: float | None = None
        self.step_time = RunningMedian()
        self.last: StepReport | None = None
        self._iterations: Counter[int] = Counter()
        self._distance, self._newton_tolerance = contact_distance, newton_tolerance

    def add(self, report: "StepReport") -> None:
        """Include a step."""
        self.steps += 1
        self.last = report
        self.max_penetration = max(self.max_penetration, report.max_penetration)
        self.overlapping += report.max_penetration > self._distance
        self.unconverged += not report.converged
        self.inverted_elements = max(self.inverted_elements, report.inverted_elements)
        self.linearisations = max(self.linearisations, report.linearisations)
        if report.newton_residual is not None:
            worst, residual = self.worst_newton_residual, report.newton_residual
            if worst is None or residual > worst:
                self.worst_newton_residual = residual
            self.unconverged_newton += not residual <= self._newton_tolerance
        self.step_time.add(report.step_time)
        self._iterations[report.iterations] += 1

    @property
    def iterations(self) -> tuple[float, int]:
        """Median and largest number of sweeps."""
        return 0.5 * sum(middle_keys(self._iterations)), max(self._iterations)


class LiftFigures:
    """Where an object and the base were before the base moved and in the last steps, and what pressed the object.

    Attributes:
        slip: how far the object has slid down what holds it, since the moment before the base moved, or since the start
            where it did not [mm].
        peak_force: the largest sum of the fingers' normal forces [mN].
        positions: of the object before and after each of the last steps [mm].
        forces: that sum in each of these steps [mN].
        unconverged: whether each of them did not converge.
    """

    def __init__(self, up: np.ndarray, hold_steps: int, push: int | None, base: np.ndarray, position: np.ndarray):
        """Begin before the first step.

        Args:
            up: the direction against gravity, of length 1, shape (3,).
            hold_steps: how many of the last steps are kept.
            push: number of steps made before something pushes the object; None where nothing does.
            base: translation of the base [mm], shape (3,).
            position: place of the object [mm], shape (3,).
        """
        self._up, self._push, self._steps = up, push, 0
        self._highest = float(position @ up)
        self._beside_base = position - base if push == 0 else None
        self._first_base = base
        self._before, self._at_rest = (base, position), True
        self._rest = base, position
        self._now = base, position
        self.slip = self.peak_force = 0.0
        self.positions = deque([position], maxlen=hold_steps + 1)
        self.forces: deque[float] = deque(maxlen=hold_steps)
        self.unconverged: deque[bool] = deque(maxlen=hold_steps)

    def add(self, base: np.ndarray, position: np.ndarray, slide: np.ndarray, force: float, converged: bool) -> None:
        """Include a step, in which the object slid by `slide` on what holds it [mm], shape (3,)."""
        self._now = base, position
        self._steps += 1
        self._highest = max(self._highest, float(position @ self._up))
        if self._steps == self._push:
            self._beside_base = position - base
        if self._at_rest and np.array_equal(base, self._first_base):
            self._rest = self._now
        elif self._at_rest:
            self._before, self._at_rest = self._rest, False
            self.slip = 0.0
        self.slip -= float(slide @ self._up)
        self.peak_force = max(self.peak_force, force) if self.forces else force
        self.positions.append(position)
        self.forces.append(force)
        self.unconverged.append(not converged)

    @property
    def base_way(self) -> np.ndarray:
        """From the moment before the base moved, or from the start where it did not [mm], shape (3,)."""
        way: np.ndarray = self._now[0] - self._before[0]
        return way

    @property
    def object_way(self) -> np.ndarray:
        """Of the object since the same moment [mm], shape (3,)."""
        way: np.ndarray = self._now[1] - self._before[1]
        return way

    @property
    def peak_lift(self) -> float:
        """How far the object was above its place at that moment, at most in the whole run [mm]."""
        return self._highest - float(self._before[1] @ self._up)

    @property
    def pushed_away(self) -> float | None:
        """How far the object is from its place beside the base before it was pushed [mm]; None before that."""
        if self._beside_base is None:
            return None
        return float(np.linalg.norm(self._now[1] - self._now[0] - self._beside_base))

    @property
    def creep(self) -> float:
        """How far the object got from where it was before the last steps [mm]."""
        held = np.array(self.positions)
        return float(np.linalg.norm(held - held[0], axis=1).max())
