"""The machine of a benchmark: processor, memory, load, versions, and how fast it does a fixed piece of work.

The work is a dense product and a sparse factorisation, the two kinds of arithmetic of a step; results of different
machines compare as ratios to its times. `calibrate` does it in a process of its own on one thread, whatever threads
a case has.
"""

import os
import platform
import subprocess
import time
from collections.abc import Callable
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from taichisoft.base import call_apart

PACKAGES = ("taichisoft", "taichi", "numpy", "scipy", "gmsh", "open3d-cpu", "cvxopt", "mujoco")
ONE_THREAD = {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")}
DENSE_SIZE = 384
GRID = 12
ROUNDS = 7


def describe_machine() -> dict[str, str]:
    """Processor, memory and versions of the system."""
    memory = 0
    with suppress(AttributeError, ValueError, OSError):
        memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return {
        "system": f"{platform.system()} {platform.machine()}",
        "processor": _processor(),
        "cores": str(os.cpu_count()),
        "memory_gb": f"{memory / 2**30:.1f}" if memory else "unknown",
        "python": platform.python_version(),
    }


def versions() -> dict[str, str]:
    """Versions of the packages that matter and are installed, and the commit when the code is a checkout."""
    installed = {}
    for package in PACKAGES:
        with suppress(PackageNotFoundError):
            installed[package] = version(package)
    commit = _commit()
    return {**installed, "commit": commit} if commit else installed


def load() -> float:
    """Mean number of runnable processes in the last minute; 0 if the system does not report it."""
    return round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else 0.0


def calibrate() -> float:
    """Geometric mean of the times of both pieces of work on one thread [ms]."""
    times = call_apart("taichisoft_benchmarks.machine:measure", time_limit=60.0, environment=ONE_THREAD)
    return float((times["dense_ms"] * times["sparse_ms"]) ** 0.5)


def measure() -> dict[str, float]:
    """Least time of each piece of work in a few rounds [ms]."""
    import numpy as np
    import scipy.sparse as sparse
    from scipy.sparse.linalg import splu

    random = np.random.default_rng(0)
    left, right = random.random((2, DENSE_SIZE, DENSE_SIZE))
    line = sparse.diags([-1.0, 2.1, -1.0], [-1, 0, 1], (GRID, GRID))
    unit = sparse.identity(GRID)
    laplacian = (
        sparse.kron(sparse.kron(line, unit), unit)
        + sparse.kron(sparse.kron(unit, line), unit)
        + sparse.kron(sparse.kron(unit, unit), line)
    ).tocsc()
    return {"dense_ms": _least(lambda: left @ right), "sparse_ms": _least(lambda: splu(laplacian))}


def _least(work: Callable[[], object]) -> float:
    times = []
    for _ in range(ROUNDS):
        started = time.perf_counter()
        work()
        times.append(1e3 * (time.perf_counter() - started))
    return min(times)


def _processor() -> str:
    with suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or "unknown"


def _commit() -> str:
    """Short name of the commit, with + when files differ from it; empty outside a checkout."""
    folder = Path(__file__).resolve().parents[2]
    if not (folder / ".git").exists():
        return ""
    try:
        return subprocess.run(
            ["git", "describe", "--always", "--dirty=+", "--exclude=*"],
            cwd=folder,
            capture_output=True,
            text=True,
            check=True,
        ).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return ""
