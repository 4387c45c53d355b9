"""Runs in several processes at a time; what is finished stays in a folder and is not made again."""

import queue
import threading
from collections.abc import Callable, Sequence
from pathlib import Path

from taichisoft.errors import TaichisoftError
from taichisoft.worker import Worker, WorkerLost
from taichisoft_reduction.errors import ReductionError
from taichisoft_reduction.run_request import RunResult, TrainingRun
from taichisoft_reduction.training_process import to_json

START_LIMIT = 600.0
"""Time that a process has to load Taichi and the plug-ins [s]."""
RUN_LIMIT = 3600.0
"""Longest time of a run [s]."""
ONE_THREAD = {"TAICHISOFT_THREADS": "1", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


class RunPool:
    """Processes that make runs; leaving a `with` statement ends them."""

    def __init__(self, folder: Path, processes: int, plugins: Sequence[str]):
        """Keep the results in `folder`, and load `plugins`, paths, into each process."""
        self._folder, self._count, self._plugins = folder, processes, tuple(plugins)
        self._workers: queue.SimpleQueue[Worker] = queue.SimpleQueue()
        self._all: list[Worker] = []

    def __enter__(self) -> "RunPool":
        return self

    def __exit__(self, *_: object) -> None:
        for worker in self._all:
            worker.end()

    def finished(self, request: TrainingRun) -> bool:
        """Whether the result of a run is there."""
        return RunResult.load(self._folder / request.file_name) is not None

    def results(self, requests: Sequence[TrainingRun], done: Callable[[str, str], None]) -> list[RunResult]:
        """The results of runs, in the order of the requests, each from its file where that is there.

        Args:
            requests: the runs.
            done: called with the name of each run that ends, and the problem that ended it early, if any.

        Raises:
            ReductionError: a process was lost, or a result cannot be written.
        """
        self._folder.mkdir(parents=True, exist_ok=True)
        waiting: queue.SimpleQueue[TrainingRun] = queue.SimpleQueue()
        missing = [request for request in requests if not self.finished(request)]
        for request in sorted(missing, key=lambda one: -one.duration * len(one.bodies)):  # long ones first
            waiting.put(request)
        ended: queue.SimpleQueue[tuple[str, str] | TaichisoftError | WorkerLost] = queue.SimpleQueue()
        threads = [
            threading.Thread(target=self._make, args=(waiting, ended), daemon=True)
            for _ in range(min(self._count, len(missing)))
        ]
        for thread in threads:
            thread.start()
        for _ in missing:
            said = ended.get()
            if isinstance(said, Exception):
                raise ReductionError(f"a process that makes runs failed: {said}") from said
            done(*said)
        return [self._load(request) for request in requests]

    def _make(self, waiting: queue.SimpleQueue, ended: queue.SimpleQueue) -> None:  # type: ignore[type-arg]
        try:
            worker = self._worker()
            while True:
                try:
                    request = waiting.get_nowait()
                except queue.Empty:
                    self._workers.put(worker)
                    return
                path = self._folder / request.file_name
                ended.put((request.name, worker.ask((to_json(request), str(path)), RUN_LIMIT)))
        except (TaichisoftError, WorkerLost) as error:
            ended.put(error)

    def _worker(self) -> Worker:
        """A process that waits for runs."""
        try:
            return self._workers.get_nowait()
        except queue.Empty:
            worker = Worker("taichisoft_reduction.training_process:make_runs", ONE_THREAD)
            self._all.append(worker)
            worker.ask(self._plugins, START_LIMIT)
            return worker

    def _load(self, request: TrainingRun) -> RunResult:
        result = RunResult.load(self._folder / request.file_name)
        if result is None:
            raise ReductionError(f"{self._folder / request.file_name}: cannot be read; remove it and try again")
        return result
