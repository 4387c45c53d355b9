"""The solver of contact and cavities with its work space."""

import numpy as np

from taichisoft.kernels import gauss_seidel as kernels


class GaussSeidel:
    """Finds impulses l with v = free + W l that obey Signorini's and Coulomb's laws; see kernels/gauss_seidel.py.

    Attributes:
        iterations: sweeps of the last call, those that check Newton steps included.
        residual: largest change of a block's own velocity in its last sweep [mm/s, of a cavity mm^3/s].
        velocity: v of the last answer, shape (row_count,).
    """

    def __init__(self, row_count: int):
        """Make room for `row_count` rows."""
        self.iterations, self.residual = 0, 0.0
        self.velocity, self._step = np.empty(row_count), np.empty(row_count)
        self._point, self._point_velocity = np.empty(row_count), np.empty(row_count)
        self._trial, self._trial_velocity = np.empty(row_count), np.empty(row_count)
        self._work = np.empty((kernels.WORK_ROWS, row_count))
        self._matrix = np.empty(row_count**2)
        self._row_of = np.empty(row_count, dtype=np.int32)
        self._outcome = np.zeros(2)
        self._compliance = self._by_rows = np.empty(0)

    def solve(
        self,
        compliance: np.ndarray,
        free: np.ndarray,
        friction: np.ndarray,
        impulse: np.ndarray,
        tolerance: float,
        max_iterations: int,
    ) -> None:
        """Improve `impulse` in place.

        Args:
            compliance: W, symmetric positive semi-definite, shape (row_count, row_count).
            free: velocities without impulses [mm/s, of a cavity mm^3/s], shape (row_count,).
            friction: coefficient of each contact, shape (contact_count,); its rows come first, three a contact.
            impulse: where to start, and the answer [mN s, of a cavity kPa s], shape (row_count,).
            tolerance: of the residual, at which the sweeps end.
            max_iterations: sweeps after which they end in any case.
        """
        if compliance is not self._compliance:  # a new view would be a new array to the launch
            self._compliance, self._by_rows = compliance, compliance.reshape(-1)
        kernels.solve(
            self._by_rows,
            free,
            friction,
            tolerance,
            max_iterations,
            impulse,
            self.velocity,
            self._work,
            self._point,
            self._point_velocity,
            self._trial,
            self._trial_velocity,
            self._step,
            self._matrix,
            self._row_of,
            self._outcome,
        )
        self.iterations, self.residual = int(self._outcome[0]), float(self._outcome[1])
