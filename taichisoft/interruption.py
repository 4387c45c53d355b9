"""Interruption of a run by Ctrl and c or a batch system's SIGTERM, between steps only."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM)

_came: list[int] = []
"""Signals noted but not yet acted upon."""


def stop_if_asked() -> None:
    """Raise KeyboardInterrupt if a signal was noted; called between steps, and between the parts of a step.

    A step stores its new state at its end, so an interrupted step has changed nothing. As in Python, signals are for
    the main thread; other threads continue.
    """
    if _came and _is_main_thread():
        raise KeyboardInterrupt


@contextmanager
def deferred_signals() -> Iterator[Callable[[], None]]:
    """Note the first signal within the context instead of raising it; yields `stop_if_asked`, which raises it.

    So the outputs contain either all of a step or nothing of it. A second signal raises at once. Ignored signals stay
    ignored, and outside the main thread nothing is deferred, because Python calls handlers only there.
    """

    if not _is_main_thread():
        yield stop_if_asked
        return

    def note(number: int, _frame: Any) -> None:
        stop_if_asked()
        _came.append(number)

    noted_outside = _came.copy()
    _came.clear()
    handled = [number for number in SIGNALS if signal.getsignal(number) not in (signal.SIG_IGN, None)]
    before = {number: signal.signal(number, note) for number in handled}
    try:
        yield stop_if_asked
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        _came[:] = noted_outside


def _is_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()
