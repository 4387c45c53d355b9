"""The page of a study: one HTML file with effects, scatter, the best runs and the failures."""

import base64
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from taichisoft_outputs.html_template import render, svg_element
from taichisoft_outputs.plots.figure import figure_bytes
from taichisoft_studies.analysis import Effect, best_runs, effects, figure_columns, parameter_columns
from taichisoft_studies.run_folder import COMPLETED

TEMPLATE = Path(__file__).with_name("study_page.html")
BEST = 5
PICTURES = ("lifted.png", "grasped.png", "after.png")
"""Files of the picture of a run; the first of them that exists is shown."""


def study_page(table: Any, folder: Path, wanted: list[str] | None = None, smallest: bool = False) -> str:
    """The page of a study as HTML.

    Args:
        table: results of the study, a pandas DataFrame.
        folder: folder of the study.
        wanted: names of the metrics that are shown; by default those that vary. The best runs are chosen by the first.
        smallest: whether the best runs are those with the smallest value.

    Raises:
        StudyError: the metric is unknown.
    """
    parameters, figures = parameter_columns(table), figure_columns(table, wanted)
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


def _effects(found: Sequence[Effect], parameters: Sequence[str], figures: Sequence[str]) -> list[list[str]]:
    """A row for each figure: the rank correlation with each parameter, and the share of the variance."""
    by_pair = {(effect.figure, effect.parameter): effect for effect in found}
    return [[_name(figure), *(_effect_text(by_pair[figure, one]) for one in parameters)] for figure in figures]


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
