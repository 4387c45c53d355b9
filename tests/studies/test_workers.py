"""Workers of this machine, of a scheduler elsewhere, and of jobs that SLURM is given, and who can reach them."""

import json
import os
import re
import socket
import ssl
import stat
import struct
import subprocess
import sys
import time
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from conftest import PATIENCE
from ports import listening, open_doors, ports_of_studies
from rich.console import Console
from studies import command

from taichisoft_studies import workers
from taichisoft_studies.errors import StudyError
from taichisoft_studies.study_commands import announced_workers
from taichisoft_studies.study_file import Cluster, Study, check_study
from taichisoft_studies.workers import dask_workers, own_credentials, slurm_cluster

ROOT = Path(__file__).parents[2]
BLOCK = ROOT / "tests" / "meshing" / "block_kind.py"


DOCUMENT = (ROOT / "docs" / "studies.md").read_text(encoding="utf-8")
FAKE_SLURM = """#!/bin/sh
cp "$1" job.sh
sh job.sh >job.log 2>&1 &
echo "Submitted batch job $!" | tee job.id
"""
"""A `sbatch` whose jobs run here."""


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A user's folder with the key and Dask's settings that the document has them make."""
    folder = tmp_path / "home of 1"
    folder.mkdir()
    monkeypatch.setenv("HOME", str(folder))
    (shown,) = re.findall(r"```sh\n(umask .*?)```", DOCUMENT, re.DOTALL)
    subprocess.run(["sh", "-ec", shown], check=True, capture_output=True, timeout=PATIENCE)
    return folder


@pytest.fixture
def scheduler(tmp_path: Path, home: Path) -> Iterator[str]:
    """The address of a scheduler with TLS that has one worker, started as the document says, but on free ports."""
    told = tmp_path / "scheduler.json"
    first, second = re.findall(r"^\$ dask (?:scheduler|worker tls://HOST:8786) (.*?) *#", DOCUMENT, re.MULTILINE)
    here = ["--scheduler-file", str(told)]
    both = [
        ["dask_scheduler", *first.replace(":8787", ":0").split(), "--host", "127.0.0.1", "--port", "0", *here],
        ["dask_worker", *second.replace("--nworkers 16", "--nworkers 1").split(), *here],
    ]
    processes = []
    for words in both:
        processes.append(
            subprocess.Popen(
                [sys.executable, "-m", f"distributed.cli.{words[0]}", *words[1:]],
                cwd=tmp_path,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
        )
        while not told.exists():
            assert processes[0].poll() is None
            time.sleep(0.05)
    yield json.loads(told.read_text())["address"]
    for process in processes:
        process.terminate()
        process.wait(timeout=PATIENCE)


def block(folder: Path) -> Path:
    path = folder / "block.toml"
    path.write_text('kind = "block"\nsolid = true\n')
    return path


def test_a_sweep_is_made_by_the_workers_of_a_scheduler_with_tls(
    tmp_path: Path, scheduler: str, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Set up as the document says; who has not the key is refused in one line."""
    output = tmp_path / "out"
    told = ["--vary", "stretch=1,2", "-o", output, "--plugin", BLOCK, "--scheduler", scheduler]
    done = command("mesh", "sweep", block(tmp_path), *told)
    assert (done.returncode, done.stderr) == (0, "")
    assert "warning" not in done.stdout
    assert sorted(path.name for path in output.iterdir()) == ["stretch-1", "stretch-2", "summary.csv"]
    assert {stat.S_IMODE(path.stat().st_mode) for path in (home / ".config" / "dask").glob("*.pem")} == {0o600}
    monkeypatch.setenv("HOME", str(tmp_path))
    refused = command("mesh", "sweep", block(tmp_path), *told)
    (line,) = refused.stderr.splitlines()
    assert line.startswith(f"taichisoft: --scheduler {scheduler}: needs credentials")


