"""A sparse direct solver for symmetric positive definite matrices of 3x3 node blocks.

Analyse the pattern once (`SymbolicFactor`), then per step `factorise` together with a right-hand side, and `complete`
its solution with rows J of which `solver/` has computed L^-1 J^T. `solve` is for any other right-hand side.
"""

import numpy as np

from taichisoft.cholesky.kernels.back_substitution import back, back_alone
from taichisoft.cholesky.kernels.factorisation import factorise, factorise_alone
from taichisoft.cholesky.kernels.forward_substitution import Substitution, forward, forward_alone
from taichisoft.cholesky.kernels.front_layout import Factor
from taichisoft.cholesky.kernels.sparse_columns import SparseColumns
from taichisoft.cholesky.symbolic import SymbolicFactor
from taichisoft.errors import NotPositiveDefinite
from taichisoft.runtime.language import THREADS
from taichisoft.runtime.tiles import TILE
from taichisoft.runtime.waiting import COUNTERS

# Non-zeros of a factor below which a single thread works: less than some 0.5 ms is not worth waking the others.
SMALL_FACTOR = 300_000
# Non-zeros, as of reduced bodies, below which kernels run on the calling thread: to wake another one takes as long as
# the work, and on a busy machine until it gets a core. The choice is by size alone, since such kernels round otherwise.
TINY_FACTOR = 20_000
NO_MULTIPLIERS = np.zeros(0)


class Cholesky:
    """Factorisation A = L L^T of a matrix with a fixed pattern.

    Attributes:
        symbolic: the pattern.
        blocks: the matrix, whose blocks the caller fills in the order of `symbolic.block_pairs`, shape
            (block_count, 3, 3).
        factor: L, in columns of tiles as `cholesky/kernels/front_layout.py` says, and after it the update matrices.
    """

    def __init__(self, symbolic: SymbolicFactor):
        """Allocate the matrix and its factor."""
        self.symbolic = symbolic
        self.blocks = np.zeros((len(symbolic.block_pairs), 3, 3))
        tiles = _allocate(symbolic.size)
        self.factor = Factor(
            tiles=tiles,
            scalars=tiles.reshape(-1),
            done=np.zeros(len(symbolic.tree.parent), dtype=np.int32),
            failed_column=np.zeros(1, dtype=np.int32),
            taken=np.zeros(len(symbolic.fronts.tasks), dtype=np.int32),
        )
        x = np.zeros(3 * len(symbolic.order) + TILE)  # the last tile may read and write beyond the end
        left = _allocate(len(symbolic.fronts.rows) // TILE)
        self._begun = Substitution(
            supernodes=symbolic.supernodes,
            branch_start=symbolic.branch_start,
            order=symbolic.order,
            given=np.zeros((symbolic.node_count, 3)),
            found=np.zeros((symbolic.node_count, 3)),
            forward=np.zeros_like(x),
            x=x,
            left=left.reshape(-1),
            left_tiles=left,
            progress=np.zeros(COUNTERS, dtype=np.int32),
        )
        self._whole = self._begun._replace(given=np.zeros_like(self._begun.given), forward=np.zeros_like(x))
        self._no_columns = SparseColumns.with_room(0, len(symbolic.tree.parent), 0)
        entries = symbolic.factor_entries
        self._workers = 1 if entries < SMALL_FACTOR else THREADS
        self._factorise, self._most = (factorise_alone, 1) if entries < TINY_FACTOR else (factorise, THREADS)
        self._forward, self._back = (forward_alone, back_alone) if entries < TINY_FACTOR else (forward, back)

    @property
    def begun(self) -> np.ndarray:
        """L^-1 b of the right-hand side that was factorised with, by elimination order, shape (3 node_count + 8,)."""
        return self._begun.forward

    def factorise(self, right_hand_side: np.ndarray) -> None:
        """Factorise what `blocks` holds, and begin to solve for a right-hand side b of shape (node_count, 3).

        Raises:
            NotPositiveDefinite: a pivot is not positive; the error has the node.
        """
        factor, none = self.factor, 3 * len(self.symbolic.order)
        factor.done.fill(0)
        factor.taken.fill(0)
        factor.failed_column[0] = none
        _set_rhs(self._begun, right_hand_side)
        self._factorise(self.symbolic.fronts, self.blocks, factor, self._begun, self._most, 1)
        if factor.failed_column[0] < none:
            node = int(self.symbolic.order[factor.failed_column[0] // 3])
            raise NotPositiveDefinite(f"the system matrix is not positive definite at node {node}", node)

    def leave_out_right_hand_side(self) -> None:
        """Replace the right-hand side b by 0."""
        _set_rhs(self._begun, 0.0)

    def complete(self, columns: SparseColumns, multipliers: np.ndarray, count: int) -> np.ndarray:
        """A^-1 (b + J^T lambda), shape (node_count, 3), with the right-hand side that was factorised with.

        Args:
            columns: Y = L^-1 J^T, of the last factorisation.
            multipliers: lambda, in an array with room for more.
            count: how many they are.
        """
        return self._substitute_back(self._begun, columns, multipliers, count)

    def complete_with(self, more: np.ndarray) -> np.ndarray:
        """A^-1 (b + c), shape (node_count, 3), with the right-hand side that was factorised with and another one."""
        return self.solve(self._begun.given + more)

    def solve(self, right_hand_side: np.ndarray) -> np.ndarray:
        """Solve A x = c with the last factorisation, c and x of shape (node_count, 3), beside what was begun."""
        _set_rhs(self._whole, right_hand_side)
        self._forward(self.symbolic.fronts, self.factor, self._whole, self._workers, 1)
        return self._substitute_back(self._whole, self._no_columns, NO_MULTIPLIERS, 0)

    def _substitute_back(
        self, substitution: Substitution, columns: SparseColumns, multipliers: np.ndarray, count: int
    ) -> np.ndarray:
        substitution.x.fill(0.0)
        substitution.progress.fill(0)
        workers, symbolic = self._workers, self.symbolic
        self._back(count, multipliers, columns, symbolic.fronts, self.factor, substitution, workers, 1)
        return substitution.found.copy()


def _set_rhs(substitution: Substitution, right_hand_side: np.ndarray | float) -> None:
    """Begin with a right-hand side. Zeros of the factor's padding meet any entry of L^-1 b, so all must be numbers."""
    substitution.given[:] = right_hand_side
    substitution.forward.fill(0.0)
    substitution.progress.fill(0)


def _allocate(count: int) -> np.ndarray:
    """Columns of tiles, zero, each in a cache line of its own; shape (count + 1, 8)."""
    entries = np.zeros((count + 2) * TILE)
    skip = -entries.ctypes.data % 64 // 8
    return entries[skip : skip + (count + 1) * TILE].reshape(-1, TILE)
