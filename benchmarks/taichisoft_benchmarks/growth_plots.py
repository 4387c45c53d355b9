"""Plots of growth: time per step against nodes, contacts and fingers, as small SVG files."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from taichisoft_benchmarks.case_results import CaseResult, Results

GROWTHS = {
    "growth_nodes": ("nodes", "nodes of the finger"),
    "growth_contacts": ("step_contacts", "contacts"),
    "growth_fingers": ("nodes", "nodes of 1 to 12 fingers"),
}
"""The fact of the cases that stands on the horizontal axis, and the name of the axis, by group of cases."""


def draw_plots(results: Results, folder: Path) -> list[Path]:
    """Draw every growth of which two cases were measured into `folder/GROUP.svg`."""
    paths = []
    for group, (fact, axis) in GROWTHS.items():
        points = growth_points(results.cases, group, fact)
        if len(points) > 1:
            paths.append(folder / f"{group}.svg")
            _draw(points, axis, paths[-1])
    return paths


def growth_points(cases: Mapping[str, CaseResult], group: str, fact: str) -> list[tuple[float, float, float, float]]:
    """Value of the fact, and median, least and largest time per step [ms]; ascending."""
    points = []
    for case in cases.values():
        if case.group == group and "step_ms" in case.figures:
            figure = case.figures["step_ms"]
            points.append((float(case.facts[fact]), figure.median, min(figure.values), max(figure.values)))
    return sorted(points)


def _draw(points: list[tuple[float, float, float, float]], axis: str, path: Path) -> None:
    count, middle, least, largest = zip(*points, strict=True)
    with svg_axes(path, (4.6, 3.1)) as axes:
        axes.fill_between(count, least, largest, alpha=0.25, linewidth=0)
        axes.loglog(count, middle, marker="o", markersize=4, label="median of the runs")
        axes.loglog(count, [middle[0] * n / count[0] for n in count], "k:", linewidth=1, label="in proportion")
        axes.set_xlabel(axis)
        axes.set_ylabel("time per step [ms]")
        axes.legend(frameon=False)


@contextmanager
def svg_axes(path: Path, size: tuple[float, float], columns: int = 1) -> Iterator[Any]:
    """Axes of an SVG file that is written at the end, an array of them where there are several; `size` in inches."""
    import matplotlib
    from matplotlib.figure import Figure

    # Text as text and fixed identities: small files that change only with the figures.
    style: Any = {"svg.fonttype": "none", "svg.hashsalt": "taichisoft", "font.size": 9.0}
    with matplotlib.rc_context(style):
        figure = Figure(figsize=size, layout="constrained")
        axes = figure.subplots(ncols=columns, squeeze=False)[0]
        for one in axes:
            one.grid(which="major", alpha=0.3)
        yield axes if columns > 1 else axes[0]
        figure.savefig(path, format="svg", metadata={"Date": None, "Creator": None})