def test_workers_of_a_study_let_in_nobody_without_its_credentials(tmp_path: Path) -> None:
    """Dask's own client without TLS, and one with credentials of another study; then every port that is there."""
    from distributed import Client
    from distributed.security import Security

    with dask_workers(Cluster(workers=1), 1, tmp_path) as workers:
        address = workers._client.scheduler.address
        assert address.startswith("tls://127.0.0.1:")
        workers.submit("ours", len, "abc")
        assert workers.next_done() == ("ours", 3)
        for uri, security in ((address.replace("tls", "tcp"), None), (address, Security.temporary())):
            with pytest.raises(OSError, match=r"closed|certificate"):
                Client(uri, security=security, timeout=PATIENCE)
        ports = listening(os.getpid())
        assert len(ports) >= 3
        assert [problem for one in ports for problem in open_doors(*one)] == []


@pytest.mark.parametrize("broken_python", [False, True])
def test_a_connection_does_not_end_for_the_error_of_another(
    broken_python: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One of two connections of a thread is reset, and used on; the other then still waits for what is sent to it.

    On this Python as it is, and on one that gives every error of the system to the next connection as well.
    """
    left: list[OSError] = []  # of a connection, for the next one

    def giving_it_on(read: Callable[..., Any]) -> Callable[..., Any]:
        def done(self: ssl.SSLSocket, *arguments: Any) -> Any:
            if left:
                raise left.pop()
            try:
                return read(self, *arguments)
            except ssl.SSLWantReadError:
                raise
            except OSError:
                left.append(BrokenPipeError("of another connection"))
                raise

        return done

    if broken_python:
        for name in ("read", "send"):
            monkeypatch.setattr(ssl.SSLSocket, name, giving_it_on(getattr(ssl.SSLSocket, name)))
    with encrypted_pair() as (gone, breaking), encrypted_pair() as (sender, healthy):
        gone.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # closing it resets it
        gone.close()
        for _ in range(3):
            with suppress(OSError):
                breaking.send(b"into the void")
            with pytest.raises(ssl.SSLWantReadError):
                healthy.recv(1)
        sender.send(b"x")
        healthy.setblocking(True)
        assert healthy.recv(1) == b"x"


@contextmanager
def encrypted_pair() -> Iterator[tuple[ssl.SSLSocket, ssl.SSLSocket]]:
    """Two ends of a connection of a study's workers, which do not wait for each other: client and server."""
    security = own_credentials()
    with socket.create_server(("127.0.0.1", 0)) as listener:
        plain = socket.create_connection(listener.getsockname())
        ends = [
            security.get_connection_args("client")["ssl_context"].wrap_socket(plain, do_handshake_on_connect=False),
            security.get_listen_args("scheduler")["ssl_context"].wrap_socket(
                listener.accept()[0], server_side=True, do_handshake_on_connect=False
            ),
        ]
    waiting = list(ends)
    for end in ends:
        end.setblocking(False)
    while waiting:
        with suppress(ssl.SSLWantReadError):
            waiting[0].do_handshake()
            waiting.pop(0)
        waiting.reverse()
    with ends[0], ends[1]:
        yield ends[0], ends[1]


def test_the_command_opens_no_port_to_others() -> None:
    """What listens while a study runs is open to its own processes alone."""
    assert ports_of_studies(1) == []


@pytest.mark.parametrize(
    ("tables", "said"),
    [
        ({}, []),
        ({"dashboard": "localhost:8787"}, []),
        ({"scheduler": "tls://far:8786"}, []),
        ({"dashboard": "0.0.0.0:8787"}, ["dashboard = '0.0.0.0:8787': it asks for no password"]),
        ({"dashboard": "192.168.1.5:0"}, ["dashboard = '192.168.1.5:0': it asks for no password"]),
        ({"scheduler": "tcp://far:8786"}, ["--scheduler tcp://far:8786: without TLS"]),
        ({"scheduler": "far:8786"}, ["--scheduler far:8786: without TLS"]),
    ],
)
def test_what_others_can_reach_is_warned_of(
    tables: dict[str, str], said: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    @contextmanager
    def none(*_: Any) -> Iterator[Any]:
        yield SimpleNamespace(about="none")

    monkeypatch.setattr(workers, "dask_workers", none)
    console = Console(record=True, width=1000)
    with announced_workers(console, Cluster(**tables), 1, tmp_path):
        pass
    *lines, about = console.export_text().splitlines()
    assert about == "none"
    assert [line.partition(";")[0] for line in lines] == [f"warning: {one}" for one in said]


@pytest.mark.parametrize("address", ["8787", ":8787", "[::1]:8787", "far:", "far:x", "far:70000", "a:1,b:2", ""])
def test_an_address_of_the_dashboard_that_is_none_is_one_line(address: str) -> None:
    with pytest.raises(
        StudyError, match=r"^study: cluster: dashboard = '.*': must look like 127\.0\.0\.1:0"
    ) as refused:
        check_study(Study, {"scene": "gripper", "cluster": {"dashboard": address}}, "study")
    assert "\n" not in str(refused.value)


def test_a_dashboard_beside_a_scheduler_is_refused() -> None:
    cluster = {"dashboard": "127.0.0.1:8787", "scheduler": "tls://far:8786"}
    with pytest.raises(StudyError, match=r"^study: cluster: dashboard is that of .*; leave it out beside scheduler$"):
        check_study(Study, {"scene": "gripper", "cluster": cluster}, "study")


def test_the_dashboard_that_cannot_listen_is_one_line_and_a_port_that_is_taken_is_said(tmp_path: Path) -> None:
    with (
        pytest.raises(StudyError, match=r"^the workers cannot be started: .*"),
        dask_workers(Cluster(workers=1, dashboard="192.0.2.77:0"), 1, tmp_path),
    ):
        pass
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with dask_workers(Cluster(workers=1, dashboard=f"127.0.0.1:{port}"), 1, tmp_path) as made:
            assert f"(port {port} is taken)" in made.about
            assert f":{port}/" not in made.about


def test_the_jobs_of_slurm_are_those_that_the_document_asks_for(tmp_path: Path) -> None:
    pytest.importorskip("dask_jobqueue")
    (shown,) = re.findall(r"```toml\n(\[cluster\]\nworkers = .*?)```", DOCUMENT, re.DOTALL)[-1:]
    with slurm_cluster(tomllib.loads(shown)["cluster"]["slurm"], tmp_path) as (cluster, processes):
        script = cluster.job_script()
    assert processes == 16
    for line in ("-p normal", "-A my-project", "-n 1", "--cpus-per-task=16", "--mem=30G", "-t 04:00:00"):
        assert f"#SBATCH {line}\n" in script
    *_, prologue, worker = script.strip().splitlines()
    assert prologue == "source ~/soft/bin/activate"
    assert "--nworkers 16" in worker
    assert "--nthreads 1" in worker


@pytest.mark.skipif(sys.platform != "linux", reason="looks for the ports of processes")
def test_the_jobs_of_slurm_have_credentials_that_their_user_alone_can_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a folder whose name a shell would split; the files vanish with the cluster.

    In a process of its own, as a study is: on Python 3.13 a second SLURM cluster of a process loses its connections.
    """
    pytest.importorskip("dask_jobqueue")
    for name, text in (("sbatch", FAKE_SLURM), ("scancel", "#!/bin/sh\n")):
        (tmp_path / name).write_text(text)
        (tmp_path / name).chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    program = [sys.executable, Path(__file__).with_name("study_on_slurm.py"), "it's a study"]
    subprocess.run(program, cwd=tmp_path, check=True, timeout=PATIENCE)


def test_an_argument_that_slurm_does_not_know_is_one_line(tmp_path: Path) -> None:
    pytest.importorskip("dask_jobqueue")
    for told, problem in (
        ({"kue": "normal"}, r": .*kue"),
        ({"security": False}, r"\.security: leave it out"),
        ({"scheduler_options": {"protocol": "tcp"}}, r"\.protocol: leave it out"),
        ({"scheduler_options": {"dashboard_address": ":8787"}}, r"\..*: is called cluster.dashboard here"),
    ):
        with pytest.raises(StudyError, match=rf"^cluster\.slurm{problem}"), slurm_cluster(told, tmp_path):
            pass
