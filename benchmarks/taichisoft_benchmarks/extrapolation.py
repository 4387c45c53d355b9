"""Where a series of ever finer meshes leads."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from taichisoft_benchmarks.errors import BenchmarkError

ORDER = 2 * 0.5445
"""At which a body with inner corners of 90 degrees converges under even refinement, with linear and with quadratic
elements: stresses are singular there, displacements go with the distance to the power 0.5445 (Williams, Stress
singularities in angular corners of plates in extension, J. Appl. Mech. 1952), and energies, and with them the
displacement under the load, with twice that."""


@dataclass(frozen=True)
class Limit:
    """u = value - factor * nodes ** (-ORDER / 3): the error falls with the element size to the power of the order.

    Attributes:
        value: of an infinitely fine mesh.
        factor: in the unit of the value.
        doubt: how far the value moves at most when one of the meshes is left out.
    """

    value: float
    factor: float
    doubt: float


def limit_of(nodes: Sequence[float], values: Sequence[float]) -> Limit:
    """Richardson's extrapolation, fitted to all meshes by least squares.

    Raises:
        BenchmarkError: fewer than three meshes.
    """
    if len(nodes) < 3:
        raise BenchmarkError(f"a limit with its doubt needs three meshes; there are {len(nodes)}")
    counts, given = np.asarray(nodes, dtype=float), np.asarray(values, dtype=float)
    limit, factor = _solve(counts, given)
    left_out = [_solve(np.delete(counts, index), np.delete(given, index))[0] for index in range(len(counts))]
    return Limit(limit, factor, max(abs(value - limit) for value in left_out))


def _solve(nodes: np.ndarray, values: np.ndarray) -> tuple[float, float]:
    """Limit and factor by least squares."""
    columns = np.stack([np.ones(len(nodes)), -(nodes ** (-ORDER / 3.0))], axis=1)
    limit, factor = np.linalg.lstsq(columns, values, rcond=None)[0]
    return float(limit), float(factor)
