"""The workers that make runs, through Dask: processes of this machine, of a scheduler that runs, or of SLURM."""

import logging
import os
import signal
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib.util import find_spec
from typing import Any, Protocol
from uuid import uuid4

from taichisoft_studies.extras import StudyError, require
from taichisoft_studies.study_file import Cluster

LOST = "worker lost"
CONNECT_LIMIT = 30
"""Time to reach a scheduler [s]."""


class Workers(Protocol):
    """Workers that take tasks and hand back what became of them, in whatever order they end."""

    count: int
    about: str

    def submit(self, key: str, task: Callable[[str], dict[str, Any]], text: str) -> None:
        """Have `task(text)` done; `key` is a name that no other task has."""

    def next_done(self) -> tuple[str, dict[str, Any] | None]:
        """Wait for a task to end; its key, and what it returned, or None when its workers were lost too often."""


class DaskWorkers:
    """Workers of a Dask cluster."""

    def __init__(self, client: Any, count: int, about: str):
        from distributed import as_completed

        self.count, self.about = count, about
        self._client = client
        self._keys: dict[Any, str] = {}
        self._done = as_completed([], loop=client.loop)

    def submit(self, key: str, task: Callable[[str], dict[str, Any]], text: str) -> None:
        """See `Workers`."""
        future = self._client.submit(task, text, key=f"{key}-{uuid4().hex}", pure=False)
        self._keys[future] = key
        self._done.add(future)

    def next_done(self) -> tuple[str, dict[str, Any] | None]:
        """See `Workers`.

        Raises:
            StudyError: a task failed in an unforeseen way, or the cluster is gone.
        """
        future = next(self._done)
        key = self._keys[future]
        if future.status == "finished":
            return key, future.result()
        problem = future.exception()
        if type(problem).__name__ == "KilledWorker":
            return key, None
        raise StudyError(f"run {key}: {type(problem).__name__}: {' '.join(str(problem).split())}")


def available_cpus() -> int:
    """Number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def dask_workers(cluster: Cluster, tasks: int) -> Iterator[DaskWorkers]:
    """The workers of a study, ended with it unless they belong to a scheduler of their own.

    Args:
        cluster: where they are.
        tasks: no more of them are started on this machine than there are tasks.

    Raises:
        StudyError: Dask is not installed, or a cluster cannot be reached or started.
    """
    require("a study", "distributed", *(["dask_jobqueue"] if cluster.slurm is not None else []))
    import dask
    from distributed import Client

    for name in ("distributed", "tornado.application", "asyncio"):  # what is lost is counted and told by us
        logging.getLogger(name).setLevel(logging.CRITICAL)
    settings = {
        "distributed.scheduler.allowed-failures": cluster.retries,
        "distributed.scheduler.worker-saturation": 1.0,  # what waits at a worker that is killed was not lost
        "distributed.worker.daemon": False,
        "distributed.nanny.environ.TAICHISOFT_THREADS": "1",
        "distributed.logging.distributed": "critical",
    }
    with dask.config.set(settings):
        if cluster.scheduler is not None:
            with _connected(cluster.scheduler) as client:
                count = len(client.scheduler_info(n_workers=-1)["workers"])
                yield DaskWorkers(client, max(count, 1), _about(client, count))
            return
        count = cluster.workers or available_cpus()
        if cluster.slurm is None:
            count = max(1, min(count, tasks))
        with _own_cluster(cluster, count) as (own, size), Client(own) as client:
            yield DaskWorkers(client, size, _about(client, size))


@contextmanager
def _connected(address: str) -> Iterator[Any]:
    from distributed import Client

    try:
        client = Client(address, timeout=CONNECT_LIMIT)
    except (OSError, ValueError) as error:
        raise StudyError(f"--scheduler {address}: cannot be reached: {' '.join(str(error).split())}") from error
    try:
        yield client
    finally:
        client.close()


@contextmanager
def _own_cluster(cluster: Cluster, count: int) -> Iterator[tuple[Any, int]]:
    """A cluster of ours, and the number of its workers."""
    if cluster.slurm is not None:
        made, processes = slurm_cluster(cluster.slurm)
        made.scale(jobs=count)
        count *= processes
    else:
        from distributed import LocalCluster

        with _interruption_ignored():
            made = LocalCluster(
                n_workers=count,
                threads_per_worker=1,
                dashboard_address=":0",
                memory_limit=0,
                preload=["taichisoft_studies.worker_start"],
            )
    with made:
        yield made, count


def slurm_cluster(told: Mapping[str, Any]) -> tuple[Any, int]:
    """A cluster of SLURM without any job yet, and the number of workers that each of its jobs has.

    Raises:
        StudyError: an argument is not one of `dask_jobqueue.SLURMCluster`.
    """
    from dask_jobqueue import SLURMCluster

    arguments = {"cores": 1, "processes": 1, "memory": "2GB", **told}
    try:
        return SLURMCluster(**arguments), int(arguments["processes"])
    except (TypeError, ValueError) as error:
        raise StudyError(f"cluster.slurm: {' '.join(str(error).split())}") from error


@contextmanager
def _interruption_ignored() -> Iterator[None]:
    """Heed no Ctrl and c for the moment in which workers start, which would inherit how.

    A terminal sends it to all processes, but it is for the command alone to end the others. Workers that take the place
    of lost ones ignore it through `worker_start`.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _about(client: Any, count: int) -> str:
    """A line about the workers, with the dashboard's address where it can be drawn."""
    page = client.dashboard_link if find_spec("bokeh") is not None else "none (pip install bokeh)"
    return f"{count} worker{'s' * (count != 1)}; dashboard: {page or 'none'}"
