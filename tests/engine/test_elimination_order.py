"""The order of elimination: nested dissection, and supernodes that hold the fill."""

import numpy as np
import pytest
import scipy.sparse as sparse
from conftest import examples
from hypothesis import given
from hypothesis import strategies as st

from taichisoft.mechanics import elimination_order
from taichisoft.mechanics.elimination_order import (
    find_supernodes,
    group_columns,
    minimum_degree,
    nested_dissection,
    predicted_work,
)

# Nested dissection: it orders any graph, and what it is for.


def box(*shape: int) -> sparse.csr_matrix:
    """Graph of a grid of nodes, each joined to its neighbours along edges and diagonals."""
    pattern = sparse.identity(1)
    for size in shape:
        pattern = sparse.kron(pattern, sparse.diags([1.0, 1.0, 1.0], [-1, 0, 1], shape=(size, size)))
    return sparse.csr_matrix(pattern)


@examples(40)
@given(seed=st.integers(0, 10**6), size=st.integers(1, 120), neighbours=st.floats(0.0, 100.0))
def test_any_graph_is_ordered(seed: int, size: int, neighbours: float) -> None:
    """Scattered nodes, chains, and graphs so dense that no separator leaves two sides; and always alike."""
    joined = np.random.default_rng(seed).random((size, size)) < neighbours / size
    graph = sparse.csr_matrix(joined | joined.T | np.eye(size, dtype=bool), dtype=float)
    leaf, elimination_order.LEAF = elimination_order.LEAF, 10
    try:
        order = nested_dissection(graph)
        np.testing.assert_array_equal(nested_dissection(graph), order)
    finally:
        elimination_order.LEAF = leaf
    assert sorted(order) == list(range(size))


@pytest.mark.parametrize("shape", [(30, 6, 6), (12, 12, 12), (40, 40)])
def test_what_is_eliminated_last_cuts_a_box_in_two(shape: tuple[int, ...]) -> None:
    """The smallest section of a box is its layer of nodes across the longest edge; each side has a quarter or more."""
    graph = box(*shape)
    order = nested_dissection(graph)
    layer = graph.shape[0] // max(shape)
    rest = np.sort(order[:-layer])
    count, side = sparse.csgraph.connected_components(graph[rest][:, rest], directed=False)
    assert count == 2
    assert np.bincount(side).min() > graph.shape[0] / 4 - 2 * layer


def test_large_bodies_are_dissected_and_small_ones_are_not() -> None:
    """A block of 14^3 nodes: minimum degree leaves a quarter more to do. A bar of 200: it leaves the least."""
    block, bar = box(14, 14, 14), box(50, 2, 2)
    work = {
        name: predicted_work(group_columns(block, order(block)))
        for name, order in (("degree", minimum_degree), ("dissection", nested_dissection))
    }
    assert work["dissection"] < 0.85 * work["degree"]
    assert predicted_work(find_supernodes(block)) == work["dissection"]
    assert predicted_work(find_supernodes(bar)) == predicted_work(group_columns(bar, minimum_degree(bar)))


def test_bodies_of_one_mesh_have_one_order() -> None:
    """Three boxes: the fill is three times that of one, and there are three trees."""
    graph = box(12, 5, 5)
    one, three = find_supernodes(graph), find_supernodes(sparse.csr_matrix(sparse.block_diag([graph] * 3)))
    assert len(three.rows) == 3 * len(one.rows)
    assert (three.parent < 0).sum() == 3
    np.testing.assert_array_equal(np.diff(three.first_column), np.tile(np.diff(one.first_column), 3))


# The symbolic factorisation: whatever fills in has a place.


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
