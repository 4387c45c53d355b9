"""Worker processes: a child in which a hang or a crash of a native library can do no harm, and the messages with it.

`Worker("package.module:function")` starts this Python in a child process, which imports the module and calls the
function with a `Link`. Both ends exchange pickled objects, each preceded by its length, through pipes that nobody else
has: nothing that comes from a network or a file is unpickled here. An exception that leaves the function ends the
process and is raised by `Worker.receive`; what libraries print goes to a log, whose last line explains a crash.

The process has a session of its own, so that Ctrl and c, and a hang-up, are for the parent alone. It ends with its
parent, however that ends: its pipe closes, and where a process that was forked from the parent holds the pipe open, the
process sees that its parent is another one.
"""

import os
import pickle
import queue
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from importlib import import_module
from io import FileIO
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, Any, Self

from taichisoft.base.processes import PYTHON, how_it_ended
from taichisoft.errors import TaichisoftError

START = "from taichisoft.base.worker import work; work()"
TIME_TO_EXIT = 10.0
"""Time that a process has between its last message and its end [s]."""
TIME_TO_TAKE = 600.0
"""Time after which a process that reads nothing is ended [s]; a pipe holds a short message meanwhile."""
BETWEEN_LOOKS = 1.0
"""Time between two looks of a process whether its parent still is there [s]."""
LENGTH = 8
"""Bytes of the number before each message that says how long the message is."""


class WorkerLost(ChildProcessError):
    """A worker process gives no answer: it crashed, ended or failed; the text says why in one line.

    Attributes:
        signal: number of the signal by which somebody ended the process; 0 where that was not the reason.
    """

    def __init__(self, problem: str, signal: int = 0):
        super().__init__(problem)
        self.signal = signal


class WorkerSlow(WorkerLost):
    """A worker process gave no answer in time, and was ended."""


class Worker:
    """The parent's end of a worker process; leaving a `with` statement kills the process.

    Attributes:
        process: the child process.
    """

    def __init__(
        self,
        function: str,
        environment: Mapping[str, str] | None = None,
        folder: Path | None = None,
        captured: bool = True,
    ):
        """Start the process; returns at once.

        Args:
            function: "package.module:function", which the process calls with its `Link`.
            environment: environment variables that the process has beside ours.
            folder: where it runs; our current folder when it is not given.
            captured: whether a log takes what it prints; otherwise that goes to our standard error.
        """
        self._log = TemporaryFile() if captured else None  # noqa: SIM115 - closed in `end`
        self.process = subprocess.Popen(
            [*PYTHON, "-c", START, function],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._log,
            env={**os.environ, **(environment or {})},
            cwd=folder,
            start_new_session=True,
        )
        self._time_limit: float | None = None  # that has passed
        self._answers: queue.SimpleQueue[bytearray | WorkerLost] = queue.SimpleQueue()
        self._listener = threading.Thread(target=self._listen, name="worker", daemon=True)
        self._listener.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    @property
    def alive(self) -> bool:
        """Whether the process is there."""
        return self.process.poll() is None

    def send(self, message: Any, time_limit: float = TIME_TO_TAKE) -> None:
        """Send a message, from one thread at a time; `receive` says so when the process is gone.

        Args:
            message: what can be pickled.
            time_limit: time after which a process that does not read it is ended [s].
        """
        assert self.process.stdin is not None
        watchdog = threading.Timer(time_limit, self._give_up, (time_limit,))
        watchdog.daemon = True
        watchdog.start()
        try:
            _write(self.process.stdin, message)
        except OSError:
            pass
        finally:
            watchdog.cancel()

    def receive(
        self,
        time_limit: float = threading.TIMEOUT_MAX,
        meanwhile: Callable[[], None] = lambda: None,
        every: float = threading.TIMEOUT_MAX,
    ) -> Any:
        """The next message of the process.

        Args:
            time_limit: time after which the process is ended [s].
            meanwhile: called again and again while we wait; it may raise.
            every: time between two of these calls [s].

        Raises:
            TaichisoftError: the function raised it; of the nearest class in `taichisoft.errors`.
            WorkerSlow: no message came in time.
            WorkerLost: no further message will come.
        """
        latest = time.monotonic() + time_limit
        while True:
            left = max(0.0, latest - time.monotonic())
            try:
                arrived = self._answers.get(timeout=min(left, every))
                break
            except queue.Empty:
                if left > every:
                    meanwhile()
                else:
                    self._give_up(time_limit)
                    every = latest = threading.TIMEOUT_MAX
        if isinstance(arrived, WorkerLost):
            self._answers.put(arrived)
            raise arrived
        error, message = pickle.loads(arrived)
        if error is not None:
            raise error
        return message

    def ask(self, message: Any, time_limit: float) -> Any:
        """Send a message and wait for the next one, each for `time_limit` [s] at most; raises what `receive` raises."""
        self.send(message, time_limit)
        return self.receive(time_limit)

    def end(self, patience: float = 0.0) -> None:
        """End the process, which learns that nothing more comes, and kill it after `patience` [s]."""
        assert self.process.stdin is not None and self.process.stdout is not None
        if not patience:
            self.process.kill()
        with suppress(OSError):  # what was not written yet cannot be any more
            self.process.stdin.close()
        with suppress(subprocess.TimeoutExpired):
            self.process.wait(patience or None)
        self.process.kill()
        self._listener.join()
        self.process.stdout.close()
        if self._log is not None:
            self._log.close()

    def _give_up(self, time_limit: float) -> None:
        self._time_limit = time_limit
        self.process.kill()
        self.process.wait()

    def _listen(self) -> None:
        """Take all messages as they come, so that none is waited for without a time limit; then the end."""
        assert self.process.stdout is not None
        pipe = FileIO(self.process.stdout.fileno(), closefd=False)
        with suppress(EOFError):
            while True:
                self._answers.put(_read(pipe))
        self._answers.put(self._loss())

    def _loss(self) -> WorkerLost:
        try:
            code = self.process.wait(TIME_TO_EXIT)
        except subprocess.TimeoutExpired:
            self.process.kill()
            code = self.process.wait()
        if self._time_limit is not None:
            return WorkerSlow(f"no answer within {self._time_limit:g} s")
        said = b""
        if self._log is not None:
            self._log.seek(0)
            said = self._log.read()
        return WorkerLost(how_it_ended(code, said) or "the process ended without an answer", max(0, -code))


