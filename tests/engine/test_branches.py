"""How triangular solves are shared out among threads."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from taichisoft.mechanics.elimination_order import MOST_BRANCHES, share_out_branches


@st.composite
def forests(draw: st.DrawFn) -> np.ndarray:
    """A parent, or none, of each supernode, which follows it; descendants stand right before their supernode."""
    parent: list[int] = []
    waiting: list[int] = []  # those without a parent so far
    for s in range(draw(st.integers(1, 60))):
        parent.append(-1)
        for _ in range(draw(st.integers(0, min(3, len(waiting))))):
            parent[waiting.pop()] = s
        waiting.append(s)
    return np.array(parent)


@given(parent=forests(), threads=st.integers(1, 9), seed=st.integers(0, 99))
def test_branches_need_nothing_of_one_another(parent: np.ndarray, threads: int, seed: int) -> None:
    """Every supernode once, its children before it in its own branch, or wherever they are if it is above."""
    entries = np.random.default_rng(seed).integers(1, 10_000, len(parent))
    supernodes, starts = share_out_branches(parent, entries, threads)
    assert sorted(supernodes) == list(range(len(parent)))
    assert starts[0] == 0 and starts[-1] == len(parent) and (np.diff(starts[:-1]) > 0).all()
    part = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    above = len(starts) - 2
    part_of, place_of = np.empty(len(parent), dtype=int), np.argsort(supernodes)
    part_of[supernodes] = part
    for s in np.flatnonzero(parent >= 0):
        assert place_of[s] < place_of[parent[s]] or part_of[s] != part_of[parent[s]]
        assert part_of[parent[s]] in (part_of[s], above)
    assert above <= max(MOST_BRANCHES * threads + 3, (parent < 0).sum())
    if threads == 1:
        assert above == (parent < 0).sum()


def full_tree(depth: int) -> list[int]:
    """Parents of a binary tree, each subtree right before its root."""
    if depth == 1:
        return [-1]
    half = full_tree(depth - 1)
    size = len(half)
    return [*half[:-1], 2 * size, *(parent + size for parent in half[:-1]), 2 * size, -1]


def test_threads_are_busy() -> None:
    """Three equal bodies on two threads, each a bushy tree: the work of no thread is much more than a half."""
    tree = full_tree(7)
    parent = np.concatenate([np.array(tree) + i * len(tree) for i in range(3)])
    parent[np.tile(np.array(tree) < 0, 3)] = -1
    supernodes, starts = share_out_branches(parent, np.ones(len(parent)), 2)
    sizes, above = np.diff(starts)[:-1], np.diff(starts)[-1]
    busy = [0, 0]
    for size in sizes:
        busy[int(np.argmin(busy))] += size
    assert above + max(busy) < 0.52 * len(supernodes)
