"""Minimum degree: the node with the fewest neighbours is eliminated first."""

import numpy as np
import scipy.sparse as sparse
import scipy.sparse.linalg as sparse_linalg


def minimum_degree(adjacency: sparse.csr_matrix) -> np.ndarray:
    """Fill-reducing order by SuperLU's multiple minimum degree, from a diagonally dominant matrix of the pattern."""
    node_count = adjacency.shape[0]
    matrix = sparse.csc_matrix(adjacency, dtype=float)
    matrix.data[:] = -1.0
    matrix = (matrix + sparse.identity(node_count) * (node_count + 2.0)).tocsc()
    factor = sparse_linalg.splu(
        matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )
    return np.argsort(factor.perm_c)
