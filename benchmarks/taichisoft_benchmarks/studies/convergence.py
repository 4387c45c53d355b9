"""How the finger's bend converges with its mesh.

    python -m taichisoft_benchmarks.studies.convergence --output docs/notes/mesh-convergence.md

fills what stands between `<!-- convergence -->` and `<!-- end -->` in the page, and draws the plot beside it. It takes
some twenty minutes, and needs cvxopt (`pip install 'taichisoft[peers]'`). `--tutorial-meshes DIR` adds the two meshes
of SOFA's tutorial, which are not part of the project.
"""

import argparse
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from taichisoft.errors import TaichisoftError
from taichisoft.scenes.shipped import find_file
from taichisoft_benchmarks.errors import BenchmarkError
from taichisoft_benchmarks.plots import svg_axes
from taichisoft_benchmarks.scenes import FINGER, TUTORIAL_MESHES, tutorial_surfaces
from taichisoft_benchmarks.studies.extrapolation import Limit, limit_of
from taichisoft_benchmarks.studies.finger_at_rest import bend
from taichisoft_benchmarks.studies.quadratic_tetrahedra import quadratic_bend
from taichisoft_meshing.geometry_file import read_geometry
from taichisoft_meshing.quality.mesh_quality import measure
from taichisoft_meshing.scene_meshes import mesh_for_scene

SIZES = (18.0, 12.0, 10.0, 7.75, 6.0, 5.0, 4.0, 3.5, 3.0, 2.6, 2.2)
"""Largest elements of the graded meshes [mm]."""
EVEN_SIZES = (12.0, 8.0, 5.0, 3.5, 2.5, 2.0)
"""Elements of the meshes of one size all over [mm], which are those of the first calculation."""
MOST_FOR_QUADRATIC = 4500
"""Nodes of the largest mesh that is also computed with quadratic elements: six times as many unknowns."""
TRIAL = {531: 19.5, 987: 26.9, 1860: 34.9, 3325: 46.8, 6106: 51.3, 10464: 53.6}
"""Displacement [mm] by nodes of a first calculation, on meshes of one size all over, before the finger was at rest."""
MARKED = re.compile(r"(<!-- convergence -->\n).*?(<!-- end -->)", re.DOTALL)
PLOT = "mesh_convergence.svg"


@dataclass(frozen=True)
class Point:
    """The finger's bend on one mesh.

    Attributes:
        name: name of the mesh in the table.
        nodes, elements: numbers of nodes and tetrahedra.
        across: elements across the walls of the cavity, where it was measured.
        bend: displacement of the node that moves farthest [mm], mass by volume.
        even_bend: the same displacement with the mass spread evenly over the nodes [mm].
    """

    name: str
    nodes: int
    elements: int
    across: int | None
    bend: float
    even_bend: float


@dataclass(frozen=True)
class Study:
    """The measurements of all meshes.

    Attributes:
        graded: meshes as `taichisoft mesh` makes them.
        even: meshes of one size all over.
        tutorial: meshes of SOFA's tutorial, where they are at hand.
        quadratic: displacement with quadratic elements on graded meshes [mm], by their number of corners.
        limit: limit of the quadratic elements [mm].
        linear_limit: limit of the linear elements [mm], from meshes with two elements across walls.
    """

    graded: Sequence[Point]
    even: Sequence[Point]
    tutorial: Sequence[Point]
    quadratic: Mapping[int, float]
    limit: Limit
    linear_limit: Limit


def measure_all(sizes: Sequence[float], even_sizes: Sequence[float], tutorial_meshes: Path | None) -> Study:
    """Mesh, bend, extrapolate.

    Raises:
        TaichisoftError: a mesh or a simulation failed, or the meshes do not converge.
    """
    file = find_file(FINGER, "fingers", ())
    presets = {size: name for name, size in read_geometry(file).presets.items()}
    graded: list[Point] = []
    quadratic: dict[int, float] = {}
    for size in sizes:
        mesh = mesh_for_scene(file, size=size)
        name = f"{size:g}" + (f" ({presets[size]})" if size in presets else "")
        graded.append(_point(name, {"file": FINGER, "size": size}, measure(mesh).elements_across_walls))
        if len(mesh.nodes) <= MOST_FOR_QUADRATIC:
            quadratic[len(mesh.nodes)] = quadratic_bend(mesh)
            print(f"{name} quadratic: {quadratic[len(mesh.nodes)]:.2f} mm", flush=True)
    limit = limit_of(list(quadratic), list(quadratic.values()))
    layered = [point for point in graded if point.across is not None and point.across >= 2]
    linear_limit = limit_of([point.nodes for point in layered], [point.bend for point in layered])
    even = [
        _point(f"{size:g} mm", {"file": FINGER, "set": {"mesh": {"largest": size, "smallest": size}}})
        for size in even_sizes
    ]
    tutorial = []
    if tutorial_meshes is not None:
        surfaces = tutorial_surfaces(tutorial_meshes)
        tutorial = [_point(name, str(tutorial_meshes / name), **surfaces) for name in TUTORIAL_MESHES.values()]
    return Study(graded, even, tutorial, quadratic, limit, linear_limit)


