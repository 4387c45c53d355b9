"""The columns of a sparse Cholesky factor, grouped for dense arithmetic: elimination tree and supernodes.

Works on the graph of nodes (each a 3x3 block of the matrix) and is made once per model. Sources: Liu 1990, The
Role of Elimination Trees in Sparse Factorization; Liu 1992, The Multifrontal Method for Sparse Matrix Solution;
Ashcraft and Grimes 1989, The influence of relaxed supernode partitions on the multifrontal method.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse


@dataclass(frozen=True)
class Supernodes:
    """Consecutive columns of the factor with one row structure; columns and rows count nodes in elimination order.

    Attributes:
        order: node eliminated at each position, shape (node_count,).
        first_column: first column of each supernode, and the node count at the end, shape (count + 1,).
        row_start: where each supernode's rows begin in `rows`, shape (count + 1,).
        rows: row positions of each supernode, its own columns first, ascending.
        parent: supernode that takes over its update matrix, -1 for a root, shape (count,).
    """

    order: np.ndarray
    first_column: np.ndarray
    row_start: np.ndarray
    rows: np.ndarray
    parent: np.ndarray

    @property
    def count(self) -> int:
        """Number of supernodes."""
        return len(self.parent)


def group_columns(adjacency: sparse.csr_matrix, order: np.ndarray) -> Supernodes:
    """Supernodes of a symmetric pattern (diagonal included) whose nodes are eliminated in an order, or one as good.

    Args:
        adjacency: which nodes share an element, shape (node_count, node_count).
        order: node eliminated at each position, shape (node_count,); every subtree is made consecutive.
    """
    parent, _ = _column_structure(adjacency, order)
    order = order[_postorder(parent)]
    parent, structure = _column_structure(adjacency, order)
    ranges = _amalgamate(parent, [len(rows) for rows in structure])
    first = np.array([start for start, _ in ranges] + [len(order)])
    rows = [np.concatenate([np.arange(start, end), structure[end - 1]]) for start, end in ranges]
    owner = np.repeat(np.arange(len(ranges)), np.diff(first))
    tree = [owner[structure[end - 1][0]] if len(structure[end - 1]) else -1 for _, end in ranges]
    return Supernodes(
        order=order.astype(np.int32),
        first_column=first.astype(np.int32),
        row_start=np.concatenate([[0], np.cumsum([len(r) for r in rows])]).astype(np.int32),
        rows=np.concatenate(rows).astype(np.int32),
        parent=np.array(tree, dtype=np.int32),
    )


def _column_structure(adjacency: sparse.csr_matrix, order: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
    """Parent of each column in the elimination tree and its row positions below the diagonal."""
    position = np.empty(len(order), dtype=np.int64)
    position[order] = np.arange(len(order))
    parent = np.full(len(order), -1)
    inherited: list[list[np.ndarray]] = [[] for _ in order]
    structure = []
    for column, node in enumerate(order):
        neighbours = position[adjacency.indices[adjacency.indptr[node] : adjacency.indptr[node + 1]]]
        rows = np.unique(np.concatenate([neighbours, *inherited[column]]))
        rows = rows[np.searchsorted(rows, column, side="right") :]
        structure.append(rows)
        if len(rows):
            parent[column] = rows[0]
            inherited[rows[0]].append(rows)
        inherited[column] = []
    return parent, structure


def _postorder(parent: np.ndarray) -> np.ndarray:
    """Columns with every subtree consecutive, children before parents."""
    children: list[list[int]] = [[] for _ in parent]
    roots: list[int] = []
    for column, above in enumerate(parent):
        (children[above] if above >= 0 else roots).append(column)
    ordered: list[int] = []
    for root in roots:
        stack = [root]
        reverse = []
        while stack:
            column = stack.pop()
            reverse.append(column)
            stack.extend(children[column])
        ordered.extend(reversed(reverse))
    return np.array(ordered)


def _amalgamate(parent: np.ndarray, below: list[int]) -> list[tuple[int, int]]:
    """Column ranges of the supernodes; a child is merged into its parent when few zeros come in.

    `below` counts each column's rows below the diagonal. A range is (first, end, entries of the factor in it).
    """
    ranges: list[tuple[int, int, int]] = []
    for column in range(len(parent)):
        merged = (column, column + 1, below[column] + 1)
        while ranges and ranges[-1][1] == merged[0] and parent[merged[0] - 1] in range(merged[0], column + 1):
            first, _, entries = ranges[-1]
            width = merged[1] - first
            stored = width * (width + 1) // 2 + width * below[column]
            true = entries + merged[2]
            if not _worth_merging(width, 1.0 - true / stored):
                break
            ranges.pop()
            merged = (first, merged[1], true)
        ranges.append(merged)
    return [(first, end) for first, end, _ in ranges]


def _worth_merging(width: int, zero_fraction: float) -> bool:
    """Wider supernodes tolerate fewer explicit zeros: small ones cost more in overhead than in arithmetic."""
    if width <= 3:
        return True
    if width <= 8:
        return zero_fraction < 0.5
    return zero_fraction < (0.15 if width <= 24 else 0.05)
