"""The solver of contacts and actuators with its work space."""

import numpy as np

from taichisoft.kernels import gauss_seidel as kernels
from taichisoft.kernels.newton import Iterate, NewtonSystem, Problem


class GaussSeidel:
    """Finds impulses l with v = free + W l that obey Signorini's and Coulomb's laws and the bounds of actuators.

    See kernels/gauss_seidel.py.

    Attributes:
        impulse: where to start, which the caller fills, then the answer [mN s, of a volume kPa s], shape
            (row_capacity,).
        velocity: v of the answer [mm/s, of a volume mm^3/s], shape (row_capacity,).
        iterations: sweeps of the last call, those that check Newton steps included.
        residual: largest change of a block's own velocity in its last sweep [mm/s, of a volume mm^3/s].
    """

    def __init__(self, problem: Problem):
        """Make room for as many rows as the arrays of `problem` have; the caller fills these."""
        rows = len(problem.free)
        self.iterations, self.residual = 0, 0.0
        self.impulse, self.velocity = np.empty(rows), np.empty(rows)
        self._work = (
            problem,
            Iterate(self.impulse, self.velocity),
            Iterate(np.empty(rows), np.empty(rows)),
            Iterate(np.empty(rows), np.empty(rows)),
            kernels.Search(*(np.empty(rows) for _ in range(4))),
            NewtonSystem(np.empty(rows, dtype=np.int32), np.empty(rows**2), np.empty(rows)),
        )
        self._progress = kernels.Progress(np.zeros(5, dtype=np.int32), np.zeros(3))

    def solve(self, tolerance: float, max_iterations: int) -> None:
        """Improve `impulse` in place.

        Args:
            tolerance: of the residual, at which the sweeps end.
            max_iterations: sweeps after which they end in any case.
        """
        kernels.solve(*self._work, self._progress, tolerance, max_iterations)
        self.iterations = int(self._progress.count[kernels.SWEEPS])
        self.residual = float(self._progress.figure[kernels.RESIDUAL])
