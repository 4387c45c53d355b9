"""A sparse direct solver for symmetric positive definite matrices of 3x3 node blocks.

Analyse once (`Cholesky(...)`), then per step `factorise`, `solve`, and `compliance` for many right-hand sides.
"""

import numpy as np
import scipy.sparse as sparse

from taichisoft.errors import NotPositiveDefinite
from taichisoft.kernels import cholesky as kernels
from taichisoft.ordering import Supernodes, find_supernodes

# A subtree becomes a task of its own when it holds at most this share of all the arithmetic.
LARGEST_TASK = 0.15


class Cholesky:
    """Factorisation A = L L^T of a matrix with a fixed pattern.

    Attributes:
        block_pairs: the two nodes (row, column) of every stored 3x3 block of the lower triangle in
            elimination order, shape (block_count, 2); the caller fills `blocks` in this order.
        blocks: the matrix, shape (block_count, 3, 3).
        order: node eliminated at each position, shape (node_count,).
        position_of_node: the inverse of `order`, shape (node_count,).
        supernode_of_position: shape (node_count,).
        parent: the elimination tree of supernodes, -1 at a root.
        front: where each supernode's data stand; see `__init__` for the columns.
        rows: row positions of all supernodes.
        panel: the factor, each supernode's columns one after the other.
        factor_entries: number of non-zeros stored in L.
    """

    def __init__(self, adjacency: sparse.csr_matrix):
        """Analyse the pattern of nodes that share an element; shape (node_count, node_count), diagonal included."""
        supernodes = find_supernodes(adjacency)
        self.order = supernodes.order
        self.position_of_node = np.argsort(self.order).astype(np.int32)
        self.rows = supernodes.rows
        self.parent = supernodes.parent
        width = np.diff(supernodes.first_column)
        height = np.diff(supernodes.row_start)
        self.supernode_of_position = np.repeat(np.arange(supernodes.count, dtype=np.int32), width)
        self.block_pairs, block_start, self._block_row, self._block_column = _place_blocks(adjacency, supernodes)
        child_start, self._child = _children(supernodes.parent)
        self._relative = _relative_rows(supernodes)
        # One row per supernode, and one that closes the ranges; the columns are named in `front_columns`.
        front_columns = {
            "width": np.append(width, 0),
            "height": np.append(height, 0),
            "panel_start": _offsets(9 * width * height),
            "update_start": _offsets(9 * (height - width) ** 2),
            "block_start": block_start,
            "child_start": child_start,
            "row_start": supernodes.row_start,
            "first_column": supernodes.first_column,
        }
        self.front = np.column_stack(list(front_columns.values())).astype(np.int32)
        self.blocks = np.zeros((len(self.block_pairs), 3, 3))
        self.panel = np.zeros(int(front_columns["panel_start"][-1]) + kernels.TILE)
        self._update = np.zeros(max(1, int(front_columns["update_start"][-1])))
        self.factor_entries = int((9 * width * height - 3 * width * (3 * width - 1) // 2).sum())
        self._stages, self._stage_of = _share_out(supernodes.parent, work=width * height**2)
        roots = np.flatnonzero(supernodes.parent < 0)
        starts = np.concatenate([[0], roots[:-1] + 1])
        tallest = [int(height[a : b + 1].max()) for a, b in zip(starts, roots, strict=True)]
        self._trees = np.column_stack([starts, roots + 1, np.cumsum([0, *tallest[:-1]])]).astype(np.int32)
        self._work = np.zeros(3 * sum(tallest))

    def factorise(self) -> None:
        """Factorise what `blocks` holds.

        Raises:
            NotPositiveDefinite: a pivot is not positive; the error has the node.
        """
        for stage, tasks in enumerate(self._stages):
            if not len(tasks):
                continue
            failed = np.empty(len(tasks), dtype=np.int32)
            kernels.factorise_tasks(
                tasks,
                stage,
                self._stage_of,
                self.front,
                self._block_row,
                self._block_column,
                self.blocks,
                self._child,
                self._relative,
                self.panel,
                self._update,
                failed,
            )
            if (failed >= 0).any():
                node = int(self.order[failed[failed >= 0].min() // 3])
                raise NotPositiveDefinite(f"the system matrix is not positive definite at node {node}", node)

    def solve(self, right_hand_side: np.ndarray) -> np.ndarray:
        """Solve A x = b with the last factorisation, b and x of shape (node_count, 3)."""
        x = np.ascontiguousarray(right_hand_side[self.order])
        kernels.solve_trees(self._trees, self.front, self.rows, self.panel, x.reshape(-1), self._work)
        result = np.empty_like(x)
        result[self.order] = x
        return result


def _offsets(sizes: np.ndarray) -> np.ndarray:
    return np.concatenate([[0], np.cumsum(sizes)])


def _place_blocks(
    adjacency: sparse.csr_matrix, supernodes: Supernodes
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Where each block of the matrix goes: node pairs, start per supernode, local row and column in its panel."""
    position = np.empty(len(supernodes.order), dtype=np.int64)
    position[supernodes.order] = np.arange(len(supernodes.order))
    owner = np.repeat(np.arange(supernodes.count), np.diff(supernodes.first_column))
    pattern = adjacency.tocoo()
    row, column = position[pattern.row], position[pattern.col]
    lower = row >= column
    row, column = row[lower], column[lower]
    by_column = np.lexsort((row, column))
    row, column = row[by_column], column[by_column]
    s = owner[column]
    start = np.searchsorted(s, np.arange(supernodes.count + 1))
    # Rows are ascending within a supernode, so one search over (supernode, row) finds every local row.
    key = np.repeat(np.arange(supernodes.count), np.diff(supernodes.row_start)) * (len(owner) + 1) + supernodes.rows
    local_row = np.searchsorted(key, s * (len(owner) + 1) + row) - supernodes.row_start[s]
    pairs = np.column_stack([supernodes.order[row], supernodes.order[column]])
    local_column = column - supernodes.first_column[s]
    return pairs, start, local_row.astype(np.int32), local_column.astype(np.int32)


def _children(parent: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Children of every supernode as one list, with the start of each, ascending."""
    child = np.flatnonzero(parent >= 0)
    child = child[np.argsort(parent[child], kind="stable")]
    start = np.searchsorted(parent[child], np.arange(len(parent) + 1))
    return start, np.append(child, 0).astype(np.int32)


def _relative_rows(supernodes: Supernodes) -> np.ndarray:
    """For each row of a supernode, its local index among the rows of the parent (0 where there is none)."""
    relative = np.zeros(len(supernodes.rows), dtype=np.int32)
    width = np.diff(supernodes.first_column)
    for s, parent in enumerate(supernodes.parent):
        if parent >= 0:
            below = slice(supernodes.row_start[s] + width[s], supernodes.row_start[s + 1])
            rows = supernodes.rows[supernodes.row_start[parent] : supernodes.row_start[parent + 1]]
            relative[below] = np.searchsorted(rows, supernodes.rows[below])
    return relative


def _share_out(parent: np.ndarray, work: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
    """Two stages of tasks, each a range of supernodes: subtrees of limited work, then the rest of every tree."""
    count = len(parent)
    subtree_work = work.astype(np.float64)
    first = np.arange(count)
    for s, above in enumerate(parent):
        if above >= 0:
            subtree_work[above] += subtree_work[s]
            first[above] = min(first[above], first[s])
    small = subtree_work <= LARGEST_TASK * work.sum()
    top_of_subtree = small & ((parent < 0) | ~small[parent])
    roots = np.flatnonzero(parent < 0)
    subtrees = np.column_stack([first[top_of_subtree], np.flatnonzero(top_of_subtree) + 1])
    heavy_first = np.argsort(-subtree_work[top_of_subtree], kind="stable")
    large_roots = roots[~small[roots]]
    rest = np.column_stack([first[large_roots], large_roots + 1])
    stages = [np.ascontiguousarray(tasks, dtype=np.int32) for tasks in (subtrees[heavy_first], rest)]
    return stages, np.where(small, 0, 1).astype(np.int32)
