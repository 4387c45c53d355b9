"""CHOLMOD through cvxopt's wheel: supernodal Cholesky on BLAS, the yardstick of our own factorisation.

Its supernodal part is under the GPL, which is why taichisoft compares itself with it and does not use it.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.sparse as sparse

from taichisoft_benchmarks.errors import PeerMissing

SUPERNODAL = 2


def prepare(matrix: sparse.csc_matrix) -> Callable[[], Any]:
    """Analyse the pattern once; what is returned factorises and gives cvxopt's factor.

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
