"""Worker processes and pools of them: messages, failures in one line, time limits, kills, and their end."""

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

from taichisoft.base import Pool, Worker, WorkerLost, WorkerSlow, call_apart
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
def test_message_arrives_as_sent(echo: Worker, message: object) -> None:
    assert echo.ask(message, PATIENCE) == message


def test_large_arrays_arrive_in_order(echo: Worker) -> None:
    """Both pipes are full several times over."""
    arrays = [np.full((300, 1000), float(number)) for number in range(5)]
    for array in arrays:
        echo.send(array)
    for array in arrays:
        np.testing.assert_array_equal(echo.receive(PATIENCE), array)


def test_printed_text_is_no_message() -> None:
    with Worker("odd_work:speak") as one:
        assert one.receive(PATIENCE) == ""


def test_messages_before_the_end_are_received() -> None:
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
def test_failure_is_one_line(how: str, kind: type[Exception], text: str) -> None:
    with Worker("odd_work:fail") as one, pytest.raises(kind) as failure:
        one.ask(how, PATIENCE)
    assert type(failure.value) is kind
    assert str(failure.value) == text


def test_missing_function_is_a_failure() -> None:
    with Worker("odd_work:none") as one, pytest.raises(WorkerLost, match="has no attribute 'none'"):
        one.receive(PATIENCE)


def test_killed_process_has_its_signal() -> None:
    with Worker("odd_work:stay") as one:
        os.kill(one.receive(PATIENCE), signal.SIGKILL)
        with pytest.raises(WorkerLost, match="SIGKILL") as lost:
            one.receive(PATIENCE)
    assert lost.value.signal == signal.SIGKILL


def test_hanging_process_ends_at_its_time_limit() -> None:
    calls: list[float] = []
    with Worker("odd_work:fail") as one:
        one.send("hang")
        with pytest.raises(WorkerSlow, match=r"^no answer within 0\.5 s$") as slow:
            one.receive(0.5, lambda: calls.append(0.0), every=0.1)
        assert not one.alive
        assert slow.value.signal == 0
    assert len(calls) >= 2


def test_process_that_reads_nothing_is_killed() -> None:
    with Worker("odd_work:stay") as one:
        os.kill(one.receive(PATIENCE), signal.SIGSTOP)
        with pytest.raises(WorkerSlow, match=r"^no answer within 0\.5 s$"):
            one.ask(bytes(10_000_000), 0.5)


def test_call_meanwhile_may_raise() -> None:
    def stop() -> None:
        raise KeyboardInterrupt

    with Worker("odd_work:stay") as one:
        process = one.receive(PATIENCE)
        with pytest.raises(KeyboardInterrupt):
            one.receive(PATIENCE, stop, every=0.01)
    with pytest.raises(ProcessLookupError):
        os.kill(process, 0)


def test_ctrl_c_reaches_the_parent_alone() -> None:
    with Worker("odd_work:interrupt_oneself") as one:
        assert one.ask(os.getpid(), PATIENCE) is False


def test_call_apart_returns_the_value() -> None:
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
def test_process_ends_with_a_killed_parent() -> None:
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


def test_process_has_its_time_to_close(tmp_path: Path) -> None:
    one = Worker("odd_work:close_slowly")
    one.ask(str(tmp_path / "closing"), PATIENCE)
    began = time.monotonic()
    one.end(PATIENCE)
    assert 1.0 <= time.monotonic() - began < PATIENCE
    assert one.process.returncode == 1
    assert (tmp_path / "closing").exists()


def answers(pool: Pool, *jobs: tuple[object, ...], context: object = None, **options: float) -> list[object]:
    """What becomes of jobs, in their order."""
    for number, job in enumerate(jobs):
        pool.submit(number, job, context, **options)
    ended = dict(pool.next_done() for _ in jobs)
    return [ended[number] for number in range(len(jobs))]


def test_pool_answers_with_values_and_errors() -> None:
    """A job that fails leaves its process for the next one; one that ends the process gets another."""
    with Pool("odd_work:prepare", 1) as pool:
        (process, _), refused, divided, (same, _) = answers(
            pool, ("context",), ("refuse", "a.toml: no"), ("divide", 0), ("context",)
        )
        crashed, (other, _) = answers(pool, ("exit", 3), ("context",))
    assert process == same != other
    assert (type(refused), str(refused)) == (MeshError, "a.toml: no")
    assert (type(divided), str(divided)) == (WorkerLost, "ZeroDivisionError: division by zero")
    assert (type(crashed), str(crashed)) == (WorkerLost, "exit code 3")


def test_pool_starts_no_more_processes_than_needed() -> None:
    with Pool("odd_work:prepare", 2) as pool:
        alone = {answers(pool, ("context",), context="a")[0] for _ in range(3)}
        both = {process for process, _ in answers(pool, *[("context",)] * 20, context="a")}
    assert len(alone) == 1
    assert len(both) <= 2


def test_pool_sends_a_context_when_it_changes() -> None:
    with Pool("odd_work:prepare", 1) as pool:
        (first,), (second,) = (answers(pool, ("context",), context=context) for context in ("a", "b"))
        (broken,) = answers(pool, ("context",), context="broken")
    assert first[0] == second[0]
    assert (first[1], second[1]) == ("a", "b")
    assert (type(broken), str(broken)) == (WorkerLost, "the plug-in is broken")


@pytest.mark.parametrize(("kills", "signal_number"), [(2, 0), (3, signal.SIGKILL)])
def test_pool_begins_a_killed_job_again(tmp_path: Path, kills: int, signal_number: int) -> None:
    with Pool("odd_work:prepare", 1, tries=3) as pool:
        (answer,) = answers(pool, ("be killed", tmp_path, kills))
    assert getattr(answer, "signal", 0) == signal_number
    assert isinstance(answer, WorkerLost) or answer == kills


def test_pool_does_jobs_of_lower_ranks_first() -> None:
    """The first one is begun at once; the others wait for the only process."""
    ranks = [5.0, 3.0, 4.0, 1.0]
    with Pool("odd_work:prepare", 1) as pool:
        pool.submit(0.0, ("sleep", 0.5))
        for rank in ranks:
            pool.submit(rank, ("divide", 1), rank=rank)
        assert [pool.next_done()[0] for _ in range(5)] == [0.0, *sorted(ranks)]


def test_pool_kills_a_job_at_its_time_limit() -> None:
    with Pool("odd_work:prepare", 1, tries=3) as pool:
        slow, quick = answers(pool, ("sleep", 600), ("divide", 1), time_limit=1.0)
    assert isinstance(slow, WorkerSlow)
    assert quick == 1.0


def test_closed_pool_ends_its_jobs() -> None:
    with Pool("odd_work:prepare", 1, tries=3) as pool:
        process, _ = answers(pool, ("context",))[0]
        for number in range(3):
            pool.submit(number, ("sleep", 600))
    assert all(isinstance(pool.next_done()[1], WorkerLost) for _ in range(3))
    with pytest.raises(ProcessLookupError):
        os.kill(process, 0)
