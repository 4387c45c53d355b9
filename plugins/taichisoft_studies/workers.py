"""The workers that make runs, through Dask: processes of this machine, of a scheduler that runs, or of SLURM."""

import ipaddress
import logging
import os
import shlex
import signal
import threading
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Protocol
from uuid import uuid4

from taichisoft.base import extra, named_os_errors, require
from taichisoft_studies.errors import StudyError
from taichisoft_studies.study_file import DASHBOARD, Cluster

# Access to the workers of a study: credentials, Dask's dashboard, and warnings.
#
# Whoever may speak to a Dask scheduler, or to one of its workers, can have any code run. So clusters that a study
# starts speak TLS alone, with a key that is made for them, and ends with them; see docs/studies.md for others.

ENCRYPTED = ("tls", "wss")
"""Protocols of Dask whose connections need credentials."""


def own_credentials() -> Any:
    """Dask's `Security` with a new key and its certificate, which are in memory alone."""
    from taichisoft_studies.tls_connections import SecurityOfStudies

    return SecurityOfStudies.temporary()


@contextmanager
def credentials_in_files(folder: Path) -> Iterator[Any]:
    """The same, and as files for the workers of jobs, that their user alone can read; they vanish in the end.

    Args:
        folder: where a folder of them is made; the machines of the jobs see it under the same path.

    Raises:
        StudyError: they cannot be written.
    """
    from taichisoft_studies.tls_connections import SecurityOfStudies

    class SecurityOfJobs(SecurityOfStudies):
        """Scheduler and client use the credentials in memory; workers get the files, quoted for a shell."""

        files: dict[str, Path]

        def get_tls_config_for_role(self, role: str) -> dict[str, Any]:
            config: dict[str, Any] = super().get_tls_config_for_role(role)
            named = {key: shlex.quote(str(path)) for key, path in self.files.items()}
            return {**config, **named} if role == "worker" else config

    made = SecurityOfJobs.temporary()
    with named_os_errors(folder, StudyError):
        folder.mkdir(parents=True, exist_ok=True)
        held = TemporaryDirectory(prefix=".credentials-", dir=folder.resolve())
    with held as inside:
        made.files = {key: Path(inside) / f"{key}.pem" for key in ("ca_file", "cert", "key")}
        contents = (made.tls_ca_file, made.tls_worker_cert, made.tls_worker_key)
        with named_os_errors(inside, StudyError):
            for path, text in zip(made.files.values(), contents, strict=True):
                with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
                    file.write(text)
        yield made


def cautions(cluster: Cluster) -> list[str]:
    """Warnings about what others can do to a study on these workers, one line each."""
    found = []
    if not _is_loopback(cluster.dashboard_host):
        found.append(
            f"dashboard = {cluster.dashboard!r}: it asks for no password; all who reach this address see the study"
        )
    if cluster.scheduler is not None and _protocol(cluster.scheduler) not in ENCRYPTED:
        found.append(
            f"--scheduler {cluster.scheduler}: without TLS; all who reach its port, or one of its workers', can run "
            "code as their user; docs/studies.md says how tls:// is set up"
        )
    return found


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _protocol(address: str) -> str:
    """The protocol of an address, Dask's default one where it names none."""
    from distributed.comm.addressing import parse_address

    return str(parse_address(address)[0])


LOST = "worker lost"
CONNECT_LIMIT = 30
"""Time to reach a scheduler [s]."""
CLOSED_PAGE = ("--no-dashboard", "--dashboard-address", "127.0.0.1:0")
"""Arguments of `dask worker` that leave its page of its own to its machine alone."""


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
def dask_workers(cluster: Cluster, tasks: int, folder: Path) -> Iterator[DaskWorkers]:
    """The workers of a study, ended with it unless they belong to a scheduler of their own.

    Args:
        cluster: where they are.
        tasks: no more of them are started on this machine than there are tasks.
        folder: the study's, which workers on other machines see as well.

    Raises:
        StudyError: Dask is not installed, or a cluster cannot be reached or started.
    """
    needed = ["distributed"] if cluster.scheduler is not None else ["distributed", "cryptography"]
    require("a study", *needed, *(["dask_jobqueue"] if cluster.slurm is not None else []), install=extra("studies"))
    import dask
    from distributed import Client

    for name in ("distributed", "tornado.application", "asyncio"):  # what is lost is counted and reported by us
        logging.getLogger(name).setLevel(logging.CRITICAL)
    settings = {
        "distributed.scheduler.allowed-failures": cluster.retries,
        "distributed.scheduler.worker-saturation": 1.0,  # what waits at a worker that is killed was not lost
        "distributed.worker.daemon": False,
        "distributed.worker.http.routes": [],  # the page of a worker's own, which nobody asked for, has nothing on it
        "distributed.nanny.environ.TAICHISOFT_THREADS": "1",
        "distributed.logging.distributed": "critical",
    }
    with dask.config.set(settings):
        if cluster.scheduler is not None:
            with _connected(cluster.scheduler) as client:
                count = len(client.scheduler_info(n_workers=-1)["workers"])
                yield DaskWorkers(client, max(count, 1), _about(count, client.dashboard_link))
            return
        with _own_cluster(cluster, tasks, folder) as (own, size), Client(own) as client:
            yield DaskWorkers(client, size, _about(size, _dashboard(own, cluster)))


