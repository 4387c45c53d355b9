"""A smooth way from one height to another, which waits when it is told to."""

import math


class LiftProfile:
    """The minimum-jerk profile (Flash and Hogan 1985): at rest at both ends, and nowhere a jump of acceleration.

    Its own time stands still while it waits. It slows down and goes on within `wait_time`, by a first-order lag, so
    that waiting does not jerk either.
    """

    def __init__(self, start: float, end: float, duration: float, wait_time: float):
        """Begin at `start` [mm].

        Args:
            start: height [mm].
            end: height [mm].
            duration: of the way without waiting [s].
            wait_time: time constant of slowing down and going on [s].
        """
        self._start, self._end = start, end
        self._duration = duration
        self._wait_time = wait_time
        self._time = 0.0
        self._pace = 1.0

    @property
    def finished(self) -> bool:
        """Whether the end is reached."""
        return self._time >= self._duration

    def advance(self, elapsed: float, waits: bool) -> float:
        """The height [mm], `elapsed` [s] later."""
        wanted = 0.0 if waits else 1.0
        self._pace += (wanted - self._pace) * (1.0 - math.exp(-elapsed / self._wait_time))
        self._time += self._pace * elapsed
        share = min(self._time / self._duration, 1.0)
        return self._start + (self._end - self._start) * share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
