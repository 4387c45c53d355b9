"""Processes that make rollouts: each has the model and stays ready for the next call."""

import queue
import threading
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Protocol

from taichisoft.branching.rollout_sample import RolloutOutcome, RolloutSample, roll_out
from taichisoft.errors import TaichisoftError
from taichisoft.model import Model
from taichisoft.time_stepper import TimeStepper
from taichisoft.worker import Link, Worker, WorkerLost

WORK = "taichisoft.branching.rollout_processes:make_rollouts"
ONE_THREAD = {"TAICHISOFT_THREADS": "1"}
"""A process for each core is faster than threads, which wait for one another in every step."""


class Receiver(Protocol):
    """Takes the outcomes of samples, from any thread.

    Attributes:
        cancelled: whether nobody wants them any more.
    """

    cancelled: bool

    def add(self, index: int, outcome: RolloutOutcome | None) -> None:
        """Take what became of a sample; None if it was cancelled."""

    def fail(self, index: int, error: TaichisoftError) -> None:
        """Take the error by which a sample has no outcome."""


@dataclass(frozen=True)
class Task:
    """A sample to be made, and who takes its outcome."""

    model: Model
    sample: RolloutSample
    index: int
    receiver: Receiver


class RolloutProcesses:
    """A number of processes that share one queue of samples."""

    def __init__(self, count: int):
        """Start the threads that speak with the processes; each process starts with its first sample."""
        self._tasks: queue.SimpleQueue[Task | None] = queue.SimpleQueue()
        self._processes = [RolloutProcess(self._tasks) for _ in range(count)]

    def submit(self, tasks: Sequence[Task]) -> None:
        """Have samples made, after those submitted before."""
        for task in tasks:
            self._tasks.put(task)

    def cancel(self, receiver: Receiver) -> None:
        """End the samples of a receiver that are being made; its others are left out when their turn comes."""
        for process in self._processes:
            process.cancel(receiver)

    def close(self) -> None:
        """End the processes; what they have not finished fails."""
        for process in self._processes:
            process.close()
        for _ in self._processes:
            self._tasks.put(None)


class RolloutProcess:
    """A process, and the thread that hands it one sample after the other."""

    def __init__(self, tasks: "queue.SimpleQueue[Task | None]"):
        """Start the thread."""
        self._tasks = tasks
        self._worker: Worker | None = None
        self._model: Model | None = None
        self._running: Task | None = None
        self._closed = False
        self._sending = threading.Lock()
        threading.Thread(target=self._serve, name="rollouts", daemon=True).start()

    def cancel(self, receiver: Receiver) -> None:
        """End the sample that is being made if it is the receiver's."""
        with self._sending:
            if self._running is not None and self._running.receiver is receiver and self._worker is not None:
                self._worker.send(("cancel", id(self._running)))

    def close(self) -> None:
        """End the process at once."""
        with self._sending:
            self._closed = True
            if self._worker is not None:
                self._worker.process.kill()

    def _serve(self) -> None:
        while self._serve_next():
            pass
        if self._worker is not None:
            self._worker.end()

    def _serve_next(self) -> bool:
        """Wait for a task and do it; False when none will come. Between two tasks nothing refers to the first."""
        task = self._tasks.get()
        if task is None:
            return False
        try:
            task.receiver.add(task.index, None if task.receiver.cancelled else self._make(task))
        except TaichisoftError as error:
            task.receiver.fail(task.index, error)
        except Exception as error:  # a lost process; a control that cannot be pickled
            text = " ".join(str(error).split())
            task.receiver.fail(task.index, TaichisoftError(f"sample {task.index} of the rollouts: {text}"))
        return True

    def _make(self, task: Task) -> RolloutOutcome | None:
        with self._sending:
            if self._closed:
                raise TaichisoftError("the rollouts were ended by `Simulation.close`")
            worker = self._ready_worker()
            if self._model is not task.model:
                worker.send(("model", task.model))
                self._model = task.model
            worker.send(("sample", (id(task), task.sample)))
            self._running = task
        try:
            outcome: RolloutOutcome | None = worker.receive()
        except WorkerLost as error:
            if self._closed:
                raise TaichisoftError("the rollouts were ended by `Simulation.close`") from error
            raise
        finally:
            with self._sending:
                self._running = None
        return outcome

    def _ready_worker(self) -> Worker:
        """The process; another one where that was lost."""
        if self._worker is not None and not self._worker.alive:
            self._worker.end()
            self._worker = None
        if self._worker is None:
            self._worker, self._model = Worker(WORK, ONE_THREAD), None
        return self._worker


def make_rollouts(link: Link) -> None:
    """What a process does: it takes models and samples, and answers with the outcome of each sample."""
    simulation: TimeStepper | None = None
    with suppress(EOFError):  # the parent wants nothing more
        while True:
            kind, content = link.receive()
            if kind == "model":
                simulation = TimeStepper(content)
            elif kind == "sample":
                assert simulation is not None
                number, sample = content
                try:
                    link.send(roll_out(simulation, sample, _Cancellation(link, number)))
                except TaichisoftError as error:
                    link.fail(error)


class _Cancellation:
    """Whether the parent has cancelled a sample; while one is being made nothing else arrives."""

    def __init__(self, link: Link, number: int):
        self._link, self._number = link, number

    def __call__(self) -> bool:
        cancelled = False
        while self._link.has_message:
            message: tuple[str, Any] = self._link.receive()
            cancelled = cancelled or message == ("cancel", self._number)
        return cancelled
