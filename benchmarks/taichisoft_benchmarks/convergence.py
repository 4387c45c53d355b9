"""How the finger's bend converges with its mesh: `python -m taichisoft_benchmarks.convergence docs/meshing.md`.

Fills what stands between `<!-- convergence -->` and `<!-- end -->` in the page, and draws the plot beside it. It takes
some minutes; `--tutorial-meshes DIR` adds the two meshes of SOFA's tutorial, which are not part of the project.
"""

import argparse
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from taichisoft.errors import TaichisoftError
from taichisoft_benchmarks.errors import BenchmarkError
from taichisoft_benchmarks.scenes import TUTORIAL_CAVITY, TUTORIAL_SURFACE
from taichisoft_benchmarks.static_bend import bend

SIZES = (10.0, 8.0, 5.0, 3.5, 2.5, 2.0, 1.6)
"""[mm] Of the meshes, largest elements."""
FITTED = 4
"""So many of the finest meshes tell the limit and the order."""
TRIAL = ((531, 19.5), (987, 26.9), (1860, 34.9), (3325, 46.8), (6106, 51.3), (10464, 53.6))
"""Nodes and [mm] of a first calculation on meshes of even size, without any refinement."""
TUTORIAL_MESHES = ("pneunetCutCoarse.vtk", "pneunetCut.vtk")
MARKED = re.compile(r"(<!-- convergence -->\n).*?(<!-- end -->)", re.DOTALL)
PLOT = "mesh_convergence.svg"


@dataclass(frozen=True)
class Point:
    """One mesh.

    Attributes:
        name: what it is called in the table.
        nodes, elements: how many.
        bend: displacement of the node that moves farthest, mass by volume [mm].
        even: the same with the mass spread evenly over the nodes [mm].
    """

    name: str
    nodes: int
    elements: int
    bend: float
    even: float


@dataclass(frozen=True)
class Limit:
    """Where a series leads, u = bend - factor * nodes ** (-order / 3).

    Attributes:
        bend: [mm] of an infinitely fine mesh.
        order: by which the error falls with the element size [-].
        factor: [mm].
        doubt: how far the limit moves when one of the meshes is left out [mm].
    """

    bend: float
    order: float
    factor: float
    doubt: float


def limit_of(nodes: Sequence[float], bends: Sequence[float]) -> Limit:
    """Richardson's extrapolation with the observed order, fitted to all points by least squares.

    Raises:
        BenchmarkError: fewer than four points, or they do not converge.
    """
    if len(nodes) < 4:
        raise BenchmarkError(f"a limit with its order and its doubt needs four meshes; there are {len(nodes)}")
    whole = _fit(nodes, bends)
    left_out = [_fit(np.delete(nodes, index), np.delete(bends, index))[0] for index in range(len(nodes))]
    return Limit(*whole, max(abs(bend - whole[0]) for bend in left_out))


def _fit(nodes: Sequence[float] | np.ndarray, bends: Sequence[float] | np.ndarray) -> tuple[float, float, float]:
    """Limit, order and factor: for a given order the other two are linear."""
    from scipy.optimize import minimize_scalar

    count, bend = np.asarray(nodes, dtype=float), np.asarray(bends, dtype=float)

    def solved(order: float) -> tuple[np.ndarray, float]:
        columns = np.stack([np.ones_like(count), -(count ** (-order / 3.0))], axis=1)
        answer = np.linalg.lstsq(columns, bend, rcond=None)[0]
        return answer, float(((columns @ answer - bend) ** 2).sum())

    order = float(minimize_scalar(lambda order: solved(order)[1], bounds=(0.3, 4.0), method="bounded").x)
    if not 0.31 < order < 3.99:
        raise BenchmarkError("the meshes do not converge to a limit; give finer ones")
    (limit, factor), _ = solved(order)
    return float(limit), order, float(factor)


def measure(sizes: Sequence[float], tutorial_meshes: Path | None) -> tuple[list[Point], list[Point]]:
    """Our meshes by size, and those of the tutorial where they are."""
    points = []
    for size in sizes:
        points.append(_point(f"{size:g} mm", {"file": "tutorial.toml", "size": size}))
    if tutorial_meshes is None:
        return points, []
    body: dict[str, Any] = {
        "collision_surface": str(tutorial_meshes / TUTORIAL_SURFACE),
        "cavities": {"cavity": {"surface": str(tutorial_meshes / TUTORIAL_CAVITY)}},
    }
    return points, [_point(name, str(tutorial_meshes / name), **body) for name in TUTORIAL_MESHES]


