"""What this machine needs for a fixed piece of work, so that results of different machines compare as ratios.

    python -m taichisoft_benchmarks.calibration

Prints JSON with the milliseconds of a dense product and of a sparse factorisation, the two kinds of arithmetic that
a step is made of. It runs in a process of its own on one thread of the numerical library: how many threads a case
has must not change what it is divided by.
"""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable

ONE_THREAD = {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")}
DENSE_SIZE = 384
GRID = 12
ROUNDS = 7


def calibrate() -> float:
    """Geometric mean of the two times [ms]."""
    child = subprocess.run(
        [sys.executable, "-m", "taichisoft_benchmarks.calibration"],
        env={**os.environ, **ONE_THREAD},
        capture_output=True,
        text=True,
        check=True,
    )
    times = json.loads(child.stdout)
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


if __name__ == "__main__":
    print(json.dumps(measure()))
