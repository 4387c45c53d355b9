"""A sparse direct solver for symmetric positive definite matrices of 3x3 node blocks.

Analyse once (`Cholesky(...)`), then per step `factorise` and `solve`; `kernels/compliance.py` uses the factor for
many right-hand sides.
"""

import numpy as np
import scipy.sparse as sparse

from taichisoft.cholesky.fronts import lay_out
from taichisoft.cholesky.ordering import find_supernodes
from taichisoft.errors import NotPositiveDefinite
from taichisoft.kernels import cholesky as kernels
from taichisoft.kernels.runtime import THREADS
from taichisoft.kernels.tiles import TILE
from taichisoft.kernels.triangular_solve import solve_trees, solve_trees_serially

# Non-zeros: less than some 0.5 ms of work is not worth waking threads.
SMALL_FACTOR = 300_000


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
        front: where each supernode's data stand, see `fronts.Fronts.table`.
        rows: rows below of all supernodes in elimination order, see `fronts.Fronts.position`.
        panel: the factor, in columns of tiles as `kernels/cholesky.py` says, and after it the update matrices;
            shape (columns of tiles, 8).
        factor_entries: number of non-zeros stored in L.
    """

    def __init__(self, adjacency: sparse.csr_matrix):
        """Analyse the pattern of nodes that share an element; shape (node_count, node_count), diagonal included."""
        supernodes = find_supernodes(adjacency)
        self.order = supernodes.order
        self.position_of_node = np.argsort(self.order).astype(np.int32)
        self.parent = supernodes.parent
        node_width, node_height = np.diff(supernodes.first_column), np.diff(supernodes.row_start)
        self.supernode_of_position = np.repeat(np.arange(supernodes.count, dtype=np.int32), node_width)
        self.factor_entries = int((9 * node_width * node_height - 3 * node_width * (3 * node_width - 1) // 2).sum())
        fronts = lay_out(adjacency, supernodes)
        self.front, self.rows = fronts.table, fronts.position
        self.block_pairs = self.order[fronts.block_pairs]
        self.blocks = np.zeros((len(self.block_pairs), 3, 3))
        self._block_place = fronts.block_place
        self._child, self._relative = fronts.child, fronts.relative
        self.panel = _allocate(fronts.size)
        self._scalars = self.panel.reshape(-1)
        self._tasks, self._pieces = fronts.tasks, fronts.pieces
        self._done = np.zeros(supernodes.count, dtype=np.int32)
        self._failed_column = np.zeros(1, dtype=np.int32)
        self._next_task = np.zeros(1, dtype=np.int32)
        self._prepare_solve()

    def _prepare_solve(self) -> None:
        roots = np.flatnonzero(self.parent < 0)
        starts = np.concatenate([[0], roots[:-1] + 1])
        rest_tiles = -(-self.front[:-1, 2] // TILE)
        most = [int(rest_tiles[a : b + 1].max()) for a, b in zip(starts, roots, strict=True)]
        self._trees = np.column_stack([starts, roots + 1, np.cumsum([0, *most[:-1]])]).astype(np.int32)
        self._below = _allocate(sum(most))
        self._x = np.zeros(3 * len(self.order) + TILE)  # the last tile may read and write beyond the end
        self._x_of_nodes = self._x[:-TILE].reshape(-1, 3)

    def factorise(self) -> None:
        """Factorise what `blocks` holds.

        Raises:
            NotPositiveDefinite: a pivot is not positive; the error has the node.
        """
        self._done.fill(0)
        self._next_task[0] = 0
        none = 3 * len(self.order)
        self._failed_column[0] = none
        kernels.factorise(
            self._tasks,
            self.front,
            self._pieces,
            self._block_place,
            self.blocks,
            self._child,
            self._relative,
            self.panel,
            self._scalars,
            self._done,
            self._failed_column,
            self._next_task,
            THREADS,
            1,
        )
        if self._failed_column[0] < none:
            node = int(self.order[self._failed_column[0] // 3])
            raise NotPositiveDefinite(f"the system matrix is not positive definite at node {node}", node)

    def solve(self, right_hand_side: np.ndarray) -> np.ndarray:
        """Solve A x = b with the last factorisation, b and x of shape (node_count, 3)."""
        np.take(right_hand_side, self.order, axis=0, out=self._x_of_nodes)
        solve = solve_trees_serially if self.factor_entries < SMALL_FACTOR else solve_trees
        solve(self._trees, self.front, self.rows, self.panel, self._scalars, self._x, self._below, 1)
        return self._x_of_nodes[self.position_of_node]


def _allocate(count: int) -> np.ndarray:
    """Columns of tiles, zero, each in a cache line of its own; shape (count + 1, 8)."""
    entries = np.zeros((count + 2) * TILE)
    skip = -entries.ctypes.data % 64 // 8
    return entries[skip : skip + (count + 1) * TILE].reshape(-1, TILE)
