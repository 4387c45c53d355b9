"""What studies leave open to others, and what they read back.

Every port of theirs is on this machine alone, and lets nobody in without the study's own credentials. A try of it
starts one of the commands that make runs, waits until its workers are there, and knocks at every port on which a
process of it listens. It needs Linux and the extra `studies`.
"""

import ipaddress
import random
import signal
import socket
import ssl
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from taichisoft.pytest_fixtures import TINY_GRIPPER
from taichisoft_benchmarks.studies.interrupted_sweep import COMMAND, PLUGIN

PATIENCE = 120.0
"""Longest time until a command says that its workers are there, and until it ends [s]."""
WAIT = 5.0
"""Longest time for an answer of a port [s]."""
ALERT = b"\x15"
"""First byte of what TLS says to somebody whom it refuses."""
PAUSE = "controller.settings.pause"

STUDY = f"""
scene = {str(TINY_GRIPPER)!r}
controller = "squeeze"
set = ["{PAUSE}=1.0"]
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
SWEEP = [str(TINY_GRIPPER), "--controller", "squeeze", "--set", f"{PAUSE}=1.0", "--vary", f"{PAUSE}=1.0,1.1"]
COMMANDS = {
    "sweep": SWEEP,
    "optimise": ["optimise.toml"],
    "calibrate": ["calibrate.toml"],
    "mesh-sweep": ["tutorial", "--vary", "body.width=20,21"],
}


def ports_of_studies(tries: int) -> list[str]:
    """Scan the ports of commands that make many runs, in turn; one line for each port that is open to others."""
    failures = []
    for number in range(tries):
        name = list(COMMANDS)[number % len(COMMANDS)]
        jobs = random.Random(f"ports {number}").randint(1, 3)
        with TemporaryDirectory() as folder, running_study(Path(folder), name, jobs) as study:
            ports = listening(study.pid)
            if len(ports) < 2 * jobs + 1:  # each worker and its nanny, and the scheduler
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
    command = [sys.executable, "-c", COMMAND, name, *words]
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
    """Addresses and ports on which a process and those below it listen."""
    import psutil

    found = set()
    for process in (top := psutil.Process(pid), *top.children(recursive=True)):
        with suppress(psutil.Error):  # it has just ended
            for one in process.net_connections("tcp"):
                if one.status == psutil.CONN_LISTEN:
                    found.add((one.laddr.ip, one.laddr.port))
    return sorted(found)


def open_doors(address: str, port: int) -> list[str]:
    """What is wrong with a port: it can be reached from elsewhere, or takes what comes without credentials.

    Pages over HTTP, which are only read, may lie on the loopback device.
    """
    problems = []
    if not ipaddress.ip_address(address).is_loopback:
        problems.append(f"{address}:{port} can be reached from other machines")
        address = "127.0.0.1"
    plain = _answer(address, port)
    if plain.startswith(b"HTTP"):
        return problems
    if plain and plain[:1] != ALERT:
        problems.append(f"{address}:{port} speaks to a client without TLS: {plain[:20]!r}")
    for who, certificate in (("no", None), ("a foreign", _foreign_certificate())):
        said = _answer(address, port, _context(certificate))
        if said:
            problems.append(f"{address}:{port} speaks to a client with {who} certificate: {said[:20]!r}")
    return problems


def _answer(address: str, port: int, context: ssl.SSLContext | None = None) -> bytes:
    """What a port says to a client that asks for a page; nothing where it ends the connection."""
    try:
        with socket.create_connection((address, port), WAIT) as raw:
            line = raw if context is None else context.wrap_socket(raw)
            line.sendall(b"GET / HTTP/1.0\r\n\r\n")
            return line.recv(100)
    except OSError:  # refused, or nothing came
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
    """A key and a certificate such as studies use, but of nobody's."""
    from distributed.security import Security

    made = Security.temporary()
    return made.tls_client_key, made.tls_client_cert


def damaged_tables(tries: int) -> list[str]:
    """Have pages written of studies whose table is damaged; a line for each that ends neither well nor in one line."""
    from taichisoft_benchmarks.faults.tries import how_it_went
    from taichisoft_studies.results import PARQUET, write_table

    failures = []
    row = {"seed": 1, "status": "completed", "message": "", "metrics.force": 1.5, "folder": "runs/x"}
    with TemporaryDirectory() as folder:
        table = Path(folder) / PARQUET
        write_table([{"run": f"r{number}", "pressure": 0.1 * number, **row} for number in range(40)], Path(folder))
        whole = table.read_bytes()
        for number in range(tries):
            dice = random.Random(f"table {number}")
            table.write_bytes(_damaged(whole, dice))
            failure = how_it_went(number, ["study", "report", folder])
            if failure is not None:
                failures.append(f"{failure.what}: {failure.problem}")
    return failures


def _damaged(content: bytes, dice: random.Random) -> bytes:
    """A table that was cut off, is another file, or has bits that have changed."""
    kind = dice.randrange(4)
    if kind == 0:
        return content[: dice.randrange(len(content))]
    if kind == 1:
        return dice.randbytes(dice.randrange(2000))
    changed = bytearray(content)
    for _ in range(dice.choice([1, 3, 20])):
        changed[dice.randrange(len(changed))] ^= 1 << dice.randrange(8)
    return bytes(changed)


SCAN = "scans of all ports that a sweep, optimisation, calibration or sweep of meshes opens"
TABLES = "reports of studies whose table is damaged"
ROWS: dict[str, Callable[[int], list[str]]] = {SCAN: ports_of_studies, TABLES: damaged_tables}
TRIES = {SCAN: 20, TABLES: 1000}