def call_apart(
    function: str,
    *arguments: Any,
    time_limit: float,
    meanwhile: Callable[[], None] = lambda: None,
    every: float = threading.TIMEOUT_MAX,
    environment: Mapping[str, str] | None = None,
    folder: Path | None = None,
) -> Any:
    """The value of `function`, "package.module:function", for arguments, in a process of its own.

    The other arguments, and the errors raised, are as for `Worker` and of `Worker.receive`.
    """
    with Worker("taichisoft.base.worker:_call", environment, folder) as worker:
        worker.send((function, arguments), time_limit)
        return worker.receive(time_limit, meanwhile, every)


class Link:
    """The worker's end: the messages that the parent sends, and the way to answer.

    Attributes:
        time_to_close: time that this process has when its parent has ended or wants nothing more [s]; then it is ended
            at once, in the middle of whatever it does.
    """

    def __init__(self, requests: FileIO, answers: IO[bytes], parent: int):
        """Take messages from one pipe and answer through another as long as `parent` is this process's parent."""
        self.time_to_close = 0.0
        self._requests, self._answers, self._parent = requests, answers, parent
        self._arrived: queue.SimpleQueue[bytearray | None] = queue.SimpleQueue()
        self._sending = threading.Lock()
        for task in (self._take, self._watch):
            threading.Thread(target=task, daemon=True).start()

    def receive(self) -> Any:
        """Wait for the next message.

        Raises:
            EOFError: none will come.
        """
        arrived = self._arrived.get()
        if arrived is None:
            raise EOFError("the parent is gone")
        return pickle.loads(arrived)

    @property
    def has_message(self) -> bool:
        """Whether `receive` would not have to wait."""
        return not self._arrived.empty()

    def send(self, message: Any) -> None:
        """Send a message, from any thread."""
        self._send(None, message)

    def fail(self, error: TaichisoftError | WorkerLost) -> None:
        """Have the parent raise an error, one of ours as the nearest class in `taichisoft.errors`."""
        self._send(_plain(error) if isinstance(error, TaichisoftError) else error, None)

    def _send(self, error: Exception | None, message: Any) -> None:
        with self._sending, suppress(OSError):  # a parent that is gone ends this process anyway
            _write(self._answers, (error, message))

    def _take(self) -> None:
        with suppress(EOFError, OSError):
            while True:
                self._arrived.put(_read(self._requests))
        self._close()

    def _watch(self) -> None:
        while os.getppid() == self._parent:
            time.sleep(BETWEEN_LOOKS)
        self._close()

    def _close(self) -> None:
        self._arrived.put(None)
        time.sleep(self.time_to_close)
        os._exit(1)


def work() -> None:
    """What the process does: it calls the function of its command line; see `Worker`."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # where a session does not keep it from us
    requests, answers = FileIO(os.dup(0)), os.fdopen(os.dup(1), "wb")
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    os.dup2(2, 1)  # what libraries print is not a message
    link = Link(requests, answers, os.getppid())
    try:
        _named(sys.argv[1])(link)
    except TaichisoftError as error:
        link.fail(error)
    except Exception as error:
        link.fail(WorkerLost(f"{type(error).__name__}: {' '.join(str(error).split())}"))


def _call(link: Link) -> None:
    function, arguments = link.receive()
    link.send(_named(function)(*arguments))


def _named(function: str) -> Callable[..., Any]:
    module, _, name = function.partition(":")
    found: Callable[..., Any] = getattr(import_module(module), name)
    return found


def _plain(error: TaichisoftError) -> TaichisoftError:
    """An error that the parent can unpickle: of the nearest class that it knows and that a text alone makes."""
    for kind in type(error).__mro__:
        if kind.__module__ == TaichisoftError.__module__:
            with suppress(TypeError):  # it is made of other things
                plain: TaichisoftError = kind(str(error))
                return plain
    raise AssertionError("TaichisoftError is made of a text")


def _write(pipe: IO[bytes], message: Any) -> None:
    """Write a message.

    Raises:
        OSError: nobody reads any more.
    """
    content = pickle.dumps(message, protocol=pickle.HIGHEST_PROTOCOL)
    pipe.write(len(content).to_bytes(LENGTH))
    pipe.write(content)
    pipe.flush()


def _read(pipe: FileIO) -> bytearray:
    """The next message, still pickled.

    Raises:
        EOFError: there is none, or only a part of one, which a writer who was killed has left.
    """
    length = int.from_bytes(_exactly(pipe, LENGTH))
    return _exactly(pipe, length)


def _exactly(pipe: FileIO, count: int) -> bytearray:
    content = bytearray(count)
    filled = 0
    with memoryview(content) as view:
        while filled < count:
            arrived = pipe.readinto(view[filled:])
            if not arrived:
                raise EOFError
            filled += arrived
    return content