def _point(name: str, mesh: Any, across: int | None = None, **body: Any) -> Point:
    nodes, elements, by_volume = bend(mesh, element="linear", **body)
    even = bend(mesh, even_mass=True, element="linear", **body)[2]
    print(f"{name}: {nodes} nodes, {by_volume:.2f} mm", flush=True)
    return Point(name, nodes, elements, across, by_volume, even)


def page_section(study: Study) -> str:
    """The study as Markdown: limits and two tables."""
    limit, linear = study.limit, study.linear_limit
    graded = [
        "| size, mm | nodes | tetrahedra | elements across | displacement, mm | of the limit | mass even, mm "
        "| quadratic elements, mm |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for point in study.graded:
        quadratic = study.quadratic.get(point.nodes)
        graded.append(
            f"| {point.name} | {point.nodes} | {point.elements} | {point.across} | {point.bend:.1f} "
            f"| {point.bend / limit.value:.0%} | {point.even_bend:.1f} "
            f"| {'' if quadratic is None else f'{quadratic:.1f}'} |"
        )
    others = ["| mesh | nodes | tetrahedra | displacement, mm | first calculation, mm |", "|---|---|---|---|---|"]
    others += [
        f"| {point.name} | {point.nodes} | {point.elements} | {point.even_bend:.1f} | {TRIAL.get(point.nodes, '')} |"
        for point in (*study.even, *study.tutorial)
    ]
    parts = [
        f"Limit: {limit.value:.1f} ± {limit.doubt:.1f} mm from quadratic elements, {linear.value:.1f} ± "
        f"{linear.doubt:.1f} mm from linear ones with two elements across walls (± when one mesh is left out).",
        "\n".join(graded),
        "Meshes of one size all over, and SOFA's, with the mass spread evenly over the nodes as in its tutorial:",
        "\n".join(others),
    ]
    return "\n\n".join(parts)


def draw(study: Study, path: Path) -> None:
    """Draw displacement against nodes."""
    limit = study.limit
    with svg_axes(path, (5.6, 3.6)) as axes:
        axes.axhspan(limit.value - limit.doubt, limit.value + limit.doubt, color="0.9")
        axes.axhline(limit.value, color="0.5", linewidth=1, label=f"limit, {limit.value:.1f} ± {limit.doubt:.1f} mm")
        nodes = np.geomspace(min(study.quadratic), study.graded[-1].nodes, 50)
        axes.plot(nodes, limit.at(nodes), ":", color="0.5", linewidth=1)
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
        axes.legend(frameon=False, loc="lower right")


def main() -> None:
    """Measure, fill the page in place, draw the plot beside it."""
    parser = argparse.ArgumentParser(prog="python -m taichisoft_benchmarks.studies.convergence")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="PAGE.md", help="page to fill")
    parser.add_argument("--tutorial-meshes", type=Path, metavar="DIR", help="folder with the meshes of SOFA's tutorial")
    sizes: dict[str, Any] = {"type": float, "metavar": "MM"}
    parser.add_argument("--sizes", nargs="+", default=SIZES, help="largest elements of graded meshes [mm]", **sizes)
    parser.add_argument("--even-sizes", nargs="*", default=EVEN_SIZES, help="elements of even meshes [mm]", **sizes)
    arguments = parser.parse_args()
    try:
        page = arguments.output.read_text(encoding="utf-8")
        if not MARKED.search(page):
            raise BenchmarkError(f"{arguments.output}: has no line <!-- convergence -->")
        graded, even = (sorted(given, reverse=True) for given in (arguments.sizes, arguments.even_sizes))
        study = measure_all(graded, even, arguments.tutorial_meshes)
        filled = MARKED.sub(lambda match: f"{match[1]}{page_section(study)}\n{match[2]}", page)
        arguments.output.write_text(filled, encoding="utf-8")
        draw(study, arguments.output.with_name(PLOT))
    except (TaichisoftError, OSError) as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()
