"""Worker processes: their messages, how their failures are told, and that none outlives what it works for."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from conftest import PATIENCE
from hypothesis import given, settings
from hypothesis import strategies as st

from taichisoft.base import Worker, WorkerLost, WorkerSlow, call_apart
from taichisoft.errors import MeshError, TaichisoftError


@pytest.fixture(scope="module", autouse=True)
def found() -> Iterator[None]:
    """Worker processes find the modules beside this one."""
    with pytest.MonkeyPatch.context() as patch:
        path = os.environ.get("PYTHONPATH", "")
        patch.setenv("PYTHONPATH", f"{Path(__file__).parent}{os.pathsep}{path}")
        yield


@pytest.fixture(scope="module")
def echo(found: None) -> Iterator[Worker]:
    with Worker("odd_work:echo") as one:
        yield one


@settings(deadline=None)
@given(st.recursive(st.none() | st.floats(allow_nan=False) | st.text() | st.binary(), st.lists, max_leaves=20))
def test_a_message_arrives_as_it_was_sent(echo: Worker, message: object) -> None:
    assert echo.ask(message, PATIENCE) == message


def test_large_arrays_arrive_whole_in_order_while_nobody_reads(echo: Worker) -> None:
    """Both pipes are full several times over."""
    arrays = [np.full((300, 1000), float(number)) for number in range(5)]
    for array in arrays:
        echo.send(array)
    for array in arrays:
        np.testing.assert_array_equal(echo.receive(PATIENCE), array)


def test_what_is_printed_is_no_message_and_there_is_nothing_to_read() -> None:
    with Worker("odd_work:speak") as one:
        assert one.receive(PATIENCE) == ""


def test_messages_before_the_end_are_all_received() -> None:
    with Worker("odd_work:announce") as one:
        one.process.wait(PATIENCE)
        one.send("nobody reads this")
        assert [one.receive(PATIENCE) for _ in range(3)] == [0, 1, 2]
        for _ in range(2):
            with pytest.raises(WorkerLost, match=r"^the process ended without an answer$"):
                one.receive(PATIENCE)


@pytest.mark.parametrize(
    ("how", "kind", "text"),
    [
        ("particular", MeshError, "a.toml: refused"),
        ("diverged", TaichisoftError, "step 3: body 'finger' explodes; try a smaller step"),
        ("plain", TaichisoftError, "two  spaces stay"),
        ("foreign", WorkerLost, "ValueError: first line second line"),
        ("abort", WorkerLost, "the process was ended by SIGABRT"),
        ("exit", WorkerLost, "no libGL"),
    ],
)
def test_a_failure_is_one_line(how: str, kind: type[Exception], text: str) -> None:
    with Worker("odd_work:fail") as one, pytest.raises(kind) as failure:
        one.ask(how, PATIENCE)
    assert type(failure.value) is kind
    assert str(failure.value) == text


def test_a_function_that_is_not_there_is_a_failure() -> None:
    with Worker("odd_work:none") as one, pytest.raises(WorkerLost, match="has no attribute 'none'"):
        one.receive(PATIENCE)


def test_a_process_that_somebody_killed_is_told_from_one_that_crashed() -> None:
    with Worker("odd_work:stay") as one:
        os.kill(one.receive(PATIENCE), signal.SIGKILL)
        with pytest.raises(WorkerLost, match="SIGKILL") as lost:
            one.receive(PATIENCE)
    assert lost.value.signal == signal.SIGKILL


def test_a_process_that_hangs_is_ended_at_its_time_limit_and_there_are_calls_meanwhile() -> None:
    calls: list[float] = []
    with Worker("odd_work:fail") as one:
        one.send("hang")
        with pytest.raises(WorkerSlow, match=r"^no answer within 0\.5 s$") as slow:
            one.receive(0.5, lambda: calls.append(0.0), every=0.1)
        assert not one.alive
        assert slow.value.signal == 0
    assert len(calls) >= 2


def test_a_process_that_reads_nothing_is_ended_as_well() -> None:
    with Worker("odd_work:stay") as one:
        os.kill(one.receive(PATIENCE), signal.SIGSTOP)
        with pytest.raises(WorkerSlow, match=r"^no answer within 0\.5 s$"):
            one.ask(bytes(10_000_000), 0.5)


def test_who_is_called_meanwhile_may_raise() -> None:
    def stop() -> None:
        raise KeyboardInterrupt

    with Worker("odd_work:stay") as one:
        process = one.receive(PATIENCE)
        with pytest.raises(KeyboardInterrupt):
            one.receive(PATIENCE, stop, every=0.01)
    with pytest.raises(ProcessLookupError):
        os.kill(process, 0)


def test_ctrl_c_is_for_the_parent() -> None:
    with Worker("odd_work:interrupt_oneself") as one:
        assert one.ask(os.getpid(), PATIENCE) is False


def test_a_call_returns_the_value_of_a_function() -> None:
    assert call_apart("odd_work:add", [1], [2], time_limit=PATIENCE) == [1, 2]
    with pytest.raises(WorkerLost, match=r"^TypeError: .*NoneType"):
        call_apart("odd_work:add", 1, None, time_limit=PATIENCE)


PARENT = """
import os, sys, time
from taichisoft.base.worker import Worker

worker = Worker("odd_work:stay")
print(worker.receive(), flush=True)
if os.fork() == 0:  # it holds the pipes of the worker open
    print(os.getpid(), flush=True)
time.sleep(600)
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")
def test_a_process_whose_parent_is_killed_ends_though_a_fork_holds_its_pipes() -> None:
    with subprocess.Popen([sys.executable, "-c", PARENT], stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        process, fork = (int(parent.stdout.readline()) for _ in range(2))
        parent.kill()
        parent.wait()
        try:
            with pytest.raises(ProcessLookupError):
                for _ in range(500):
                    os.kill(process, 0)
                    time.sleep(0.02)
        finally:
            for left in (process, fork):
                with suppress(ProcessLookupError):
                    os.kill(left, signal.SIGKILL)


def test_who_needs_time_to_close_has_it_and_no_more(tmp_path: Path) -> None:
    one = Worker("odd_work:close_slowly")
    one.ask(str(tmp_path / "closing"), PATIENCE)
    began = time.monotonic()
    one.end(PATIENCE)
    assert 1.0 <= time.monotonic() - began < PATIENCE
    assert one.process.returncode == 1
    assert (tmp_path / "closing").exists()
