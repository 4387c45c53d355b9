"""The convergence study as tables and as a plot."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from taichisoft_benchmarks.extrapolation import ORDER, Limit

TRIAL = {531: 19.5, 987: 26.9, 1860: 34.9, 3325: 46.8, 6106: 51.3, 10464: 53.6}
"""Displacement [mm] by nodes of a first calculation, on meshes of one size all over, before the finger was at rest."""


@dataclass(frozen=True)
class Point:
    """One mesh.

    Attributes:
        name: what it is called in the table.
        nodes, elements: how many.
        across: elements across the walls of the cavity, where it was measured.
        bend: displacement of the node that moves farthest, mass by volume [mm].
        even_bend: the same with the mass spread evenly over the nodes [mm].
    """

    name: str
    nodes: int
    elements: int
    across: int | None
    bend: float
    even_bend: float


@dataclass(frozen=True)
class Study:
    """What was measured.

    Attributes:
        graded: meshes as `taichisoft mesh` makes them.
        even: meshes of one size all over.
        tutorial: those of SOFA's tutorial, where they are.
        quadratic: displacement with quadratic elements on graded meshes [mm], by their corners.
        limit: where the quadratic elements lead [mm].
        linear_limit: where the linear ones lead, from meshes with two elements across walls [mm].
    """

    graded: Sequence[Point]
    even: Sequence[Point]
    tutorial: Sequence[Point]
    quadratic: Mapping[int, float]
    limit: Limit
    linear_limit: Limit


def page_section(study: Study) -> str:
    """Markdown."""
    limit, linear = study.limit, study.linear_limit
    parts = [
        f"Limit: {limit.value:.1f} ± {limit.doubt:.1f} mm from quadratic elements, {linear.value:.1f} ± "
        f"{linear.doubt:.1f} mm from linear ones with two elements across walls (± when one mesh is left out).",
        _graded_table(study),
        "Meshes of one size all over, and SOFA's, with the mass spread evenly over the nodes as in its tutorial:",
        _other_table(study),
    ]
    return "\n\n".join(parts)


def _graded_table(study: Study) -> str:
    rows = [
        "| size, mm | nodes | tetrahedra | elements across | displacement, mm | of the limit | mass even, mm "
        "| quadratic elements, mm |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for point in study.graded:
        quadratic = study.quadratic.get(point.nodes)
        rows.append(
            f"| {point.name} | {point.nodes} | {point.elements} | {point.across} | {point.bend:.1f} "
            f"| {point.bend / study.limit.value:.0%} | {point.even_bend:.1f} "
            f"| {'' if quadratic is None else f'{quadratic:.1f}'} |"
        )
    return "\n".join(rows)


def _other_table(study: Study) -> str:
    rows = ["| mesh | nodes | tetrahedra | displacement, mm | first calculation, mm |", "|---|---|---|---|---|"]
    rows += [
        f"| {point.name} | {point.nodes} | {point.elements} | {point.even_bend:.1f} | {TRIAL.get(point.nodes, '')} |"
        for point in (*study.even, *study.tutorial)
    ]
    return "\n".join(rows)


def draw(study: Study, path: Path) -> None:
    """Displacement against nodes, as a small SVG that changes only with the figures."""
    import matplotlib
    from matplotlib.figure import Figure

    limit = study.limit
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": "taichisoft", "font.size": 9.0}):
        figure = Figure(figsize=(5.6, 3.6), layout="constrained")
        axes = figure.add_subplot()
        axes.axhspan(limit.value - limit.doubt, limit.value + limit.doubt, color="0.9")
        axes.axhline(limit.value, color="0.5", linewidth=1, label=f"limit, {limit.value:.1f} ± {limit.doubt:.1f} mm")
        nodes = np.geomspace(min(study.quadratic), study.graded[-1].nodes, 50)
        axes.plot(nodes, limit.value - limit.factor * nodes ** (-ORDER / 3), ":", color="0.5", linewidth=1)
        for points, style, label in (
            (list(study.quadratic.items()), "d", "the same meshes, quadratic elements"),
            ([(point.nodes, point.bend) for point in study.graded], "o-", "taichisoft mesh"),
            ([(point.nodes, point.even_bend) for point in study.even], "s-", "one size all over"),
            (list(TRIAL.items()), "x:", "first calculation, not at rest"),
            ([(point.nodes, point.even_bend) for point in study.tutorial], "^", "SOFA's tutorial"),
        ):
            if points:
                axes.plot(*zip(*points, strict=True), style, markersize=4, linewidth=1, label=label)
        axes.set_xscale("log")
        axes.set_ylim(bottom=0)
        axes.set_xlabel("nodes of the finger")
        axes.set_ylabel("largest displacement at 30 kPa [mm]")
        axes.grid(which="major", alpha=0.3)
        axes.legend(frameon=False, loc="lower right")
        figure.savefig(path, format="svg", metadata={"Date": None, "Creator": None})
