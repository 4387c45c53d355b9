"""The limit of a series of ever finer meshes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from taichisoft_benchmarks.errors import BenchmarkError
from taichisoft_studies.refinement import MESH_ORDER


@dataclass(frozen=True)
class Limit:
    """The curve value - factor * nodes ** (-MESH_ORDER / 3): errors go with the element size to the power of the order.

    Attributes:
        value: displacement on an infinitely fine mesh [mm].
        factor: displacement that a mesh of a single node would lack [mm].
        doubt: largest change of the value when one of the meshes is left out [mm].
    """

    value: float
    factor: float
    doubt: float

    def at(self, nodes: np.ndarray) -> np.ndarray:
        """Displacements of meshes with these numbers of nodes [mm]."""
        return self.value - self.factor * nodes ** (-MESH_ORDER / 3.0)


def limit_of(nodes: Sequence[float], values: Sequence[float]) -> Limit:
    """Richardson's extrapolation, fitted to all meshes by least squares.

    Args:
        nodes: number of nodes of each mesh.
        values: displacement with each mesh [mm].

    Raises:
        BenchmarkError: there are fewer than three meshes.
    """
    if len(nodes) < 3:
        raise BenchmarkError(f"a limit with its doubt needs three meshes; there are {len(nodes)}")
    counts, given = np.asarray(nodes, dtype=float), np.asarray(values, dtype=float)
    limit, factor = _fit(counts, given)
    left_out = [_fit(np.delete(counts, index), np.delete(given, index))[0] for index in range(len(counts))]
    return Limit(limit, factor, max(abs(value - limit) for value in left_out))


def _fit(nodes: np.ndarray, values: np.ndarray) -> tuple[float, float]:
    """Value and factor of a limit by least squares [mm]."""
    columns = np.stack([np.ones(len(nodes)), -(nodes ** (-MESH_ORDER / 3.0))], axis=1)
    value, factor = np.linalg.lstsq(columns, values, rcond=None)[0]
    return float(value), float(factor)
