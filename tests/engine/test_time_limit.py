"""A call that takes too long is stopped, and nothing of the limit is left behind."""

import contextlib
import signal
import threading
import time

import pytest

from taichisoft.running.loop import TimeLimitExceeded, call_within


def spin_for_ever() -> None:
    while True:
        with contextlib.suppress(Exception):  # the limit is not the callee's to catch
            time.sleep(0.01)


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="this system has no interval timers")
def test_call_that_never_returns_is_stopped() -> None:
    before = signal.getsignal(signal.SIGALRM)
    with pytest.raises(TimeLimitExceeded) as exceeded:
        call_within(0.05, spin_for_ever)
    assert exceeded.value.seconds >= 0.05
    assert signal.getsignal(signal.SIGALRM) is before
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


def test_call_in_time_gives_its_result() -> None:
    assert call_within(10.0, divmod, 17, 5) == (3, 2)
    assert call_within(None, divmod, 17, 5) == (3, 2)
    if hasattr(signal, "setitimer"):
        assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


def test_error_of_call_is_its_own() -> None:
    with pytest.raises(ZeroDivisionError):
        call_within(10.0, divmod, 1, 0)


def test_beside_main_thread_it_is_seen_when_call_returns() -> None:
    caught: list[BaseException] = []

    def call() -> None:
        try:
            call_within(0.01, time.sleep, 0.05)
        except TimeLimitExceeded as error:
            caught.append(error)

    thread = threading.Thread(target=call)
    thread.start()
    thread.join()
    assert len(caught) == 1
