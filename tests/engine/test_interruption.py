"""Signals are noted for the main thread, whatever other threads do meanwhile."""

import signal
import threading
from collections.abc import Callable

import pytest

from taichisoft.base import deferred_signals
from taichisoft.base.processes import stop_if_asked


def in_another_thread(work: Callable[[], None]) -> list[BaseException]:
    """Do something there to its end; what it raised."""
    raised: list[BaseException] = []

    def guarded() -> None:
        try:
            work()
        except BaseException as error:
            raised.append(error)

    thread = threading.Thread(target=guarded)
    thread.start()
    thread.join()
    return raised


def run_elsewhere() -> None:
    with deferred_signals() as stop:
        stop()


def test_a_run_in_another_thread_leaves_what_was_noted_and_is_not_stopped_by_it() -> None:
    with deferred_signals() as stop:
        signal.raise_signal(signal.SIGTERM)
        assert in_another_thread(run_elsewhere) == []
        assert in_another_thread(stop_if_asked) == []
        with pytest.raises(KeyboardInterrupt):
            stop()


def test_what_comes_while_another_thread_is_within_stays_noted_when_that_leaves() -> None:
    begun, noted = threading.Event(), threading.Event()

    def slow() -> None:
        with deferred_signals():
            begun.set()
            assert noted.wait(10.0)

    with deferred_signals() as stop:
        thread = threading.Thread(target=slow)
        thread.start()
        assert begun.wait(10.0)
        signal.raise_signal(signal.SIGTERM)
        noted.set()
        thread.join()
        with pytest.raises(KeyboardInterrupt):
            stop()
    stop()  # nothing is left behind
