"""Time limit for calls of plug-in code."""

import signal
import threading
import time
from collections.abc import Callable
from typing import Any, TypeVar

Answer = TypeVar("Answer")


class TimeLimitExceeded(Exception):
    """A call exceeded its time limit.

    Attributes:
        seconds: time until the call returned or was interrupted [s].
    """

    def __init__(self, seconds: float):
        super().__init__(f"took {seconds:.3g} s")
        self.seconds = seconds


class _Alarm(KeyboardInterrupt):
    """An interruption, not an Exception, so that the interrupted code does not catch it as its own."""


def call_within(limit: float | None, function: Callable[..., Answer], *arguments: Any) -> Answer:
    """Call a function with a time limit [s], and return its result.

    In the main thread of a system with interval timers, a call that never returns is interrupted; otherwise the time is
    checked after the call.

    Raises:
        TimeLimitExceeded: the call took longer.
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
    except _Alarm:  # may arrive while the timer is being cancelled
        raise TimeLimitExceeded(time.perf_counter() - started) from None
    finally:
        signal.signal(signal.SIGALRM, before)


def _raise(_number: int, _frame: Any) -> None:
    raise _Alarm
