"""Ctrl and c, or a batch system's SIGTERM, during a run: heeded where nothing is half done."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM)

_came: list[int] = []
"""The signals that were noted and not heeded yet."""


def stop_if_asked() -> None:
    """Raise KeyboardInterrupt if a signal was noted: called between steps, and within a step between its parts.

    A step puts its new state in place when it is done, so one that ends here has changed nothing. What was noted is for
    the main thread, as signals are in Python; other threads go on.
    """
    if _came and _is_main_thread():
        raise KeyboardInterrupt


@contextmanager
def deferred_signals() -> Iterator[Callable[[], None]]:
    """Note the first signal that comes meanwhile instead of obeying it, for `stop_if_asked`, which is yielded.

    So the outputs have either the whole of a step or nothing of it. A second signal raises at once: whoever sends
    it no longer wants to wait. A signal that the process was told to ignore stays ignored, and outside of the main
    thread nothing is deferred, because Python calls handlers only there.
    """

    if not _is_main_thread():
        yield stop_if_asked
        return

    def note(number: int, _frame: Any) -> None:
        stop_if_asked()
        _came.append(number)

    noted_outside = _came.copy()
    _came.clear()
    heeded = [number for number in SIGNALS if signal.getsignal(number) not in (signal.SIG_IGN, None)]
    before = {number: signal.signal(number, note) for number in heeded}
    try:
        yield stop_if_asked
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        _came[:] = noted_outside


def _is_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()
