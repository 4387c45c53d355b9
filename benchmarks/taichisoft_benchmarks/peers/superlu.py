"""SuperLU through scipy: what anybody has at hand. An LU, which does twice the arithmetic and chooses pivots."""

from collections.abc import Callable
from typing import Any

import scipy.sparse as sparse
from scipy.sparse.linalg import splu


def prepare(matrix: sparse.csc_matrix) -> Callable[[], Any]:
    """What is returned factorises in symmetric mode, and analyses the pattern anew each time: scipy cannot keep it."""
    return lambda: splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
