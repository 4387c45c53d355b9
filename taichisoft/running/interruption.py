"""Ctrl and c, or a batch system's SIGTERM, during a run: heeded between two steps, not in the middle of one."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def deferred_signals() -> Iterator[Callable[[], None]]:
    """Note the first signal instead of obeying it; the function that is yielded then raises KeyboardInterrupt.

    So the outputs have either the whole of a step or nothing of it. A second signal raises at once: whoever sends
    it no longer wants to wait. A signal that the process was told to ignore stays ignored, and outside of the main
    thread nothing is deferred, because Python calls handlers only there.
    """
    came: list[int] = []

    def stop_if_asked() -> None:
        if came:
            raise KeyboardInterrupt

    def note(number: int, _frame: Any) -> None:
        stop_if_asked()
        came.append(number)

    before = {}
    if threading.current_thread() is threading.main_thread():
        heeded = [number for number in SIGNALS if signal.getsignal(number) not in (signal.SIG_IGN, None)]
        before = {number: signal.signal(number, note) for number in heeded}
    try:
        yield stop_if_asked
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
