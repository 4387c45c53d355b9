"""A sparse direct solver for symmetric positive definite matrices of 3x3 node blocks.

Analyse the pattern once (`SymbolicFactor`), then per step `factorise` and `solve`; `kernels/compliance.py` uses the
factor for many right-hand sides, and `solve_columns` what it found.
"""

import numpy as np

from taichisoft.cholesky.symbolic import SymbolicFactor
from taichisoft.errors import NotPositiveDefinite
from taichisoft.kernels import cholesky as kernels
from taichisoft.kernels.compliance import SparseColumns
from taichisoft.kernels.correction import correct, correct_serially
from taichisoft.kernels.runtime import THREADS
from taichisoft.kernels.tiles import TILE
from taichisoft.kernels.triangular_solve import Solution, solve_trees, solve_trees_serially

# Non-zeros: less than some 0.5 ms of work is not worth waking threads.
SMALL_FACTOR = 300_000


class Cholesky:
    """Factorisation A = L L^T of a matrix with a fixed pattern.

    Attributes:
        symbolic: the pattern.
        blocks: the matrix, whose blocks the caller fills in the order of `symbolic.block_pairs`, shape
            (block_count, 3, 3).
        factor: L, in columns of tiles as `kernels/cholesky.py` says, and after it the update matrices.
    """

    def __init__(self, symbolic: SymbolicFactor):
        """Make room for a matrix and its factor."""
        self.symbolic = symbolic
        self.blocks = np.zeros((len(symbolic.block_pairs), 3, 3))
        tiles = _allocate(symbolic.size)
        self.factor = kernels.Factor(
            tiles=tiles,
            scalars=tiles.reshape(-1),
            done=np.zeros(len(symbolic.tree.parent), dtype=np.int32),
            failed_column=np.zeros(1, dtype=np.int32),
            taken=np.zeros(len(symbolic.fronts.tasks), dtype=np.int32),
        )
        x = np.zeros(3 * len(symbolic.order) + TILE)  # the last tile may read and write beyond the end
        given, found = (np.zeros((len(symbolic.order), 3)) for _ in range(2))
        self._solution = Solution(symbolic.solve_trees, symbolic.order, given, found, x, _allocate(symbolic.work_size))
        small = symbolic.factor_entries < SMALL_FACTOR
        self._solve = solve_trees_serially if small else solve_trees
        self._correct = correct_serially if small else correct

    def factorise(self) -> None:
        """Factorise what `blocks` holds.

        Raises:
            NotPositiveDefinite: a pivot is not positive; the error has the node.
        """
        factor, none = self.factor, 3 * len(self.symbolic.order)
        factor.done.fill(0)
        factor.taken.fill(0)
        factor.failed_column[0] = none
        kernels.factorise(self.symbolic.fronts, self.blocks, factor, THREADS, 1)
        if factor.failed_column[0] < none:
            node = int(self.symbolic.order[factor.failed_column[0] // 3])
            raise NotPositiveDefinite(f"the system matrix is not positive definite at node {node}", node)

    def solve_columns(self, columns: SparseColumns, multipliers: np.ndarray, count: int) -> np.ndarray:
        """A^-1 J^T lambda, shape (node_count, 3), by the backward half of a solve.

        Args:
            columns: Y = L^-1 J^T, of the last factorisation.
            multipliers: lambda, in an array with room for more.
            count: how many they are.
        """
        self._correct(count, multipliers, columns, self.symbolic.fronts, self.factor, self._solution, 1)
        return self._solution.found.copy()

    def solve(self, right_hand_side: np.ndarray) -> np.ndarray:
        """Solve A x = b with the last factorisation, b and x of shape (node_count, 3)."""
        self._solution.given[:] = right_hand_side
        self._solve(self.symbolic.fronts, self.factor, self._solution, 1)
        return self._solution.found.copy()


def _allocate(count: int) -> np.ndarray:
    """Columns of tiles, zero, each in a cache line of its own; shape (count + 1, 8)."""
    entries = np.zeros((count + 2) * TILE)
    skip = -entries.ctypes.data % 64 // 8
    return entries[skip : skip + (count + 1) * TILE].reshape(-1, TILE)
