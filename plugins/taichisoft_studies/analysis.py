"""The analysis of a table of runs: the effect of each parameter on a figure, and the best runs."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from taichisoft_studies.errors import StudyError
from taichisoft_studies.results_table import FIXED
from taichisoft_studies.run_folder import COMPLETED

MOST_FIGURES = 12
"""Number of figures without --metric: a run has many that vary in the last digits only."""
HEADLINES = ("final_tip_positions_mm", "final_bending_angles_degrees", "final_normal_forces_mN", "object_", "largest_")
"""Beginnings of the names of figures that come first."""


@dataclass(frozen=True)
class Effect:
    """How a figure depends on a parameter.

    Attributes:
        parameter, figure: their columns.
        correlation: Spearman's rank correlation, from -1 to 1; NaN for values that have no order.
        share: of the figure's variance, that between the groups of equal or similar values of the parameter (the
            correlation ratio, eta squared), from 0 to 1.
        p_value: of the rank correlation, or NaN.
    """

    parameter: str
    figure: str
    correlation: float
    share: float
    p_value: float


def parameter_columns(table: Any) -> list[str]:
    """The columns of parameters that vary."""
    names = [column for column in table.columns if column not in FIXED and not column.startswith("metrics.")]
    return [name for name in names if table[name].nunique(dropna=False) > 1]


def figure_columns(table: Any, wanted: list[str] | None) -> list[str]:
    """The columns of the named figures, or the first columns of numbers that vary.

    Raises:
        StudyError: a figure is unknown.
    """
    metrics = [column for column in table.columns if column.startswith("metrics.")]
    if wanted is not None:
        for name in wanted:
            if f"metrics.{name}" not in metrics:
                raise StudyError(
                    f"--metric {name}: there are: {', '.join(m.removeprefix('metrics.') for m in metrics)}"
                )
        return [f"metrics.{name}" for name in wanted]
    completed = table[table["status"] == COMPLETED]
    varying = [name for name in metrics if _varies(completed[name])]
    first = [name for name in varying if name.removeprefix("metrics.").startswith(HEADLINES)]
    return list(dict.fromkeys([*first, *varying]))[:MOST_FIGURES]


def effects(table: Any, parameters: list[str], figures: list[str]) -> list[Effect]:
    """The effect of each parameter on each figure, in the runs that have both."""
    from scipy.stats import spearmanr

    found = []
    for figure in figures:
        for parameter in parameters:
            both = table[[parameter, figure]].dropna()
            x, y = both[parameter], both[figure].to_numpy(dtype=float)
            correlation = p_value = float("nan")
            if len(both) > 2 and x.dtype.kind in "ifb" and x.nunique() > 1 and len(np.unique(y)) > 1:
                correlation, p_value = map(float, spearmanr(x.to_numpy(dtype=float), y))
            found.append(Effect(parameter, figure, correlation, correlation_ratio(x, y), p_value))
    return found


def correlation_ratio(x: Any, y: np.ndarray) -> float:
    """Share of the variance of `y` that lies between groups of `x`: its values, or fifths of them if there are many."""
    import pandas

    total = float(((y - y.mean()) ** 2).sum()) if len(y) else 0.0
    if total == 0.0:
        return 0.0
    groups = pandas.qcut(x, 5, duplicates="drop") if x.dtype.kind in "if" and x.nunique() > 8 else x
    means = pandas.Series(y, index=x.index).groupby(groups, observed=True).transform("mean").to_numpy()
    return float(((means - y.mean()) ** 2).sum() / total)


def best_runs(table: Any, figure: str, largest: bool, count: int) -> Any:
    """The rows of the completed runs with the largest, or smallest, values of a figure."""
    completed = table[(table["status"] == COMPLETED) & table[figure].notna()]
    return completed.sort_values(figure, ascending=not largest, kind="stable").head(count)


def _varies(column: Any) -> bool:
    """Whether a column has numbers that differ by more than rounding."""
    if column.dtype.kind not in "if" or column.notna().sum() < 2:
        return False
    values = column.dropna().to_numpy(dtype=float)
    return bool(np.ptp(values) > 1e-9 * max(np.abs(values).max(), 1e-30))
