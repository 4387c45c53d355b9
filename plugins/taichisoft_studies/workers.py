"""The processes that make the runs of a study: on this machine, or on the workers of a user's Dask scheduler."""

import io
import logging
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any
from uuid import uuid4

from taichisoft.base import Pool, WorkerLost, WorkerSlow, extra, require
from taichisoft_studies.errors import StudyError
from taichisoft_studies.study_file import Cluster

if TYPE_CHECKING:
    from taichisoft_studies.mesh_variants import MeshRun
    from taichisoft_studies.run_job import RunJob

    Job = RunJob | MeshRun

PREPARE = "taichisoft_studies.workers:prepare"
ONE_THREAD = {"TAICHISOFT_THREADS": "1", "OMP_NUM_THREADS": "1"}
TIMEOUT, LOST, WORKER_LOST = "timeout", "process lost", "worker lost"
UNSURE = (TIMEOUT, LOST, WORKER_LOST)
"""Statuses that depend on the machine: `--again` repeats such runs."""
TIME_TO_CONNECT = 30
"""Time to reach a scheduler [s]."""
ENCRYPTED = ("tls", "wss")
"""Protocols of Dask that need credentials."""


class LocalWorkers:
    """Processes of this machine, which load Taichi and its kernels once for many runs.

    Attributes:
        count: number of jobs at a time.
        about: a line about the workers.
    """

    def __init__(self, pool: Pool, count: int):
        """Use a pool of `count` processes."""
        self.count, self.about = count, f"{count} process{'es' * (count != 1)}"
        self._pool = pool
        self._jobs: dict[str, Job] = {}
        self._context: tuple[tuple[str, ...], bool] | None = None

    def submit(self, key: str, job: "Job") -> None:
        """Have a job done; `key` is a name that no other job has."""
        self._jobs[key] = job
        if self._context != (job.plugins, job.needs_engine):
            self._context = job.plugins, job.needs_engine
        self._pool.submit(key, job, self._context, job.time_limit)

    def next_done(self) -> tuple[str, dict[str, Any]]:
        """Wait for a job to end; its key and its record."""
        key, answer = self._pool.next_done()
        return key, _record(self._jobs.pop(key), answer)


def _record(job: "Job", answer: Any) -> dict[str, Any]:
    """The record of a job from the answer of a pool."""
    if isinstance(answer, WorkerSlow):
        return job.lost(TIMEOUT, f"not done within {job.time_limit:g} s")
    if isinstance(answer, WorkerLost):
        return job.lost(LOST, str(answer))
    if isinstance(answer, Exception):
        raise StudyError(f"run {job.name}: {' '.join(str(answer).split())}") from answer
    record: dict[str, Any] = answer
    return record


def prepare(context: tuple[tuple[str, ...], bool]) -> "Callable[[Job], Any]":
    """What a process of a pool does: it loads plug-ins, and Taichi for runs, and makes jobs."""
    assert isinstance(sys.stdout, io.TextIOWrapper)
    sys.stdout.reconfigure(line_buffering=True)  # a killed run keeps all its lines
    plugins, needs_engine = context
    if needs_engine:
        from taichisoft.running import Simulation  # noqa: F401  # starts Taichi
    from taichisoft.running import load_plugin, plugin_registry

    plugin_registry()
    for plugin in plugins:
        load_plugin(plugin)
    return lambda job: job.make()


class DaskWorkers:
    """Workers of a user's Dask cluster; attributes as of `LocalWorkers`."""

    def __init__(self, client: Any, address: str):
        """Use the workers that the scheduler has now."""
        from distributed import as_completed

        self.count = max(1, len(client.scheduler_info(n_workers=-1)["workers"]))
        self.about = f"{self.count} worker{'s' * (self.count != 1)} of {address}"
        self._client = client
        self._jobs: dict[Any, tuple[str, Job]] = {}
        self._done = as_completed([], loop=client.loop)

    def submit(self, key: str, job: "Job") -> None:
        """See `LocalWorkers`."""
        future = self._client.submit(do_job, job, key=f"{key}-{uuid4().hex}", pure=False)
        self._jobs[future] = key, job
        self._done.add(future)

    def next_done(self) -> tuple[str, dict[str, Any]]:
        """See `LocalWorkers`."""
        future = next(self._done)
        key, job = self._jobs.pop(future)
        if future.status == "finished":
            return key, future.result()
        problem = future.exception()
        if type(problem).__name__ == "KilledWorker":
            return key, job.lost(WORKER_LOST, "its workers were killed, one after the other")
        if isinstance(problem, StudyError):
            raise problem
        raise StudyError(f"run {job.name}: {type(problem).__name__}: {' '.join(str(problem).split())}")


Workers = LocalWorkers | DaskWorkers
_of_thread = threading.local()


def do_job(job: "Job") -> dict[str, Any]:
    """What a thread of a Dask worker does: it has a process make the job, which can be killed and may crash."""
    context = job.plugins, job.needs_engine
    if getattr(_of_thread, "context", None) != context:
        if hasattr(_of_thread, "pool"):
            _of_thread.pool.close()
        _of_thread.pool, _of_thread.context = Pool(PREPARE, 1, ONE_THREAD, 1 + Cluster().retries), context
    _of_thread.pool.submit(job.name, job, _of_thread.context, job.time_limit)
    return _record(job, _of_thread.pool.next_done()[1])


@contextmanager
def study_workers(cluster: Cluster, tasks: int) -> Iterator[Workers]:
    """The workers of a study: those of a scheduler, or processes of this machine, no more of them than tasks."""
    if cluster.scheduler is not None:
        with _connected(cluster.scheduler) as client:
            yield DaskWorkers(client, cluster.scheduler)
        return
    from taichisoft.runtime import available_cores

    count = max(1, min(cluster.workers or available_cores(), tasks))
    with Pool(PREPARE, count, ONE_THREAD, 1 + cluster.retries) as pool:
        yield LocalWorkers(pool, count)


@contextmanager
def _connected(address: str) -> Iterator[Any]:
    require("--scheduler", "distributed", install=extra("studies"))
    from distributed import Client

    for name in ("distributed", "tornado.application", "asyncio"):  # lost workers are reported by us
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        client = Client(address, timeout=TIME_TO_CONNECT)
    except (OSError, ValueError, RuntimeError) as error:
        raise StudyError(f"--scheduler {address}: cannot be reached: {' '.join(str(error).split())}") from error
    except TypeError as error:  # Dask's configuration names no certificate
        raise StudyError(
            f"--scheduler {address}: needs credentials, distributed.comm.tls in Dask's settings"
        ) from error
    with client:
        yield client


def caution(cluster: Cluster) -> str:
    """A warning about a scheduler that lets everybody in; empty without one."""
    if cluster.scheduler is None or cluster.scheduler.partition("://")[0] in ENCRYPTED:
        return ""
    return (
        f"--scheduler {cluster.scheduler}: without TLS; whoever reaches its port, or a port of its workers, can run "
        "code as their user"
    )
