"""The sparse direct solver against numpy's dense one."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sparse
from conftest import PATIENCE, examples
from hypothesis import given
from hypothesis import strategies as st

from taichisoft.errors import MeshError, NotPositiveDefinite
from taichisoft.mechanics import cholesky
from taichisoft.mechanics.cholesky import Cholesky, SymbolicFactor
from taichisoft.mechanics.elimination_order import share_out_branches
from taichisoft.mechanics.kernels.sparse_columns import GROUP, NOWHERE, SparseColumns
from taichisoft.mechanics.kernels.substitution import back, forward
from taichisoft.runtime.arithmetic import BEGUN, FINISHED


def random_pattern(seed: int, sizes: list[int], neighbours: float) -> sparse.csr_matrix:
    """Graph of independent bodies of `sizes` nodes, each node joined to some others of its body at random."""
    random = np.random.default_rng(seed)
    blocks = []
    for size in sizes:
        joined = random.random((size, size)) < min(1.0, neighbours / size)
        blocks.append(joined | joined.T | np.eye(size, dtype=bool))
    return sparse.csr_matrix(sparse.block_diag(blocks, format="csr"), dtype=float)


def fill(solver: Cholesky, matrix: np.ndarray) -> None:
    """Hand a dense matrix to the solver."""
    for block, (row, column) in zip(solver.blocks, solver.symbolic.block_pairs, strict=True):
        block[:] = matrix[3 * row : 3 * row + 3, 3 * column : 3 * column + 3]


def random_matrix(seed: int, pattern: sparse.csr_matrix) -> np.ndarray:
    """Symmetric positive definite with that pattern of 3x3 blocks, condition number about a million."""
    random = np.random.default_rng(seed)
    mask = np.kron(pattern.toarray() != 0, np.ones((3, 3)))
    matrix = random.normal(size=mask.shape) * mask
    matrix = matrix + matrix.T
    matrix += np.diag(np.abs(matrix).sum(axis=1) + 0.1)
    scale = 10.0 ** random.uniform(-1.5, 1.5, len(matrix))
    return scale[:, None] * matrix * scale


@examples(60)
@given(
    seed=st.integers(0, 10**6),
    sizes=st.lists(st.integers(1, 30), min_size=1, max_size=4),
    neighbours=st.floats(0.0, 6.0),
)
def test_solutions_are_those_of_a_dense_solver(seed: int, sizes: list[int], neighbours: float) -> None:
    """Any bodies of any pattern, single nodes and full matrices included; twice with one analysis.

    Tolerance: round-off of numbers scaled over six decades; the residual of a stable solver stays at 1e-13.
    """
    pattern = random_pattern(seed, sizes, neighbours)
    solver = Cholesky(SymbolicFactor(pattern))
    for again in range(2):
        matrix = random_matrix(seed + again, pattern)
        fill(solver, matrix)
        right = np.random.default_rng(seed).normal(size=(sum(sizes), 3))
        solver.factorise(np.ones_like(right))
        solution = solver.solve(right)
        residual = np.abs(matrix @ solution.reshape(-1) - right.reshape(-1))
        scale = np.abs(matrix) @ np.abs(solution.reshape(-1)) + np.abs(right.reshape(-1))
        assert (residual <= 1e-13 * scale).all()
        np.testing.assert_allclose(solution.reshape(-1), np.linalg.solve(matrix, right.reshape(-1)), rtol=1e-8)


@examples(30)
@given(seed=st.integers(0, 10**6), sizes=st.lists(st.integers(1, 25), min_size=1, max_size=4), rows=st.integers(1, 20))
def test_impulses_in_rows_cost_no_further_solve(seed: int, sizes: list[int], rows: int) -> None:
    """A^-1 (b + J^T lambda) from Y = L^-1 J^T, with rows that act on a few nodes, so that they may reach no other body;
    and what b alone does to the rows is Y^T L^-1 b.

    Tolerance: round-off of numbers scaled over six decades.
    """
    random = np.random.default_rng(seed)
    pattern = random_pattern(seed, sizes, 4.0)
    solver = Cholesky(SymbolicFactor(pattern))
    matrix = random_matrix(seed, pattern)
    fill(solver, matrix)
    given = random.normal(size=(sum(sizes), 3))
    solver.factorise(given)
    jacobian = np.zeros((rows, len(matrix)))
    for row in jacobian:
        row[random.integers(len(matrix), size=3)] = random.normal(size=3)
    in_order = (3 * solver.symbolic.order[:, None] + np.arange(3)).reshape(-1)
    y = np.linalg.solve(np.linalg.cholesky(matrix[np.ix_(in_order, in_order)]), jacobian.T[in_order])
    groups, node_count = -(-rows // GROUP), sum(sizes)
    owner = np.repeat(solver.symbolic.tree.supernode_of_position, 3)
    place = np.full((groups, len(solver.symbolic.tree.parent)), NOWHERE, dtype=np.int32)
    entries: list[np.ndarray] = []
    for g in range(groups):
        some = np.zeros((3 * node_count, GROUP))
        some[:, : rows - GROUP * g] = y[:, GROUP * g : GROUP * (g + 1)]
        for s in np.unique(owner[some.any(axis=1)]):
            own = np.flatnonzero(owner == s)
            place[g, s] = len(entries) - own[0]
            entries += list(some[own])
    columns = SparseColumns(place, np.array(entries), *np.zeros((2, 1), dtype=np.int32))
    multipliers = np.full(GROUP * groups + 3, np.nan)
    multipliers[:rows] = random.normal(size=rows)
    solver.solve(random.normal(size=(node_count, 3)))  # which changes nothing of what was begun
    by_rows = jacobian.T @ multipliers[:rows]
    expected = np.linalg.solve(matrix, given.reshape(-1) + by_rows)
    accuracy = {"rtol": 1e-8, "atol": 1e-12 * np.abs(expected).max()}
    np.testing.assert_allclose(solver.complete(columns, multipliers, rows).reshape(-1), expected, **accuracy)
    np.testing.assert_allclose(solver.complete_with(by_rows.reshape(-1, 3)).reshape(-1), expected, **accuracy)
    alone = solver.complete(columns, multipliers, 0).reshape(-1)
    np.testing.assert_allclose(alone, np.linalg.solve(matrix, given.reshape(-1)), **accuracy)
    in_rows, size = jacobian @ alone, np.abs(y).T @ np.abs(solver.begun[: len(y)])
    np.testing.assert_allclose(y.T @ solver.begun[: len(y)], in_rows, rtol=1e-8, atol=1e-9 * size.max())
    solver.leave_out_right_hand_side()
    by_rows_alone = solver.complete(columns, multipliers, rows).reshape(-1)
    np.testing.assert_allclose(by_rows_alone, np.linalg.solve(matrix, by_rows), **accuracy)


@pytest.mark.parametrize("node", [0, 13, 24, 25, 39])
def test_a_matrix_that_is_not_positive_definite_names_its_node(node: int) -> None:
    """Two bodies; one diagonal entry is far below zero, so the pivot there fails whatever comes before."""
    pattern = random_pattern(5, [25, 15], 3.0)
    solver = Cholesky(SymbolicFactor(pattern))
    matrix = random_matrix(5, pattern)
    matrix[3 * node + 1, 3 * node + 1] = -1e9
    fill(solver, matrix)
    right = np.random.default_rng(5).normal(size=(40, 3))
    with pytest.raises(NotPositiveDefinite, match=f"at node {node}$") as refused:
        solver.factorise(np.full((40, 3), np.nan))
    assert refused.value.node == node
    matrix = random_matrix(6, pattern)
    fill(solver, matrix)
    solver.factorise(right)  # and the solver can be used again, with nothing left of the numbers that were none
    solution = solver.complete(SparseColumns.with_room(0, 0, 0), np.zeros(0), 0)
    np.testing.assert_allclose(solution.reshape(-1), np.linalg.solve(matrix, right.reshape(-1)), rtol=1e-8)


def test_a_matrix_that_is_not_a_number_is_refused() -> None:
    """NaN is not positive, also with the compiler's fast mathematics."""
    pattern = random_pattern(5, [10], 3.0)
    solver = Cholesky(SymbolicFactor(pattern))
    matrix = random_matrix(5, pattern)
    matrix[6, 6] = np.nan
    fill(solver, matrix)
    with pytest.raises(NotPositiveDefinite):
        solver.factorise(np.zeros((10, 3)))


