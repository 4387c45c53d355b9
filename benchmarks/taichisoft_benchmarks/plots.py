"""Plots of growth: time per step against nodes, contacts and fingers, as small SVG files."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from taichisoft_benchmarks.errors import BenchmarkError
from taichisoft_benchmarks.results import CaseResult, Results


@dataclass(frozen=True)
class Growth:
    """One plot.

    Attributes:
        group: the swept cases.
        fact: the fact on the horizontal axis.
        axis: its name for people.
    """

    group: str
    fact: str
    axis: str


GROWTHS = (
    Growth("growth_nodes", "nodes", "nodes of the finger"),
    Growth("growth_contacts", "step_contacts", "contacts"),
    Growth("growth_fingers", "nodes", "nodes of 1 to 12 fingers"),
)


def draw_plots(results: Results, folder: Path) -> list[Path]:
    """Draw what the results have of each growth into `folder/GROUP.svg`.

    Raises:
        BenchmarkError: matplotlib is not installed, or no growth was measured.
    """
    require_matplotlib()
    import matplotlib

    found = {growth: points for growth in GROWTHS if len(points := growth_points(results.cases, growth)) > 1}
    if not found:
        raise BenchmarkError(f"--plots: needs two cases of {', '.join(growth.group for growth in GROWTHS)}")
    folder.mkdir(parents=True, exist_ok=True)
    # Text as text and fixed identities: small files that change only with the figures.
    style: Any = {"svg.fonttype": "none", "svg.hashsalt": "taichisoft", "font.size": 9.0}
    with matplotlib.rc_context(style):
        return [_draw(growth, points, folder / f"{growth.group}.svg") for growth, points in found.items()]


def require_matplotlib() -> None:
    """Raise BenchmarkError where it is not installed."""
    try:
        import matplotlib  # noqa: F401
    except ImportError as error:
        raise BenchmarkError("--plots: needs matplotlib; pip install matplotlib") from error


def growth_points(cases: Mapping[str, CaseResult], growth: Growth) -> list[tuple[float, float, float, float]]:
    """What is counted, and median, least and largest time per step [ms]; ascending."""
    points = []
    for case in cases.values():
        if case.group == growth.group and "step_ms" in case.figures:
            figure = case.figures["step_ms"]
            points.append((float(case.facts[growth.fact]), figure.median, min(figure.values), max(figure.values)))
    return sorted(points)


def _draw(growth: Growth, points: list[tuple[float, float, float, float]], path: Path) -> Path:
    from matplotlib.figure import Figure

    count, middle, least, largest = zip(*points, strict=True)
    figure = Figure(figsize=(4.6, 3.1), layout="constrained")
    axes = figure.add_subplot()
    axes.fill_between(count, least, largest, alpha=0.25, linewidth=0)
    axes.loglog(count, middle, marker="o", markersize=4, label="median of the runs")
    axes.loglog(count, [middle[0] * n / count[0] for n in count], "k:", linewidth=1, label="in proportion")
    axes.set_xlabel(growth.axis)
    axes.set_ylabel("time per step [ms]")
    axes.grid(which="major", alpha=0.3)
    axes.legend(frameon=False)
    figure.savefig(path, format="svg", metadata={"Date": None, "Creator": None})
    return path
