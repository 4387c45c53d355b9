"""Child processes that confine hangs and crashes of native libraries: a `Worker`, and a `Pool` of them for many jobs.

`Worker("package.module:function")` starts this Python in a child process, which imports the module and calls the
function with a `Link`. Both ends exchange pickled objects, each preceded by its length, through pipes that no other
process has: nothing that comes from a network or a file is unpickled here. An exception that leaves the function ends
the process and is raised by `Worker.receive`; what libraries print goes to a log, whose last line explains a crash.

The process has a session of its own, so only the parent gets Ctrl and c or a hang-up. It ends with its parent: its pipe
closes, and where a process forked from the parent holds the pipe open, the process sees that its parent has changed.
"""

import itertools
import math
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
from typing import IO, Any, NamedTuple, Self

from taichisoft.base.processes import PYTHON, how_it_ended
from taichisoft.errors import TaichisoftError

START = "from taichisoft.base.worker import work; work()"
TIME_TO_EXIT = 10.0
"""Time that a process has between its last message and its end [s]."""
TIME_TO_TAKE = 600.0
"""Time after which a process that reads nothing is ended [s]; a pipe holds a short message meanwhile."""
TIME_TO_START = 600.0
"""Time that a process of a pool has to import what its jobs need [s]; minutes on a busy network disk."""
BETWEEN_LOOKS = 1.0
"""Interval at which a process checks that its parent still exists [s]."""
LENGTH = 8
"""Bytes of the length before each message."""


class WorkerLost(ChildProcessError):
    """A worker process gives no answer: it crashed, ended or failed; the text says why in one line.

    Attributes:
        signal: number of the signal that ended the process; 0 without one.
    """

    def __init__(self, problem: str, signal: int = 0):
        super().__init__(problem)
        self.signal = signal