def grid_pattern(*shape: int) -> sparse.csr_matrix:
    """Graph of a grid of nodes, each joined to all its neighbours, diagonal ones included."""
    pattern = sparse.identity(1)
    for size in shape:
        pattern = sparse.kron(pattern, sparse.diags([1.0, 1.0, 1.0], [-1, 0, 1], shape=(size, size)))
    return sparse.csr_matrix(pattern)


@pytest.mark.parametrize("shapes", [[(12, 5, 5)], [(5, 5, 5), (40,), (2, 3), (9, 9)]])
def test_wide_fronts_are_solved_in_pieces(shapes: list[tuple[int, ...]]) -> None:
    """Blocks whose separators make fronts of a hundred rows and more, alone and beside small bodies.

    Tolerance as above.
    """
    pattern = sparse.csr_matrix(sparse.block_diag([grid_pattern(*shape) for shape in shapes]))
    solver = Cholesky(SymbolicFactor(pattern))
    matrix = random_matrix(1, pattern)
    fill(solver, matrix)
    right = np.random.default_rng(1).normal(size=(pattern.shape[0], 3))
    solver.factorise(right)
    for solution in solver.complete(SparseColumns.with_room(0, 0, 0), np.zeros(0), 0), solver.solve(right):
        scale = np.abs(matrix) @ np.abs(solution.reshape(-1)) + np.abs(right.reshape(-1))
        assert (np.abs(matrix @ solution.reshape(-1) - right.reshape(-1)) <= 1e-13 * scale).all()


