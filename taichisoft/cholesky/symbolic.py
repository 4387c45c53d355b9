"""The symbolic factorisation: what a sparse Cholesky factorisation needs of a matrix's pattern, computed once."""

import numpy as np
import scipy.sparse as sparse

from taichisoft.cholesky.branches import share_out_branches
from taichisoft.cholesky.fronts import lay_out
from taichisoft.cholesky.kernels.front_layout import BELOW, COLUMNS
from taichisoft.cholesky.kernels.sparse_columns import EliminationTree
from taichisoft.cholesky.ordering import find_supernodes
from taichisoft.runtime.language import THREADS


class SymbolicFactor:
    """The pattern of L in A = L L^T, for a matrix A of 3x3 node blocks.

    Attributes:
        block_pairs: the two nodes (row, column) of every stored block of A, of the lower triangle in elimination order,
            shape (block_count, 2).
        order: node eliminated at each position, shape (unknown_count,); nodes without an entry on the diagonal of the
            pattern are no unknowns.
        node_count: number of nodes with those that are no unknowns.
        tree: the way from a node up the tree of supernodes.
        fronts: how the fronts lie in memory, and the tasks that compute them.
        size: columns of tiles that the fronts take.
        supernodes, branch_start: the same shared out for solves, see `kernels.forward_substitution.Substitution`.
        factor_entries: number of non-zeros stored in L.
    """

    def __init__(self, adjacency: sparse.csr_matrix):
        """Analyse the pattern of nodes that share an element; shape (node_count, node_count), diagonal included."""
        self.node_count = adjacency.shape[0]
        unknown = np.flatnonzero(adjacency.diagonal())
        if len(unknown) < self.node_count:
            adjacency = adjacency[unknown][:, unknown].tocsr()
        supernodes = find_supernodes(adjacency)
        node_width, node_height = np.diff(supernodes.first_column), np.diff(supernodes.row_start)
        self.order = unknown[supernodes.order].astype(supernodes.order.dtype)
        position = np.full(self.node_count, -1, dtype=np.int32)
        position[self.order] = np.arange(len(self.order))
        self.tree = EliminationTree(
            position_of_node=position,
            supernode_of_position=np.repeat(np.arange(supernodes.count, dtype=np.int32), node_width),
            parent=supernodes.parent,
        )
        self.factor_entries = int((9 * node_width * node_height - 3 * node_width * (3 * node_width - 1) // 2).sum())
        layout = lay_out(adjacency, supernodes)
        self.fronts, self.size = layout.fronts, layout.size
        self.block_pairs = self.order[layout.block_pairs]
        table = self.fronts.table
        entries = table[:-1, COLUMNS] * (table[:-1, COLUMNS] + table[:-1, BELOW])
        self.supernodes, self.branch_start = share_out_branches(supernodes.parent, entries, THREADS)
