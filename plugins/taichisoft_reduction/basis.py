"""The modes of a shape: displacements that make up those of the training best, measured in the mass.

Proper orthogonal decomposition by the method of snapshots (Sirovich 1987): with the displacements u_s of the training,
the singular vectors of U = [M^(1/2) u_1, M^(1/2) u_2, ...].
"""

import numpy as np
import scipy.linalg

from taichisoft_reduction.errors import ReductionError

SMALLEST = 1e-7
"""Singular values below this share of the largest are noise: displacements are kept in single precision."""
SHARE = 0.25
"""Share of the tolerance that the modes may use up; the rest is for the integration domains."""


class Basis:
    """All modes that the training shows, the most important first.

    Attributes:
        modes: orthonormal in the mass [1/sqrt(kg)], shape (node_count, 3, mode_count).
        singular_values: [mm sqrt(kg)], shape (mode_count,).
        amplitudes: of the displacements of the training [mm sqrt(kg)], shape (snapshot_count, mode_count).
    """

    def __init__(self, displacements: np.ndarray, node_mass: np.ndarray):
        """Decompose displacements [mm], shape (snapshot_count, node_count, 3), with node masses [kg], (node_count,).

        Raises:
            ReductionError: nothing moved in the training.
        """
        self._displacements, self._mass = displacements, node_mass
        root = np.sqrt(node_mass)[:, None]
        weighted = (displacements * root).reshape(len(displacements), -1)
        values, vectors = scipy.linalg.eigh(weighted @ weighted.T)
        values, vectors = values[::-1], vectors[:, ::-1]
        if not values[0] > 0.0:
            raise ReductionError("nothing moved in the training: no actuator, no motion of the base and no gravity")
        some = values > SMALLEST**2 * values[0]
        self.singular_values = np.sqrt(values[some])
        columns = weighted.T @ (vectors[:, some] / self.singular_values)
        columns, triangle = np.linalg.qr(columns)  # the small ones are not quite orthogonal
        columns *= np.sign(np.diag(triangle))
        self.modes = (columns.reshape(len(node_mass), 3, -1)) / root[:, :, None]
        self.amplitudes = weighted @ columns

    @property
    def largest(self) -> float:
        """Largest displacement of a node in the training [mm]."""
        return float(np.linalg.norm(self._displacements, axis=2).max())

    def error(self, count: int) -> float:
        """Largest error of a node [mm] where `count` modes stand for the displacements of the training."""
        flat = self.modes[:, :, :count].reshape(-1, count)
        worst = 0.0
        for displacement, amplitude in zip(self._displacements, self.amplitudes, strict=True):
            missed = displacement - (flat @ amplitude[:count]).reshape(-1, 3)
            worst = max(worst, float(np.linalg.norm(missed, axis=1).max()))
        return worst

    def count_for(self, tolerance: float) -> int:
        """Smallest number of modes whose error is within a share of `tolerance` times the largest displacement."""
        allowed = SHARE * tolerance * self.largest
        low, high = 1, len(self.singular_values)
        while low < high:
            middle = (low + high) // 2
            low, high = (low, middle) if self.error(middle) <= allowed else (middle + 1, high)
        return low
