"""A run of an hour in real time with a page and a recording: what its memory and its files grow by."""

import subprocess
import time
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from taichisoft.child_process import PYTHON

ROOM = 0.3
"""Given to the recording [GB]."""
BETWEEN = 20.0
"""Time between two looks [s]."""
SETTLED = 300.0
"""Time after which everything that a run needs has been made [s]."""


@dataclass(frozen=True)
class Growth:
    """What became of a long run.

    Attributes:
        exit_code: of its process.
        memory: by how much its resident memory was larger at most than when it had settled [MB].
        files: the largest size of its folder [MB].
    """

    exit_code: int
    memory: float
    files: float


def soak(seconds: float, scene: str = "finger-inflated") -> Growth:
    """Let a scene run in real time, steered by nobody; Linux tells of its memory."""
    with TemporaryDirectory() as folder:
        arguments = ["run", scene, "--controller", "keyboard", "--speed", "1", "--duration", str(seconds)]
        arguments += ["--web", "--web-address", "127.0.0.1:0", "--record-limit", str(ROOM), "-o", folder + "/run"]
        process = subprocess.Popen([*PYTHON, "-m", "taichisoft", *arguments], stdin=subprocess.DEVNULL)
        looks: list[tuple[float, float]] = []
        largest, started = 0.0, time.monotonic()
        try:
            while process.poll() is None:
                looks.append((time.monotonic() - started, _resident_memory(process.pid)))
                largest = max(largest, _size(Path(folder)))
                time.sleep(min(BETWEEN, 0.02 * seconds))
        finally:
            process.kill()
            process.wait()
    settled = next(memory for moment, memory in looks if moment >= min(SETTLED, 0.5 * seconds))
    highest = max(memory for moment, memory in looks if moment >= min(SETTLED, 0.5 * seconds))
    return Growth(process.returncode, highest - settled, largest)


def _resident_memory(process: int) -> float:
    """Of a process [MB]; 0 when it has ended."""
    try:
        lines = Path(f"/proc/{process}/status").read_text().splitlines()
    except OSError:
        return 0.0
    return next((int(line.split()[1]) / 1024.0 for line in lines if line.startswith("VmRSS")), 0.0)


def _size(folder: Path) -> float:
    """Of all files in a folder [MB]."""
    total = 0
    for path in folder.rglob("*"):
        try:
            total += path.stat().st_size if path.is_file() else 0
        except OSError:  # it has just been removed
            continue
    return total / 1e6
