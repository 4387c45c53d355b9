"""The process of a page ends with its run, also where a process that forked from the run holds their pipe open."""

import os
import threading
import time
from collections.abc import Iterator
from typing import IO

import pytest

from taichisoft_plugins.web import page_process
from taichisoft_plugins.web.messages import RunEnded, send
from taichisoft_plugins.web.page_process import GONE, Inbox

pytestmark = pytest.mark.filterwarnings("error::pytest.PytestUnhandledThreadExceptionWarning")


@pytest.fixture
def pipe(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[IO[bytes], IO[bytes]]]:
    """The reading and the writing end; nothing here may end this process."""
    monkeypatch.setattr(page_process, "SECONDS_TO_CLOSE", 3600.0)
    monkeypatch.setattr(page_process, "SECONDS_BETWEEN_LOOKS", 0.01)
    reading, writing = (os.fdopen(end, mode) for end, mode in zip(os.pipe(), ("rb", "wb"), strict=True))
    with writing, reading:
        yield reading, writing
        writing.close()


def test_a_run_that_is_not_our_parent_any_more_is_gone_though_the_pipe_is_open(
    pipe: tuple[IO[bytes], IO[bytes]],
) -> None:
    inbox = Inbox(pipe[0], run=-1)
    inbox.wait()
    assert inbox.end == GONE


def test_while_it_is_there_its_last_word_counts(pipe: tuple[IO[bytes], IO[bytes]]) -> None:
    inbox = Inbox(pipe[0], run=os.getppid())
    time.sleep(0.1)  # several looks
    assert inbox.end is None
    send(pipe[1], RunEnded("completed"))
    inbox.wait()
    assert inbox.end == RunEnded("completed")


def test_a_page_that_cannot_close_ends_anyway(
    pipe: tuple[IO[bytes], IO[bytes]], monkeypatch: pytest.MonkeyPatch
) -> None:
    exited = threading.Event()
    monkeypatch.setattr(page_process, "SECONDS_TO_CLOSE", 0.01)
    monkeypatch.setattr(os, "_exit", lambda code: exited.set())
    Inbox(pipe[0], run=-1)
    assert exited.wait(20.0)
