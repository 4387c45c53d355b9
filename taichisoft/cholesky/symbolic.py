"""What a sparse Cholesky factorisation needs to know of a matrix's pattern, found once."""

import numpy as np
import scipy.sparse as sparse

from taichisoft.cholesky.fronts import lay_out
from taichisoft.cholesky.ordering import find_supernodes
from taichisoft.kernels.cholesky import BELOW
from taichisoft.kernels.compliance import EliminationTree
from taichisoft.kernels.tiles import TILE


class SymbolicFactor:
    """The pattern of L in A = L L^T, for a matrix A of 3x3 node blocks.

    Attributes:
        block_pairs: the two nodes (row, column) of every stored block of A, of the lower triangle in elimination order,
            shape (block_count, 2).
        order: node eliminated at each position, shape (node_count,).
        tree: the way from a node up the tree of supernodes.
        fronts: how the fronts lie in memory, and the tasks that compute them.
        size: columns of tiles that the fronts take.
        solve_trees: trees of supernodes and their work space, see `kernels.triangular_solve.Solution`.
        work_size: columns of tiles of that work space.
        factor_entries: number of non-zeros stored in L.
    """

    def __init__(self, adjacency: sparse.csr_matrix):
        """Analyse the pattern of nodes that share an element; shape (node_count, node_count), diagonal included."""
        supernodes = find_supernodes(adjacency)
        node_width, node_height = np.diff(supernodes.first_column), np.diff(supernodes.row_start)
        self.order = supernodes.order
        self.tree = EliminationTree(
            position_of_node=np.argsort(self.order).astype(np.int32),
            supernode_of_position=np.repeat(np.arange(supernodes.count, dtype=np.int32), node_width),
            parent=supernodes.parent,
        )
        self.factor_entries = int((9 * node_width * node_height - 3 * node_width * (3 * node_width - 1) // 2).sum())
        layout = lay_out(adjacency, supernodes)
        self.fronts, self.size = layout.fronts, layout.size
        self.block_pairs = self.order[layout.block_pairs]
        roots = np.flatnonzero(supernodes.parent < 0)
        starts = np.concatenate([[0], roots[:-1] + 1])
        tiles_below = -(-self.fronts.table[:-1, BELOW] // TILE)
        most = [int(tiles_below[a : b + 1].max()) for a, b in zip(starts, roots, strict=True)]
        self.solve_trees = np.column_stack([starts, roots + 1, np.cumsum([0, *most[:-1]])]).astype(np.int32)
        self.work_size = sum(most)
