"""How long a phase goes on, and how long something has been true in it."""

ROUND_OFF = 1e-9  # of times [s]


class PhaseClock:
    """The clock of a phase; times are [s]."""

    def __init__(self) -> None:
        self.restart(0.0)

    def restart(self, time: float) -> None:
        """A phase begins."""
        self._began = time
        self._true_since: float | None = None

    def exceeds(self, duration: float, time: float) -> bool:
        """Whether the phase has taken longer than that."""
        return time - self._began > duration + ROUND_OFF

    def has_lasted(self, condition: bool, duration: float, time: float) -> bool:
        """Whether the condition, one a phase, has been true at every call for that long."""
        if not condition:
            self._true_since = None
            return False
        if self._true_since is None:
            self._true_since = time
        return time - self._true_since >= duration - ROUND_OFF
