"""The sparse factorisations of other libraries, to compare with."""

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import splu

from taichisoft_benchmarks.errors import PeerMissing

SUPERNODAL = 2


def prepare_cholmod(matrix: sparse.csc_matrix) -> Callable[[], Any]:
    """CHOLMOD through cvxopt's wheel: supernodal Cholesky on BLAS, the yardstick of our own factorisation.

    Its supernodal part is under the GPL: taichisoft is compared with it and does not use it.

    Returns:
        A function that factorises, with the pattern analysed once, and returns cvxopt's factor.

    Raises:
        PeerMissing: cvxopt is not installed.
    """
    try:
        from cvxopt import cholmod, spmatrix
    except ImportError as error:
        raise PeerMissing("cvxopt is not installed; pip install 'taichisoft[peers]'") from error
    lower = sparse.tril(matrix).tocoo()
    system = spmatrix(lower.data, lower.row.astype(np.int64), lower.col.astype(np.int64), matrix.shape)
    cholmod.options["supernodal"] = SUPERNODAL
    factor = cholmod.symbolic(system)

    def factorise() -> Any:
        cholmod.numeric(system, factor)
        return factor

    return factorise


def prepare_superlu(matrix: sparse.csc_matrix) -> Callable[[], Any]:
    """SuperLU through scipy: an LU, with twice the arithmetic and a choice of pivots.

    Returns:
        A function that factorises in symmetric mode, and analyses the pattern each time: scipy cannot keep it.
    """
    return lambda: splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
