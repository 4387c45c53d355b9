"""A limit on how long somebody else's code may take."""

import signal
import threading
import time
from collections.abc import Callable
from typing import Any, TypeVar

Answer = TypeVar("Answer")


class TimeLimitExceeded(Exception):
    """A call took too long.

    Attributes:
        seconds: time until it returned or was stopped [s].
    """

    def __init__(self, seconds: float):
        super().__init__(f"took {seconds:.3g} s")
        self.seconds = seconds


class _Alarm(KeyboardInterrupt):
    """An interruption, not an Exception: the code that is interrupted must not take it for one of its own."""


def call_within(limit: float | None, function: Callable[..., Answer], *arguments: Any) -> Answer:
    """Call a function that may take `limit` seconds, and return its result.

    Where the system has interval timers, and in the main thread, a call that never returns is interrupted, too;
    elsewhere its time is seen when it returns.

    Raises:
        TimeLimitExceeded: it took longer.
    """
    if limit is None:
        return function(*arguments)
    started = time.perf_counter()
    if hasattr(signal, "setitimer") and threading.current_thread() is threading.main_thread():
        result = _call_with_alarm(limit, function, *arguments)
    else:
        result = function(*arguments)
    seconds = time.perf_counter() - started
    if seconds > limit:
        raise TimeLimitExceeded(seconds)
    return result


def _call_with_alarm(limit: float, function: Callable[..., Answer], *arguments: Any) -> Answer:
    started = time.perf_counter()
    before = signal.signal(signal.SIGALRM, _raise)
    try:
        try:
            signal.setitimer(signal.ITIMER_REAL, limit)
            return function(*arguments)
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
    except _Alarm:  # it may come as late as while it is switched off
        raise TimeLimitExceeded(time.perf_counter() - started) from None
    finally:
        signal.signal(signal.SIGALRM, before)


def _raise(_number: int, _frame: Any) -> None:
    raise _Alarm
