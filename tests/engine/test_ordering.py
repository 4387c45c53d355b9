"""The symbolic factorisation: whatever fills in has a place."""

import numpy as np
import scipy.sparse as sparse
from conftest import examples
from hypothesis import given
from hypothesis import strategies as st

from taichisoft.mechanics.elimination_order import find_supernodes


def true_fill(pattern: np.ndarray, order: np.ndarray) -> np.ndarray:
    """Pattern of L by elimination on a dense matrix, in that order."""
    filled = pattern[np.ix_(order, order)].copy()
    for column in range(len(filled)):
        below = np.flatnonzero(filled[column + 1 :, column]) + column + 1
        filled[np.ix_(below, below)] = True
    return np.tril(filled)


def grid(rows: int, columns: int) -> np.ndarray:
    """Pattern of a grid of nodes, each joined to its neighbours."""
    path = [sparse.diags([1.0, 1.0, 1.0], [-1, 0, 1], shape=(n, n)) for n in (rows, columns)]
    return sparse.kron(*path).toarray() != 0


@examples(60)
@given(seed=st.integers(0, 10**6), size=st.integers(1, 40), neighbours=st.floats(0.0, 6.0))
def test_supernodes_hold_the_fill(seed: int, size: int, neighbours: float) -> None:
    """Every entry of L lies in the rows of its column's supernode; and the tree is one that can be climbed."""
    joined = np.random.default_rng(seed).random((size, size)) < neighbours / size
    pattern = joined | joined.T | np.eye(size, dtype=bool)
    supernodes = find_supernodes(sparse.csr_matrix(pattern, dtype=float))
    assert sorted(supernodes.order) == list(range(size))
    filled = true_fill(pattern, supernodes.order)
    for s in range(supernodes.count):
        rows = supernodes.rows[supernodes.row_start[s] : supernodes.row_start[s + 1]]
        columns = np.arange(supernodes.first_column[s], supernodes.first_column[s + 1])
        assert (np.diff(rows) > 0).all()
        np.testing.assert_array_equal(rows[: len(columns)], columns)
        for column in columns:
            assert np.isin(np.flatnonzero(filled[:, column]), rows).all()
        below = rows[len(columns) :]
        parent = supernodes.parent[s]
        if parent < 0:
            assert len(below) == 0
            continue
        assert parent > s
        above = supernodes.rows[supernodes.row_start[parent] : supernodes.row_start[parent + 1]]
        assert np.isin(below, above).all()


def test_the_order_saves_fill() -> None:
    """On a grid of 30 x 30 nodes, at most two thirds of the natural order's fill; and what supernodes store beyond
    the true fill, zeros that make them wider, is less than half of it."""
    pattern = grid(30, 30)
    supernodes = find_supernodes(sparse.csr_matrix(pattern, dtype=float))
    fill = true_fill(pattern, supernodes.order).sum()
    width, height = np.diff(supernodes.first_column), np.diff(supernodes.row_start)
    stored = (width * height - width * (width - 1) // 2).sum()
    assert fill < 2 / 3 * true_fill(pattern, np.arange(900)).sum()
    assert fill <= stored < 1.5 * fill