BITS = """
import hashlib
import numpy as np
from test_cholesky import Cholesky, SparseColumns, SymbolicFactor, fill, grid_pattern, random_matrix
solver = Cholesky(SymbolicFactor(grid_pattern(10, 6, 6)))
fill(solver, random_matrix(3, grid_pattern(10, 6, 6)))
patience = solver.symbolic.fronts.patience
for usual in 50 * [0, patience[0]]:
    patience[0] = usual
    right = np.arange(1080.0).reshape(360, 3)
    solver.factorise(right)
    begun = solver.complete(SparseColumns.with_room(0, 0, 0), np.zeros(0), 0)
    solution = solver.solve(right)
    print(hashlib.sha256(solver.factor.tiles.tobytes() + begun.tobytes() + solution.tobytes()).hexdigest())
"""


def test_the_bits_do_not_depend_on_threads() -> None:
    """A hundred factorisations on one, two and five threads, with fronts in pieces: one result.

    Half of them without patience, so that threads leave as soon as there is nothing for them.
    """
    results = set()
    for threads in ("1", "2", "5"):
        environment = os.environ | {"TAICHISOFT_THREADS": threads, "PYTHONPATH": os.pathsep.join(sys.path)}
        done = subprocess.run(
            [sys.executable, "-c", BITS],
            cwd=Path(__file__).parent,
            env=environment,
            check=True,
            capture_output=True,
            text=True,
            timeout=PATIENCE,
        )
        results |= set(done.stdout.split())
    assert len(results) == 1


def test_a_mesh_too_large_to_be_indexed_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    pattern = random_pattern(1, [20], 4.0)
    SymbolicFactor(pattern)
    monkeypatch.setattr(cholesky, "LARGEST_INDEX", 500)
    with pytest.raises(MeshError, match=r"the soft bodies' 20 nodes need .* mesh the bodies more coarsely"):
        SymbolicFactor(pattern)


def test_a_thread_that_comes_late_leaves_alone_what_is_not_ready() -> None:
    """All branches are taken, and the last is not finished: what is above them is for the thread that finishes it.

    So the right-hand side and the solution stay as they are, and are right when all counters are as at the start.
    """
    line = sparse.diags([1.0, 1.0, 1.0], [-1, 0, 1], (20, 20))
    pattern = (sparse.kron(line, line) != 0).astype(float).tocsr()
    solver = Cholesky(SymbolicFactor(pattern))
    fill(solver, random_matrix(3, pattern))
    right, none = np.random.default_rng(3).normal(size=(400, 3)), SparseColumns.with_room(0, 0, 0)
    solver.factorise(right)
    symbolic = solver.symbolic
    supernodes, starts = share_out_branches(symbolic.tree.parent, np.ones(len(symbolic.tree.parent)), 2)
    branches = len(starts) - 2
    assert branches > 1 and starts[-1] > starts[-2]
    solution = solver._whole._replace(supernodes=supernodes, branch_start=starts)
    solution.given[:] = right
    for others_finished in range(branches):
        solution.progress[:] = 0
        solution.progress[BEGUN], solution.progress[FINISHED] = branches, others_finished
        solution.forward.fill(7.0)
        forward(symbolic.fronts, solver.factor, solution, 1, 1)
        assert (solution.forward == 7.0).all()
    solution.progress[:] = 0
    solution.progress[BEGUN] = 1  # another thread is at what is above all branches
    solution.found.fill(7.0)
    back(0, np.zeros(0), none, symbolic.fronts, solver.factor, solution, 1, 1)
    assert (solution.found == 7.0).all()
    solution.progress[:] = 0
    solution.forward.fill(0.0)
    forward(symbolic.fronts, solver.factor, solution, 1, 1)
    np.testing.assert_array_equal(solution.forward, solver.begun)
    np.testing.assert_array_equal(solver.solve(right), solver.complete(none, np.zeros(0), 0))
