"""The page about a study: tables and pictures of its runs."""

import base64
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from taichisoft_outputs.html_template import render, svg_element
from taichisoft_outputs.plots import figure_bytes
from taichisoft_studies.errors import StudyError
from taichisoft_studies.results_table import FIXED
from taichisoft_studies.run_job import COMPLETED

# The analysis of a table of runs: the effect of each parameter on a figure, and the best runs.

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


def figure_columns(table: Any, chosen: list[str] | None) -> list[str]:
    """The columns of the named figures, or the first columns of numbers that vary."""
    metrics = [column for column in table.columns if column.startswith("metrics.")]
    if chosen is not None:
        for name in chosen:
            if f"metrics.{name}" not in metrics:
                raise StudyError(
                    f"--metric {name}: there are: {', '.join(m.removeprefix('metrics.') for m in metrics)}"
                )
        return [f"metrics.{name}" for name in chosen]
    completed = table[table["status"] == COMPLETED]
    varying = [name for name in metrics if _varies(completed[name])]
    first = [name for name in varying if name.removeprefix("metrics.").startswith(HEADLINES)]
    return list(dict.fromkeys([*first, *varying]))[:MOST_FIGURES]


def effects(table: Any, parameters: list[str], figures: list[str]) -> list[Effect]:
    """The effect of each parameter on each figure, in the runs that have both."""
    from scipy.stats import spearmanr

    result = []
    for figure in figures:
        for parameter in parameters:
            both = table[[parameter, figure]].dropna()
            x, y = both[parameter], both[figure].to_numpy(dtype=float)
            correlation = p_value = float("nan")
            if len(both) > 2 and x.dtype.kind in "ifb" and x.nunique() > 1 and len(np.unique(y)) > 1:
                correlation, p_value = map(float, spearmanr(x.to_numpy(dtype=float), y))
            result.append(Effect(parameter, figure, correlation, correlation_ratio(x, y), p_value))
    return result


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


# The page of a study: one HTML file with effects, scatter, the best runs and the failures.

TEMPLATE = Path(__file__).with_name("study_page.html")
BEST = 5
PICTURES = ("lifted.png", "grasped.png", "after.png")
"""Files of the picture of a run; the first of them that exists is shown."""


def study_page(table: Any, folder: Path, chosen: list[str] | None = None, smallest: bool = False) -> str:
    """The page of a study as HTML.

    Args:
        table: results of the study, a pandas DataFrame.
        folder: folder of the study.
        chosen: names of the metrics that are shown; by default those that vary. The best runs are chosen by the first.
        smallest: whether the best runs are those with the smallest value.
    """
    parameters, figures = parameter_columns(table), figure_columns(table, chosen)
    counts = ", ".join(f"{count} {status}" for status, count in sorted(table["status"].value_counts().items()))
    failed = table[table["status"] != COMPLETED]
    values: dict[str, Any] = {
        "title": folder.resolve().name,
        "counts": f"{len(table)} runs: {counts}",
        "parameters": list(parameters),
        "figures": [_name(figure) for figure in figures],
        "failures": _rows(failed, ["run", *parameters, "status", "message"]),
    }
    if figures and parameters:
        best = best_runs(table, figures[0], not smallest, BEST)
        values |= {
            "effects": _effects(effects(table, parameters, figures), parameters, figures),
            "scatter": svg_element(_scatter(table, parameters, figures)),
            "best": _rows(best, ["run", *parameters, *figures]),
            "pictures": list(_pictures(best, folder)),
        }
    return render(TEMPLATE, **values)


def _rows(table: Any, columns: list[str]) -> list[Any]:
    return list(table[columns].itertuples(index=False))


def _effects(pairs: Sequence[Effect], parameters: Sequence[str], figures: Sequence[str]) -> list[list[str]]:
    """A row for each figure: the rank correlation with each parameter, and the share of the variance."""
    by_pair = {(effect.figure, effect.parameter): effect for effect in pairs}
    return [[_name(figure), *(_effect_text(by_pair[figure, name]) for name in parameters)] for figure in figures]


def _effect_text(effect: Effect) -> str:
    star = "*" if effect.p_value < 0.01 else ""
    correlation = "" if effect.correlation != effect.correlation else f"{effect.correlation:+.2f}{star}, "
    return f"{correlation}{100 * effect.share:.0f} %"


def _scatter(table: Any, parameters: Sequence[str], figures: Sequence[str]) -> str:
    """Small plots of every figure over every parameter as SVG."""
    from matplotlib.figure import Figure

    size = (2.6 * len(parameters) + 0.6, 2.0 * len(figures) + 0.4)
    figure = Figure(figsize=size, layout="constrained")
    grid = figure.subplots(len(figures), len(parameters), squeeze=False, sharex="col", sharey="row")
    for row, name in enumerate(figures):
        for column, parameter in enumerate(parameters):
            axes, both = grid[row][column], table[[parameter, name]].dropna()
            x = both[parameter]
            axes.plot(x if x.dtype.kind in "ifb" else x.astype(str), both[name], ".", markersize=4, color="#0072b2")
            axes.grid(alpha=0.3, linewidth=0.6)
            axes.tick_params(labelsize=6)
            if row == len(figures) - 1:
                axes.set_xlabel(parameter, fontsize=7, parse_math=False)
            if column == 0:
                axes.set_ylabel(_name(name).replace(".", "\n"), fontsize=6, parse_math=False)
    return figure_bytes(figure, "svg").decode()


def _pictures(runs: Any, folder: Path) -> Iterator[tuple[str, str]]:
    """Name and picture, as base64, of each run that has a picture."""
    for run, place in zip(runs["run"], runs["folder"], strict=True):
        files = [folder / place / name for name in PICTURES if (folder / place / name).is_file()]
        if files:
            yield run, base64.b64encode(files[0].read_bytes()).decode()


def _name(column: str) -> str:
    return column.removeprefix("metrics.")