class WorkerSlow(WorkerLost):
    """A worker process gave no answer in time, and was killed."""


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
    ):
        """Start the process; returns at once.

        Args:
            function: "package.module:function", which the process calls with its `Link`.
            environment: additional environment variables of the process.
            folder: its current folder; None: ours.
        """
        self._log = TemporaryFile()  # noqa: SIM115 - closed in `end`
        self.process = subprocess.Popen(
            [*PYTHON, "-c", START, function],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._log,
            env={**os.environ, **(environment or {})},
            cwd=folder,
            start_new_session=True,
        )
        self._passed_limit: float | None = None
        self._answers: queue.SimpleQueue[bytearray | WorkerLost] = queue.SimpleQueue()
        self._listener = threading.Thread(target=self._listen, name="worker", daemon=True)
        self._listener.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    @property
    def alive(self) -> bool:
        """Whether the process is running."""
        return self.process.poll() is None

    def send(self, message: Any, time_limit: float = TIME_TO_TAKE) -> None:
        """Send a message, from one thread at a time; where the process has ended, `receive` raises why.

        Args:
            message: an object that can be pickled.
            time_limit: time after which a process that does not read it is killed [s].
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
            time_limit: time after which the process is killed [s].
            meanwhile: called periodically during the wait; it may raise.
            every: period of these calls [s].

        Raises:
            TaichisoftError: raised by the function; of the nearest class in `taichisoft.errors`.
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
        """Close the pipe to the process, and kill it unless it ends within `patience` [s]."""
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
        self._log.close()

    def _give_up(self, time_limit: float) -> None:
        self._passed_limit = time_limit
        self.process.kill()
        self.process.wait()

    def _listen(self) -> None:
        """Queue all messages as they arrive, so that every wait has a time limit; then the reason of the end."""
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
        if self._passed_limit is not None:
            return WorkerSlow(f"no answer within {self._passed_limit:g} s")
        self._log.seek(0)
        problem = how_it_ended(code, self._log.read())
        return WorkerLost(problem or "the process ended without an answer", max(0, -code))


def call_apart(
    function: str,
    *arguments: Any,
    time_limit: float,
    meanwhile: Callable[[], None] = lambda: None,
    every: float = threading.TIMEOUT_MAX,
    environment: Mapping[str, str] | None = None,
    folder: Path | None = None,
) -> Any:
    """Call `function`, "package.module:function", in a child process; arguments and errors of `Worker.receive`."""
    with Worker("taichisoft.base.worker:_call", environment, folder) as worker:
        worker.send((function, arguments), time_limit)
        return worker.receive(time_limit, meanwhile, every)


class _Job(NamedTuple):
    """The arguments of `Pool.submit`."""

    key: Any
    content: Any
    context: Any
    time_limit: float


class Pool:
    """Processes that do jobs, each one at a time; leaving a `with` statement kills them.

    A lost process is replaced, and a job whose process was killed from outside is begun again.

    Attributes:
        closed: whether the pool has been closed.
    """

    def __init__(
        self,
        function: str,
        count: int,
        environment: Mapping[str, str] | None = None,
        tries: int = 1,
    ):
        """Prepare; as many processes start as there are jobs at a time.

        Args:
            function: "package.module:function"; a process calls it with the context of its first job, and gets the
                function that does a job.
            count: largest number of processes.
            environment: additional environment variables of the processes.
            tries: how often a job is begun whose process is killed.
        """
        self.function, self.environment, self.tries, self.closed = function, environment, tries, False
        self.jobs: queue.PriorityQueue[tuple[float, int, _Job | None]] = queue.PriorityQueue()
        self._ended: queue.SimpleQueue[tuple[Any, Any]] = queue.SimpleQueue()
        self._count, self._pending, self._number = count, 0, itertools.count()
        self._seats: list[_Seat] = []
        self._lock = threading.Lock()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
        for seat in self._seats:
            seat.thread.join()

    def submit(
        self,
        key: Any,
        content: Any,
        context: Any = None,
        time_limit: float = threading.TIMEOUT_MAX,
        rank: float = 0.0,
    ) -> None:
        """Have a job done, after those of the same rank that were submitted before.

        Args:
            key: identifies the job in `next_done`.
            content: of the job.
            context: what a process needs once for many jobs, such as plug-ins or a model; sent to it again only when
                it is another object.
            time_limit: longest time of the job [s], without the preparation of a new process.
            rank: jobs of a lower rank come first.
        """
        with self._lock:
            self._pending += 1
            if len(self._seats) < min(self._pending, self._count):
                self._seats.append(_Seat(self))
        self.jobs.put((rank, next(self._number), _Job(key, content, context, time_limit)))

    def next_done(self) -> tuple[Any, Any]:
        """Wait for a job to end; its key, and its value or the exception by which it failed (see `Worker.receive`)."""
        return self._ended.get()

    def end_job(self, key: Any, answer: Any) -> None:
        """Hand over the answer of a job."""
        with self._lock:
            self._pending -= 1
        self._ended.put((key, answer))

    def close(self) -> None:
        """Kill the processes; jobs that are not done fail."""
        self.closed = True
        for seat in self._seats:
            seat.kill()
            self.jobs.put((math.inf, next(self._number), None))


class _Seat:
    """A process of a pool, and the thread that gives it one job after the other."""

    def __init__(self, pool: Pool):
        self._pool = pool
        self._lock = threading.Lock()
        self._worker: Worker | None = None
        self._context: Any = self  # that of no job
        self.thread = threading.Thread(target=self._serve, name="pool", daemon=True)
        self.thread.start()

    def kill(self) -> None:
        with self._lock:
            if self._worker is not None:
                self._worker.process.kill()

    def _serve(self) -> None:
        while self._serve_next():
            pass
        if self._worker is not None:
            self._worker.end()

    def _serve_next(self) -> bool:
        """Wait for a job and do it; False after the last. Between two jobs nothing refers to the first."""
        *_, job = self._pool.jobs.get()
        if job is None:
            return False
        try:
            answer = self._answer(job)
        except Exception as error:  # also of a content that cannot be pickled
            answer = error
        self._pool.end_job(job.key, answer)
        return True

    def _answer(self, job: _Job) -> Any:
        for _ in range(self._pool.tries - 1):
            try:
                return self._ask(job)
            except WorkerLost as lost:
                if lost.signal not in (signal.SIGKILL, signal.SIGTERM):
                    raise
        return self._ask(job)

    def _ask(self, job: _Job) -> Any:
        worker = self._ready_worker()
        if self._context is not job.context:
            self._prepare(worker, job.context)
        worker.send(("job", job.content))
        return worker.receive(job.time_limit)

    def _ready_worker(self) -> Worker:
        """The process; a new one where it was lost."""
        with self._lock:
            if self._pool.closed:
                raise WorkerLost("the pool was closed")
            if self._worker is not None and not self._worker.alive:
                self._worker.end()
                self._worker = None
            if self._worker is None:
                self._worker = Worker("taichisoft.base.worker:_do_jobs", self._pool.environment)
                self._context = self
            return self._worker

    def _prepare(self, worker: Worker, context: Any) -> None:
        worker.send(("context", (self._pool.function, context)))
        try:
            worker.receive(TIME_TO_START)
        except WorkerSlow as slow:
            raise WorkerLost(f"it did not start within {TIME_TO_START:g} s") from slow
        except TaichisoftError as error:
            raise WorkerLost(str(error)) from error
        self._context = context


class Link:
    """The worker's end: receives the parent's messages, and answers.

    Attributes:
        time_to_close: time that this process has after its parent has ended or closed the pipe [s]; then it exits, in
            the middle of whatever it does.
    """

    def __init__(self, requests: FileIO, answers: IO[bytes], parent: int):
        """Receive from one pipe and answer through another as long as `parent` is this process's parent."""
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

    def send(self, message: Any) -> None:
        """Send a message, from any thread."""
        self._send(None, message)

    def fail(self, error: TaichisoftError | WorkerLost) -> None:
        """Have the parent raise an error; a `TaichisoftError` as the nearest class in `taichisoft.errors`."""
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
    """Call the function of the command line: what the process does, see `Worker`."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # where a session does not keep it from us
    requests, answers = FileIO(os.dup(0)), os.fdopen(os.dup(1), "wb")
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    os.dup2(2, 1)  # what libraries print is not a message
    link = Link(requests, answers, os.getppid())
    try:
        _named(sys.argv[1])(link)
    except Exception as error:
        link.fail(_failure(error))


def _failure(error: Exception) -> TaichisoftError | WorkerLost:
    """The error as one that the parent raises."""
    if isinstance(error, TaichisoftError):
        return error
    return WorkerLost(f"{type(error).__name__}: {' '.join(str(error).split())}")


def _call(link: Link) -> None:
    function, arguments = link.receive()
    link.send(_named(function)(*arguments))


def _do_jobs(link: Link) -> None:
    """What a process of a pool does."""
    do: Callable[[Any], Any] | None = None
    with suppress(EOFError):  # the parent has closed the pool
        while True:
            kind, content = link.receive()
            try:
                if kind == "context":
                    function, context = content
                    do = _named(function)(context)
                    link.send(None)
                else:
                    assert do is not None
                    link.send(do(content))
            except Exception as error:
                link.fail(_failure(error))


def _named(function: str) -> Callable[..., Any]:
    module, _, name = function.partition(":")
    value: Callable[..., Any] = getattr(import_module(module), name)
    return value


def _plain(error: TaichisoftError) -> TaichisoftError:
    """An error that the parent can unpickle: of the nearest class in `taichisoft.errors` made of a text alone."""
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
