"""Access to the workers of a study: credentials, Dask's dashboard, and warnings.

Whoever may speak to a Dask scheduler, or to one of its workers, can have any code run. So clusters that a study starts
speak TLS alone, with a key that is made for them, and ends with them; see docs/studies.md for others.
"""

import ipaddress
import os
import shlex
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from taichisoft.atomic_file import named_os_errors
from taichisoft_studies.errors import StudyError
from taichisoft_studies.study_file import Cluster

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
