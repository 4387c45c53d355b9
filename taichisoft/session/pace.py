"""The speed of a run: real time, or a chosen multiple."""

import time
from collections import deque
from collections.abc import Callable

AVERAGED = 1.0
"""Wall-clock time over which the speed of a run is averaged [s]."""
LONGEST_DELAY = 0.1
"""Largest delay that a run makes up for [s]; it does not hurry to make up for longer ones."""
KEEPING_UP = 0.95
"""Least share of the set speed at which a run still keeps up [-]."""


class Pace:
    """Limits the speed of a run, and measures it.

    Attributes:
        speed: set speed, simulated over wall-clock time [-]; None: as fast as possible.
        real_time_factor: speed in the last second, simulated over wall-clock time [-]; NaN before the first step.
    """

    def __init__(self, speed: float | None = None, clock: Callable[[], float] = time.perf_counter):
        """Start the measurement; `clock` returns seconds."""
        self.speed = speed
        self.real_time_factor = float("nan")
        self._clock = clock
        self._total_simulated = self._total_time = 0.0
        self.restart()

    def restart(self) -> None:
        """Restart the measurement, after a pause or a change of speed or time."""
        self._due = self._clock()
        self._recent: deque[tuple[float, float]] = deque([(self._due, 0.0)])

    @property
    def keeps_up(self) -> bool:
        """Whether the run reaches its set speed; True until a speed has been measured."""
        return self.speed is None or not self.real_time_factor < KEEPING_UP * self.speed

    @property
    def mean_real_time_factor(self) -> float:
        """Speed of the whole run without its pauses, simulated over wall-clock time; NaN before the first step."""
        return self._total_simulated / self._total_time if self._total_time else float("nan")

    def seconds_to_wait(self, time_step: float) -> float:
        """Time to wait after a step that simulated `time_step` [s]; negative when the run is late [s]."""
        now = self._clock()
        simulated = self._recent[-1][1] + time_step
        if self.speed is None:
            wait = 0.0
        else:
            self._due += time_step / self.speed
            wait = self._due - now
            if wait < -LONGEST_DELAY:
                self._due = now
        self._measure(now + max(wait, 0.0), simulated)
        return wait

    def _measure(self, now: float, simulated: float) -> None:
        self._total_simulated += simulated - self._recent[-1][1]
        self._total_time += now - self._recent[-1][0]
        self._recent.append((now, simulated))
        while len(self._recent) > 2 and now - self._recent[1][0] > AVERAGED:
            self._recent.popleft()
        (start, first), (end, last) = self._recent[0], self._recent[-1]
        if end > start:
            self.real_time_factor = (last - first) / (end - start)
