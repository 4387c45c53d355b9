"""How the finger's bend converges with its mesh: `python -m taichisoft_benchmarks.convergence docs/meshing.md`.

Fills what stands between `<!-- convergence -->` and `<!-- end -->` in the page, and draws the plot beside it. It takes
some twenty minutes, and needs cvxopt (`pip install 'taichisoft[peers]'`). `--tutorial-meshes DIR` adds the two meshes
of SOFA's tutorial, which are not part of the project.
"""

import argparse
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from taichisoft.errors import TaichisoftError
from taichisoft.scenes.shipped import find_file
from taichisoft_benchmarks.convergence_page import Point, Study, draw, page_section
from taichisoft_benchmarks.errors import BenchmarkError
from taichisoft_benchmarks.extrapolation import limit_of
from taichisoft_benchmarks.plots import require_matplotlib
from taichisoft_benchmarks.quadratic_bend import quadratic_bend
from taichisoft_benchmarks.scenes import FINGER, TUTORIAL_CAVITY, TUTORIAL_SURFACE
from taichisoft_benchmarks.static_bend import bend
from taichisoft_meshing.geometry_file import read_geometry
from taichisoft_meshing.quality.mesh_quality import measure
from taichisoft_meshing.scene_meshes import mesh_for_scene

SIZES = (18.0, 12.0, 10.0, 7.75, 6.0, 5.0, 4.0, 3.5, 3.0, 2.6, 2.2)
"""[mm] Largest elements of the graded meshes."""
EVEN_SIZES = (12.0, 8.0, 5.0, 3.5, 2.5, 2.0)
"""[mm] Of the meshes of one size all over, those of the first calculation."""
MOST_FOR_QUADRATIC = 4500
"""Nodes of the largest mesh that is also computed with quadratic elements: six times as many unknowns."""
TUTORIAL_MESHES = ("pneunetCutCoarse.vtk", "pneunetCut.vtk")
MARKED = re.compile(r"(<!-- convergence -->\n).*?(<!-- end -->)", re.DOTALL)
PLOT = "mesh_convergence.svg"


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
    even = [_point(f"{size:g} mm", {"file": FINGER, "set": _one_size(size)}) for size in even_sizes]
    return Study(graded, even, _tutorial_points(tutorial_meshes), quadratic, limit, linear_limit)


def _one_size(size: float) -> dict[str, Any]:
    return {"mesh": {"largest": size, "smallest": size}}


def _tutorial_points(folder: Path | None) -> list[Point]:
    if folder is None:
        return []
    body: dict[str, Any] = {
        "collision_surface": str(folder / TUTORIAL_SURFACE),
        "cavities": {"cavity": {"surface": str(folder / TUTORIAL_CAVITY)}},
    }
    return [_point(name, str(folder / name), **body) for name in TUTORIAL_MESHES]


def _point(name: str, mesh: Any, across: int | None = None, **body: Any) -> Point:
    nodes, elements, by_volume = bend(mesh, **body)
    even = bend(mesh, even_mass=True, **body)[2]
    print(f"{name}: {nodes} nodes, {by_volume:.2f} mm", flush=True)
    return Point(name, nodes, elements, across, by_volume, even)


def main() -> None:
    """Measure, fill the page in place, draw the plot beside it."""
    parser = argparse.ArgumentParser(prog="python -m taichisoft_benchmarks.convergence")
    parser.add_argument("page", type=Path, metavar="PAGE.md")
    parser.add_argument("--tutorial-meshes", type=Path, metavar="DIR")
    parser.add_argument("--sizes", type=float, nargs="+", default=SIZES, metavar="MM")
    parser.add_argument("--even-sizes", type=float, nargs="*", default=EVEN_SIZES, metavar="MM")
    arguments = parser.parse_args()
    try:
        require_matplotlib()  # before the work, not after it
        page = arguments.page.read_text(encoding="utf-8")
        if not MARKED.search(page):
            raise BenchmarkError(f"{arguments.page}: has no line <!-- convergence -->")
        sizes, even_sizes = (sorted(given, reverse=True) for given in (arguments.sizes, arguments.even_sizes))
        study = measure_all(sizes, even_sizes, arguments.tutorial_meshes)
        filled = MARKED.sub(lambda match: f"{match[1]}{page_section(study)}\n{match[2]}", page)
        arguments.page.write_text(filled, encoding="utf-8")
        draw(study, arguments.page.with_name(PLOT))
    except (TaichisoftError, OSError) as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()
