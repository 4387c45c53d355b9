"""The sparse factorisation alone, alternating with other libraries on the same matrix.

They alternate so that other work on the machine slows all of them alike.
"""

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import scipy.sparse as sparse

from taichisoft import Scene
from taichisoft_benchmarks import machine
from taichisoft_benchmarks.cases import FactorisationCase
from taichisoft_benchmarks.errors import PeerMissing
from taichisoft_benchmarks.measures.measured import Measured, peak_memory
from taichisoft_benchmarks.peers.factorisations import prepare_cholmod, prepare_superlu

WARM_UP = 3
DENSE_MFLOP = 2.0 * machine.DENSE_SIZE**3 / 1e6


def measure_factorisation(case: FactorisationCase, scene: Scene) -> Measured:
    """Median times to factorise the matrix of the first step."""
    from taichisoft.mechanics import ElasticSystem
    from taichisoft.running import make_model

    model = make_model(scene)
    assert model.elasticity is not None
    system = ElasticSystem(model.elasticity)
    system.position[:] = model.rest_position
    system.assemble()
    solver, symbolic = system.solver, system.solver.symbolic
    matrix = system_matrix(symbolic.block_pairs, solver.blocks, model.node_count)
    contestants: dict[str, Callable[[], Any]] = {
        "factorise": partial(solver.factorise, np.zeros((model.node_count, 3)))
    }
    facts: dict[str, Any] = {
        "nodes": model.node_count,
        "unknowns": matrix.shape[0],
        "factor_entries": int(symbolic.factor_entries),
    }
    for name, prepare in (("cholmod", prepare_cholmod), ("superlu", prepare_superlu)):
        try:
            contestants[name] = prepare(matrix)
        except PeerMissing as missing:
            facts[f"{name}_skipped"] = str(missing)
    facts["mflop"] = round(arithmetic(contestants["superlu"]().L), 2)
    times = _in_turns(contestants, case.rounds)
    # Speed of a dense product on the case's threads, an upper bound for any factorisation.
    facts["dense_gflops"] = round(DENSE_MFLOP / machine.measure()["dense_ms"], 1)
    measured = Measured({f"{name}_ms": median for name, median in times.items()}, facts)
    for name in ("cholmod", "superlu"):
        if name in times:
            measured.figures[f"ratio_to_{name}"] = times["factorise"] / times[name]
    measured.figures["peak_mb"] = peak_memory()
    return measured


def system_matrix(block_pairs: np.ndarray, blocks: np.ndarray, node_count: int) -> sparse.csc_matrix:
    """The whole symmetric matrix from the stored 3x3 blocks of one half.

    Args:
        block_pairs: nodes of each block's row and column, shape (block_count, 2).
        blocks: blocks on and below the diagonal, shape (block_count, 3, 3).
        node_count: number of nodes; the matrix has three rows for each.
    """
    axes = np.arange(3)
    rows = np.broadcast_to(3 * block_pairs[:, 0, None, None] + axes[:, None], blocks.shape)
    columns = np.broadcast_to(3 * block_pairs[:, 1, None, None] + axes[None, :], blocks.shape)
    size = (3 * node_count, 3 * node_count)
    half = sparse.coo_matrix((blocks.ravel(), (rows.ravel(), columns.ravel())), size)
    off_diagonal = np.repeat(block_pairs[:, 0] != block_pairs[:, 1], 9)
    other = sparse.coo_matrix((half.data[off_diagonal], (half.col[off_diagonal], half.row[off_diagonal])), size)
    return (half + other).tocsc()


def arithmetic(factor: sparse.csc_matrix) -> float:
    """Number of multiplications and additions of a Cholesky factorisation with this factor's pattern [millions]."""
    in_column = np.diff(factor.indptr).astype(float)
    return float((in_column**2).sum() / 1e6)


def _in_turns(contestants: dict[str, Callable[[], Any]], rounds: int) -> dict[str, float]:
    """Median time of each contestant [ms]."""
    times: dict[str, list[float]] = {name: [] for name in contestants}
    for _ in range(WARM_UP + rounds):
        for name, factorise in contestants.items():
            factorise()  # untimed: the caches hold another contestant's numbers
            started = time.perf_counter()
            factorise()
            times[name].append(1e3 * (time.perf_counter() - started))
    return {name: float(np.median(some[WARM_UP:])) for name, some in times.items()}