def _point(name: str, mesh: Any, **body: Any) -> Point:
    nodes, elements, by_volume = bend(mesh, **body)
    even = bend(mesh, even_mass=True, **body)[2]
    print(f"{name}: {nodes} nodes, {by_volume:.2f} mm", flush=True)
    return Point(name, nodes, elements, by_volume, even)


def table(points: Sequence[Point], tutorial: Sequence[Point], limit: Limit) -> str:
    """Markdown, with the limit below."""
    lines = ["| mesh | nodes | tetrahedra | displacement, mm | of the limit | mass even over nodes, mm |"]
    lines.append("| --- | --- | --- | --- | --- | --- |")
    lines += [
        f"| {point.name} | {point.nodes} | {point.elements} | {point.bend:.1f} | {point.bend / limit.bend:.0%} "
        f"| {point.even:.1f} |"
        for point in (*points, *tutorial)
    ]
    lines.append("")
    lines.append(
        f"Limit: {limit.bend:.1f} mm (± {limit.doubt:.1f} when one of the {FITTED} finest meshes is left out), "
        f"order {limit.order:.1f}."
    )
    return "\n".join(lines)


def draw(points: Sequence[Point], tutorial: Sequence[Point], limit: Limit, path: Path) -> None:
    """Displacement against nodes, as a small SVG that changes only with the figures."""
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": "taichisoft", "font.size": 9.0}):
        figure = Figure(figsize=(5.4, 3.4), layout="constrained")
        axes = figure.add_subplot()
        nodes = np.geomspace(points[-FITTED].nodes, 1.5 * points[-1].nodes, 50)
        axes.axhline(limit.bend, color="0.5", linewidth=1, label=f"limit, {limit.bend:.1f} mm")
        axes.plot(nodes, limit.bend - limit.factor * nodes ** (-limit.order / 3), ":", color="tab:blue", linewidth=1)
        axes.plot([p.nodes for p in points], [p.bend for p in points], "o-", markersize=4, label="taichisoft mesh")
        axes.plot(*zip(*TRIAL, strict=True), "s--", markersize=3, linewidth=1, color="tab:orange", label="even meshes")
        if tutorial:
            axes.plot(
                [p.nodes for p in tutorial], [p.bend for p in tutorial], "^", color="tab:red", label="the tutorial's"
            )
        axes.set_xscale("log")
        axes.set_ylim(bottom=0)
        axes.set_xlabel("nodes of the finger")
        axes.set_ylabel("largest displacement at 30 kPa [mm]")
        axes.grid(which="major", alpha=0.3)
        axes.legend(frameon=False, loc="lower right")
        figure.savefig(path, format="svg", metadata={"Date": None, "Creator": None})


def main() -> None:
    """Measure, fill the page in place, draw the plot beside it."""
    parser = argparse.ArgumentParser(prog="python -m taichisoft_benchmarks.convergence")
    parser.add_argument("page", type=Path, metavar="PAGE.md")
    parser.add_argument("--tutorial-meshes", type=Path, metavar="DIR")
    parser.add_argument("--sizes", type=float, nargs="+", default=SIZES, metavar="MM")
    arguments = parser.parse_args()
    try:
        page = arguments.page.read_text(encoding="utf-8")
        if not MARKED.search(page):
            raise BenchmarkError(f"{arguments.page}: has no line <!-- convergence -->")
        points, tutorial = measure(sorted(arguments.sizes, reverse=True), arguments.tutorial_meshes)
        finest = points[-FITTED:]
        limit = limit_of([point.nodes for point in finest], [point.bend for point in finest])
        text = table(points, tutorial, limit)
        arguments.page.write_text(MARKED.sub(lambda match: f"{match[1]}{text}\n{match[2]}", page), encoding="utf-8")
        draw(points, tutorial, limit, arguments.page.with_name(PLOT))
    except (TaichisoftError, OSError) as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()
