"""The page of a study: one HTML file with effects, scatter, the best runs and the failures; every text is escaped."""

import base64
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from typing import Any

from taichisoft_plugins.plots.figure import figure_bytes
from taichisoft_plugins.report.page import STYLE
from taichisoft_studies.analysis import Effect, best_runs, effects, figure_columns, parameter_columns
from taichisoft_studies.run_folder import COMPLETED

BEST = 5
PICTURES = ("lifted.png", "grasped.png", "after.png")
"""Pictures of a run that are shown, the first of them that there is."""
SCATTER_COLUMNS = 4


def study_page(table: Any, folder: Path, wanted: list[str] | None = None, smallest: bool = False) -> str:
    """The page of the study in a folder.

    Args:
        table: its results.
        folder: where its runs are.
        wanted: names of the metrics that it is about; those that vary when none are given. The first one decides which
            runs are best.
        smallest: whether the best runs are those with the smallest value of it.

    Raises:
        StudyError: there is no such metric.
    """
    parameters, figures = parameter_columns(table), figure_columns(table, wanted)
    found = effects(table, parameters, figures)
    title = escape(folder.resolve().name)
    counts = ", ".join(f"{count} {status}" for status, count in sorted(table["status"].value_counts().items()))
    parts = [f"<h1>{title}</h1>", f'<p class="status">{escape(f"{len(table)} runs: {counts}")}</p>']
    if figures and parameters:
        parts += [
            _section("Effect of each parameter", _effects_table(found, parameters, figures)),
            _section("Scatter", _scatter(table, parameters, figures)),
            _section(f"Best runs by {_name(figures[0])}", _best(table, folder, parameters, figures, not smallest)),
        ]
    failed = table[table["status"] != COMPLETED]
    if len(failed):
        rows = failed[["run", *parameters, "status", "message"]].itertuples(index=False)
        parts.append(_section("Failures", _table(["run", *parameters, "status", "message"], rows)))
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f"<title>{title}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<main>\n" + "\n".join(parts)
        + "\n</main>\n</body>\n</html>\n"
    )  # fmt: skip


def _effects_table(found: Sequence[Effect], parameters: Sequence[str], figures: Sequence[str]) -> str:
    """A row for each figure: the rank correlation with each parameter, and the share of the variance."""
    by_pair = {(effect.figure, effect.parameter): effect for effect in found}
    rows = [[_name(figure), *(_said(by_pair[figure, one]) for one in parameters)] for figure in figures]
    about = (
        "<p>Spearman's rank correlation, and the share of the variance that lies between the values of the parameter; "
        "a star marks correlations that chance would give in less than one of a hundred studies.</p>"
    )
    return about + _table(["", *parameters], rows)


def _said(effect: Effect) -> str:
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
    drawing = figure_bytes(figure, "svg").decode()
    return f'<div class="plots">{drawing[drawing.index("<svg") :]}</div>'


def _best(table: Any, folder: Path, parameters: Sequence[str], figures: Sequence[str], largest: bool) -> str:
    best = best_runs(table, figures[0], largest, BEST)
    columns = ["run", *parameters, *figures]
    shown = _table([_name(column) for column in columns], best[columns].itertuples(index=False))
    pictures = "".join(_figure(folder / place, run) for run, place in zip(best["run"], best["folder"], strict=True))
    if not pictures:
        pictures = "<p>There are no pictures: the runs have no recordings (--record), or they cannot be drawn here.</p>"
    return f'{shown}<div class="figures">{pictures}</div>'


def _figure(run: Path, name: str) -> str:
    picture = next((run / file for file in PICTURES if (run / file).is_file()), None)
    if picture is None:
        return ""
    data = base64.b64encode(picture.read_bytes()).decode()
    return (
        f'<figure><img src="data:image/png;base64,{data}" alt="{escape(name)}"><figcaption>{escape(name)}</figcaption>'
        "</figure>"
    )


def _table(columns: Sequence[str], rows: Iterable[Iterable[Any]]) -> str:
    head = "".join(f"<th>{escape(column)}</th>" for column in columns)
    body = "".join(f"<tr>{''.join(f'<td>{escape(_text(value))}</td>' for value in row)}</tr>" for row in rows)
    return f'<div style="overflow-x: auto"><table><tr>{head}</tr>{body}</table></div>'


def _text(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _name(column: str) -> str:
    return column.removeprefix("metrics.")


def _section(title: str, body: str) -> str:
    return f"<section><h2>{escape(title)}</h2>{body}</section>"
