"""Where a series of ever finer meshes leads."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from taichisoft_benchmarks.errors import BenchmarkError

ORDERS = (0.3, 4.0)
"""Between which the order is looked for."""


@dataclass(frozen=True)
class Limit:
    """u = value - factor * nodes ** (-order / 3): the error falls with the element size to the power of the order.

    Attributes:
        value: of an infinitely fine mesh.
        order: [-].
        factor: in the unit of the value.
        doubt: how far the value moves at most when one of the meshes is left out.
    """

    value: float
    order: float
    factor: float
    doubt: float


def limit_of(nodes: Sequence[float], values: Sequence[float]) -> Limit:
    """Richardson's extrapolation with the observed order, fitted to all meshes by least squares.

    Raises:
        BenchmarkError: fewer than four meshes, or they do not converge.
    """
    if len(nodes) < 4:
        raise BenchmarkError(f"a limit with its order and its doubt needs four meshes; there are {len(nodes)}")
    whole = _fit(np.asarray(nodes, dtype=float), np.asarray(values, dtype=float))
    left_out = [_fit(np.delete(nodes, index), np.delete(values, index))[0] for index in range(len(nodes))]
    return Limit(*whole, max(abs(value - whole[0]) for value in left_out))


def _fit(nodes: np.ndarray, values: np.ndarray) -> tuple[float, float, float]:
    """Limit, order and factor: for a given order the other two are linear."""
    from scipy.optimize import minimize_scalar

    def misfit(order: float) -> float:
        limit, factor = _solve(nodes, values, order)
        return float(((limit - factor * nodes ** (-order / 3.0) - values) ** 2).sum())

    order = float(minimize_scalar(misfit, bounds=ORDERS, method="bounded").x)
    if min(abs(order - end) for end in ORDERS) < 0.01:
        raise BenchmarkError("the meshes do not converge to a limit; give finer ones")
    limit, factor = _solve(nodes, values, order)
    return limit, order, factor


def _solve(nodes: np.ndarray, values: np.ndarray, order: float) -> tuple[float, float]:
    """Limit and factor by least squares."""
    columns = np.stack([np.ones(len(nodes)), -(nodes ** (-order / 3.0))], axis=1)
    limit, factor = np.linalg.lstsq(columns, values, rcond=None)[0]
    return float(limit), float(factor)
