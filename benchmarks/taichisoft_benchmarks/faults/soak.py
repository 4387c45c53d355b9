"""A run of an hour in real time with a page and a recording: growth of its memory, and size of its files."""

import subprocess
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from taichisoft.base import PYTHON

SCENE = "finger-inflated"
ROOM = 0.3
"""Limit of the recording [GB]."""
BETWEEN = 20.0
"""Time between two measurements of the memory [s]."""
SETTLED = 300.0
"""Time after which a run has made all that it needs [s]."""
GROWTH = 20.0
"""Most that the memory may grow by after that [MB]."""


def soak(seconds: int) -> list[str]:
    """Run a scene in real time without input; the memory is measured on Linux."""
    with TemporaryDirectory() as folder:
        arguments = ["run", SCENE, "--controller", "keyboard", "--speed", "1", "--duration", str(seconds)]
        arguments += ["--web", "--web-address", "127.0.0.1:0", "--record-limit", str(ROOM), "-o", folder + "/run"]
        process = subprocess.Popen([*PYTHON, "-m", "taichisoft", *arguments], stdin=subprocess.DEVNULL)
        memories: list[tuple[float, float]] = []
        largest, started = 0.0, time.monotonic()
        try:
            while process.poll() is None:
                memories.append((time.monotonic() - started, _resident_memory(process.pid)))
                largest = max(largest, _size(Path(folder)))
                time.sleep(min(BETWEEN, 0.02 * seconds))
        finally:
            process.kill()
            process.wait()
    later = [memory for moment, memory in memories if moment >= min(SETTLED, 0.5 * seconds)]
    growth = max(later) - later[0]
    print(f"# memory grew by {growth:.1f} MB to {max(later):.0f} MB, files {largest:.0f} MB at most")
    failures = [f"exit code {process.returncode}"] * (process.returncode != 0)
    return failures + [f"the memory grew by {growth:.1f} MB"] * (growth > GROWTH)


def _resident_memory(process: int) -> float:
    """Resident memory of a process [MB]; 0 if it has ended."""
    try:
        lines = Path(f"/proc/{process}/status").read_text().splitlines()
    except OSError:
        return 0.0
    return next((int(line.split()[1]) / 1024.0 for line in lines if line.startswith("VmRSS")), 0.0)


def _size(folder: Path) -> float:
    """Size of all files in a folder [MB]."""
    total = 0
    for path in folder.rglob("*"):
        try:
            total += path.stat().st_size if path.is_file() else 0
        except OSError:  # it has just been removed
            continue
    return total / 1e6


ROWS = {"seconds of a run in real time with a page and a recording": (3600, soak)}
