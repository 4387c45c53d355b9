"""Ports that studies open: each must be on this machine alone, and refuse clients without the study's own credentials.

A try starts one of the commands that make runs, waits until its workers are there, and asks every port on which one of
its processes listens. It needs Linux and the extra `studies`.
"""

import ipaddress
import random
import signal
import socket
import ssl
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from interrupted_sweep import PLUGIN

from taichisoft.base import PYTHON
from taichisoft.pytest_fixtures import TINY_GRIPPER

PATIENCE = 600.0
"""Longest time until the workers of a command are there, and until it ends [s]."""
WAIT = 5.0
"""Longest time for an answer of a port [s]."""
ALERT = b"\x15"
"""First byte of the answer of TLS to a client that it refuses."""
PAUSE = "controller.settings.pause"
"""Of every step: runs last until they are ended, however late the last worker comes on a busy machine."""

STUDY = f"""
scene = {str(TINY_GRIPPER)!r}
controller = "squeeze"
set = ["{PAUSE}=10.0"]
"""
OPTIMISATION = """
[variables]
"controller.settings.pressure" = { low = 1.0, high = 2.0 }
[objectives]
time = { maximise = "simulated_time" }
"""
CALIBRATION = """
[parameters]
"controller.settings.pressure" = { start = 1.5, low = 1.0, high = 2.0 }
[[experiments]]
data = "data.csv"
over = "time"
over_column = "time"
[[experiments.curves]]
column = "pressure"
quantity = "pressures['left']['cavity']"
"""
SWEEP = [str(TINY_GRIPPER), "--controller", "squeeze", "--set", f"{PAUSE}=10.0", "--vary", f"{PAUSE}=10.0,10.1"]
COMMANDS = {
    "study sweep": SWEEP,
    "study optimise": ["optimise.toml"],
    "study calibrate": ["calibrate.toml"],
    "mesh sweep": ["tutorial", "--vary", "body.width=20:24:20"],
}


def ports_of_studies(tries: int) -> list[str]:
    """Scan the ports of commands that make many runs, in turn; one line for each port that is open to others."""
    failures = []
    for number in range(tries):
        name = list(COMMANDS)[number % len(COMMANDS)]
        jobs = random.Random(f"ports {number}").randint(1, 3)
        with TemporaryDirectory() as folder, running_study(Path(folder), name, jobs) as study:
            expected, until = 2 * jobs + 1, time.monotonic() + PATIENCE  # each worker and its nanny, and the scheduler
            while len(ports := listening(study.pid)) < expected and time.monotonic() < until and study.poll() is None:
                time.sleep(0.1)
            if len(ports) < expected:
                failures.append(f"{name}: only {len(ports)} ports were found")
            failures += [f"{name}: {problem}" for address, port in ports for problem in open_doors(address, port)]
    return failures


@contextmanager
def running_study(folder: Path, name: str, jobs: int) -> "Iterator[subprocess.Popen[str]]":
    """A command of COMMANDS in a process of its own, from when its workers are there."""
    (folder / "squeeze.py").write_text(PLUGIN)
    (folder / "data.csv").write_text("time,pressure\n0.02,1.0\n0.04,1.1\n")
    (folder / "optimise.toml").write_text(STUDY + OPTIMISATION)
    (folder / "calibrate.toml").write_text(STUDY + CALIBRATION)
    words = [*COMMANDS[name], "-o", "out", "--jobs", str(jobs), "--plugin", "squeeze.py"]
    command = [*PYTHON, "-m", "taichisoft", *name.split(), *words]
    with (folder / "output").open("w") as output:
        study = subprocess.Popen(command, cwd=folder, stdout=output, stderr=output, text=True)
    try:
        until = time.monotonic() + PATIENCE
        while "dashboard:" not in (folder / "output").read_text():
            if study.poll() is not None or time.monotonic() > until:
                raise RuntimeError(f"{name} has no workers: {(folder / 'output').read_text()[-500:]}")
            time.sleep(0.1)
        yield study
    finally:
        with suppress(ProcessLookupError):
            study.send_signal(signal.SIGTERM)
        study.wait(PATIENCE)


def listening(pid: int) -> list[tuple[str, int]]:
    """Addresses and ports on which a process and its descendants listen."""
    import psutil

    found = set()
    for process in (top := psutil.Process(pid), *top.children(recursive=True)):
        with suppress(psutil.Error):  # it has just ended
            for one in process.net_connections("tcp"):
                if one.status == psutil.CONN_LISTEN:
                    found.add((one.laddr.ip, one.laddr.port))
    return sorted(found)


def open_doors(address: str, port: int) -> list[str]:
    """What is wrong with a port: other machines reach it, or it serves clients without credentials.

    Pages over HTTP, which are read-only, are allowed on the loopback device.
    """
    problems = []
    if not ipaddress.ip_address(address).is_loopback:
        problems.append(f"{address}:{port} can be reached from other machines")
        address = "127.0.0.1"
    plain = _answer(address, port)
    if plain.startswith(b"HTTP"):
        return problems
    if plain and plain[:1] != ALERT:
        problems.append(f"{address}:{port} answers a client without TLS: {plain[:20]!r}")
    for who, certificate in (("no", None), ("a foreign", _foreign_certificate())):
        said = _answer(address, port, _context(certificate))
        if said:
            problems.append(f"{address}:{port} answers a client with {who} certificate: {said[:20]!r}")
    return problems


def _answer(address: str, port: int, context: ssl.SSLContext | None = None) -> bytes:
    """Answer of a port to a client that asks for a page; empty if it ends the connection."""
    try:
        with socket.create_connection((address, port), WAIT) as raw:
            line = raw if context is None else context.wrap_socket(raw)
            line.sendall(b"GET / HTTP/1.0\r\n\r\n")
            return line.recv(100)
    except OSError:  # refused, or no answer
        return b""


def _context(certificate: tuple[str, str] | None) -> ssl.SSLContext:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    if certificate is not None:
        with TemporaryDirectory() as folder:
            path = Path(folder) / "both.pem"
            path.write_text("".join(certificate))
            context.load_cert_chain(path)
    return context


@cache
def _foreign_certificate() -> tuple[str, str]:
    """A key and a certificate as studies use them, of another study."""
    from distributed.security import Security

    made = Security.temporary()
    return made.tls_client_key, made.tls_client_cert
