"""Keys that a user presses while a run goes on, and sliders moved, from whichever device: one stream for all."""

import threading
from collections import deque
from dataclasses import dataclass


@dataclass(frozen=True)
class KeyEvent:
    """A key that was pressed, or repeats because it is held; or a slider of the controller that was moved.

    Attributes:
        key: character that the key types ("a", "+", "?"), or one of "up", "down", "left", "right", "space", "enter",
            "escape", "tab", "backspace"; the name of a slider.
        ctrl: whether Ctrl was held; most terminals cannot tell for most keys.
        value: number to which a slider was moved; None for a key.
    """

    key: str
    ctrl: bool = False
    value: float | None = None

    def __str__(self) -> str:
        """The event as people write it: "Ctrl+a", "finger1.cavity=20"."""
        if self.value is not None:
            return f"{self.key}={self.value:g}"
        return f"Ctrl+{self.key}" if self.ctrl else self.key


class KeyStream:
    """Keys on their way to a run: any thread puts them in, the run takes them out between two steps."""

    def __init__(self) -> None:
        self._waiting: deque[KeyEvent] = deque()
        self._arrived = threading.Event()

    def put(self, event: KeyEvent) -> None:
        """Add a key; from any thread, never waits."""
        self._waiting.append(event)
        self._arrived.set()

    def take(self) -> list[KeyEvent]:
        """All keys that came since the last call, in their order."""
        self._arrived.clear()
        taken = []
        while self._waiting:
            taken.append(self._waiting.popleft())
        return taken

    def wait(self, seconds: float) -> None:
        """Return when a key is there, or after so many seconds."""
        self._arrived.wait(seconds)