@contextmanager
def _connected(address: str) -> Iterator[Any]:
    from distributed import Client

    try:
        client = Client(address, timeout=CONNECT_LIMIT)
    except (OSError, ValueError, RuntimeError) as error:
        raise StudyError(f"--scheduler {address}: cannot be reached: {' '.join(str(error).split())}") from error
    except TypeError as error:  # Dask's configuration names no certificate
        raise StudyError(
            f"--scheduler {address}: needs credentials, distributed.comm.tls of Dask's settings; see docs/studies.md"
        ) from error
    try:
        yield client
    finally:
        client.close()


@contextmanager
def _own_cluster(cluster: Cluster, tasks: int, folder: Path) -> Iterator[tuple[Any, int]]:
    """A cluster of ours, and the number of its workers: no more than there are tasks."""
    count = cluster.workers or available_cpus()
    if cluster.slurm is not None:
        with slurm_cluster(cluster.slurm, folder, cluster.dashboard) as (made, processes):
            jobs = max(1, min(count, -(-tasks // processes)))
            made.scale(jobs=jobs)
            yield made, jobs * processes
    else:
        count = max(1, min(count, tasks))
        with local_cluster(count, cluster.dashboard) as made:
            yield made, count


def local_cluster(count: int, dashboard: str = DASHBOARD) -> Any:
    """A cluster of so many processes of this machine, with credentials of its own."""
    from distributed import LocalCluster

    with _told_in_one_line(), _interruption_ignored():
        return LocalCluster(
            n_workers=count,
            threads_per_worker=1,
            dashboard_address=dashboard,
            security=own_credentials(),
            memory_limit=0,
            preload=["taichisoft_studies.worker_start"],
        )


@contextmanager
def slurm_cluster(slurm: Mapping[str, Any], folder: Path, dashboard: str = DASHBOARD) -> Iterator[tuple[Any, int]]:
    """A cluster of SLURM without any job yet, and the number of workers that each of its jobs has.

    Args:
        slurm: arguments of `dask_jobqueue.SLURMCluster`.
        folder: where its credentials lie, see `credentials_in_files`, unless `slurm` has a "shared_temp_directory".
        dashboard: host and port of the dashboard.

    Raises:
        StudyError: an argument is not one of `dask_jobqueue.SLURMCluster`, or one that a study decides on.
    """
    from dask_jobqueue import SLURMCluster

    options = slurm.get("scheduler_options", {})
    decided = {"security", "protocol"} & {*slurm, *options}
    if decided:
        raise StudyError(f"cluster.slurm.{min(decided)}: leave it out; a study has TLS, with credentials of its own")
    if "dashboard_address" in options:
        raise StudyError("cluster.slurm.scheduler_options.dashboard_address: is called cluster.dashboard here")
    shared = Path(os.path.expandvars(slurm.get("shared_temp_directory", folder))).expanduser()
    with credentials_in_files(shared) as security:
        arguments = {
            "cores": 1,
            "processes": 1,
            "memory": "2GB",
            **slurm,
            "security": security,
            "scheduler_options": {**options, "dashboard_address": dashboard},
            "worker_extra_args": [*CLOSED_PAGE, *slurm.get("worker_extra_args", [])],
        }
        try:
            with _told_in_one_line():
                made = SLURMCluster(**arguments)
        except (TypeError, ValueError) as error:
            raise StudyError(f"cluster.slurm: {' '.join(str(error).split())}") from error
        with made:
            yield made, int(arguments["processes"])


@contextmanager
def _told_in_one_line() -> Iterator[None]:
    """Make an error of a cluster that cannot start, as where its dashboard's address is none of this machine's."""
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="Port .* is already in use")  # `_dashboard` says so
            yield
    except (OSError, RuntimeError) as error:
        raise StudyError(f"the workers cannot be started: {' '.join(str(error.__cause__ or error).split())}") from error


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


def _dashboard(own: Any, cluster: Cluster) -> str:
    """Where a cluster of ours has its dashboard: at the host that was asked for, and a port that was free."""
    from distributed.utils import format_dashboard_link

    host, _, asked = cluster.dashboard.rpartition(":")
    port = own.scheduler_info["services"]["dashboard"]
    taken = f" (port {asked} is taken)" if int(asked) not in (0, port) else ""
    return f"{format_dashboard_link(host, port)}{taken}"


def _about(count: int, dashboard: str | None) -> str:
    """A line about the workers, with the dashboard's address where it can be drawn."""
    page = dashboard if find_spec("bokeh") is not None else "none (pip install bokeh)"
    return f"{count} worker{'s' * (count != 1)}; dashboard: {page or 'none'}"
