"""The factorisations of other libraries are given our matrix."""

import sys

import numpy as np
import pytest
import scipy.sparse as sparse

from taichisoft.mechanics.cholesky import Cholesky, SymbolicFactor
from taichisoft_benchmarks.errors import PeerMissing
from taichisoft_benchmarks.measures.factorisation_times import arithmetic, system_matrix
from taichisoft_benchmarks.peers.factorisations import prepare_cholmod, prepare_superlu


def chain(node_count: int) -> tuple[Cholesky, np.ndarray]:
    """A solver with random blocks of a chain of nodes, and the whole matrix."""
    pattern = sparse.diags([1.0, 1.0, 1.0], [-1, 0, 1], (node_count, node_count)).tocsr()
    solver = Cholesky(SymbolicFactor(pattern))
    random = np.random.default_rng(0)
    dense = np.zeros((3 * node_count, 3 * node_count))
    for block, (row, column) in zip(solver.blocks, solver.symbolic.block_pairs, strict=True):
        block[:] = random.normal(size=(3, 3))
        if row == column:
            block[:] = block + block.T + 20.0 * np.eye(3)
        dense[3 * row : 3 * row + 3, 3 * column : 3 * column + 3] = block
        dense[3 * column : 3 * column + 3, 3 * row : 3 * row + 3] = block.T
    return solver, dense


def test_the_matrix_is_whole_and_symmetric():
    solver, dense = chain(5)
    assert np.array_equal(system_matrix(solver.symbolic.block_pairs, solver.blocks, 5).toarray(), dense)


def test_superlu_factorises_it():
    solver, dense = chain(5)
    factor = prepare_superlu(system_matrix(solver.symbolic.block_pairs, solver.blocks, 5))()
    assert np.allclose(factor.solve(dense @ np.arange(15.0)), np.arange(15.0))


def test_cholmod_factorises_it():
    cvxopt = pytest.importorskip("cvxopt")
    solver, dense = chain(5)
    factor = prepare_cholmod(system_matrix(solver.symbolic.block_pairs, solver.blocks, 5))()
    x = cvxopt.matrix(dense @ np.arange(15.0))
    cvxopt.cholmod.solve(factor, x)
    assert np.allclose(np.array(x).ravel(), np.arange(15.0))


def test_without_cvxopt_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "cvxopt", None)
    with pytest.raises(PeerMissing, match=r"cvxopt is not installed; pip install 'taichisoft\[peers\]'"):
        prepare_cholmod(sparse.identity(3).tocsc())


def test_the_arithmetic_of_a_full_matrix_is_a_third_of_its_cube():
    full = sparse.csc_matrix(np.tril(np.ones((30, 30))))
    assert arithmetic(full) == pytest.approx(30 * 31 * 61 / 6 / 1e6)
