"""How the finger's bend converges with its mesh.

    python -m taichisoft_benchmarks.convergence --output docs/notes/experiments.md

fills the section "convergence" of the page, and draws the plot beside it. It takes some twenty minutes. `--sizes` and
`--even-sizes` choose other meshes; `--tutorial-meshes DIR` adds the two of SOFA's tutorial, which are not part of the
project. `--results` keeps the figures of each mesh: a study that was interrupted resumes.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from taichisoft.mesh import VolumeMesh
from taichisoft.scene import find_file
from taichisoft_benchmarks.case_scenes import FINGER, TUTORIAL_MESHES, tutorial_surfaces
from taichisoft_benchmarks.errors import BenchmarkError
from taichisoft_benchmarks.one_body import bend
from taichisoft_benchmarks.pages import PageOption, fill_section, heading, row, run_program, svg_axes
from taichisoft_meshing.geometry_file import read_geometry
from taichisoft_meshing.mesh_job import mesh_for_scene
from taichisoft_meshing.mesh_quality import measure
from taichisoft_studies.refinement import MESH_ORDER

SIZES = "18,12,10,7.75,6,5,4"
"""Largest elements of the graded meshes [mm]."""
EVEN_SIZES = "12,8,5,3.5"
"""Elements of the meshes of one size all over [mm]."""
MOST_FOR_QUADRATIC = 4500
"""Nodes of the largest mesh that is also computed with quadratic elements: six times as many unknowns."""
DAMPING = 8.0
"""Rayleigh's factor of the stiffness [s] with which elements other than linear ones come to rest."""
PLOT = "mesh_convergence.svg"


@dataclass(frozen=True)
class Limit:
    """The curve value - factor * nodes ** (-MESH_ORDER / 3): errors go with the element size to the power of the order.

    Attributes:
        value: displacement on an infinitely fine mesh [mm].
        factor: displacement that a mesh of a single node would lack [mm].
        doubt: largest change of the value when one of the meshes is left out [mm].
    """

    value: float
    factor: float
    doubt: float

    def at(self, nodes: np.ndarray) -> np.ndarray:
        """Displacements of meshes with these numbers of nodes [mm]."""
        return self.value - self.factor * nodes ** (-MESH_ORDER / 3.0)


def limit_of(nodes: Sequence[float], values: Sequence[float]) -> Limit:
    """Richardson's extrapolation, fitted to all meshes by least squares.

    Args:
        nodes: number of nodes of each mesh.
        values: displacement with each mesh [mm].
    """
    if len(nodes) < 3:
        raise BenchmarkError(f"a limit with its doubt needs three meshes; there are {len(nodes)}")
    counts, given = np.asarray(nodes, dtype=float), np.asarray(values, dtype=float)
    limit, factor = _fit(counts, given)
    left_out = [_fit(np.delete(counts, index), np.delete(given, index))[0] for index in range(len(counts))]
    return Limit(limit, factor, max(abs(value - limit) for value in left_out))


def _fit(nodes: np.ndarray, values: np.ndarray) -> tuple[float, float]:
    """Value and factor of a limit by least squares [mm]."""
    columns = np.stack([np.ones(len(nodes)), -(nodes ** (-MESH_ORDER / 3.0))], axis=1)
    value, factor = np.linalg.lstsq(columns, values, rcond=None)[0]
    return float(value), float(factor)


@dataclass(frozen=True)
class Point:
    """The finger's bend on one mesh.

    Attributes:
        name: name of the mesh in the table.
        nodes, elements: numbers of nodes and tetrahedra.
        across: elements across the walls of the cavity, where it was measured.
        bend: displacement of the node that moves farthest with smoothed elements, the default [mm].
        linear_bend: the same with linear elements [mm].
        quadratic_bend: the same with quadratic elements on this mesh [mm], where it was computed.
    """

    name: str
    nodes: int
    elements: int
    across: int | None
    bend: float
    linear_bend: float
    quadratic_bend: float | None = None


@dataclass(frozen=True)
class ConvergenceStudy:
    """The measurements of all meshes.

    Attributes:
        graded: meshes as `taichisoft mesh` makes them.
        even: meshes of one size all over.
        tutorial: meshes of SOFA's tutorial, where they are at hand.
        limit: limit of the quadratic elements [mm].
    """

    graded: Sequence[Point]
    even: Sequence[Point]
    tutorial: Sequence[Point]
    limit: Limit

    @property
    def quadratic(self) -> Mapping[int, float]:
        """Displacement with quadratic elements on graded meshes [mm], by their number of corners."""
        return {point.nodes: point.quadratic_bend for point in self.graded if point.quadratic_bend is not None}


def measure_all(
    sizes: Sequence[float], even_sizes: Sequence[float], tutorial_meshes: Path | None, results: Path
) -> ConvergenceStudy:
    """Mesh, bend, extrapolate; what `results` has of a mesh is not measured again."""
    file = find_file(FINGER, "fingers", ())
    presets = {size: name for name, size in read_geometry(file).presets.items()}
    results.mkdir(parents=True, exist_ok=True)
    graded = []
    for size in sizes:
        name = f"{size:g}" + (f" ({presets[size]})" if size in presets else "")
        graded.append(_point(results, name, {"file": FINGER, "size": size}, mesh_for_scene(file, size=size)))
    quadratic = [(point.nodes, point.quadratic_bend) for point in graded if point.quadratic_bend is not None]
    limit = limit_of([nodes for nodes, _ in quadratic], [displacement for _, displacement in quadratic])
    even = [
        _point(results, f"{size:g} mm", {"file": FINGER, "set": {"mesh": {"largest": size, "smallest": size}}})
        for size in even_sizes
    ]
    tutorial = []
    if tutorial_meshes is not None:
        surfaces = tutorial_surfaces(tutorial_meshes)
        for name in TUTORIAL_MESHES.values():
            tutorial.append(_point(results, name, str(tutorial_meshes / name), **surfaces))
    return ConvergenceStudy(graded, even, tutorial, limit)


def _point(results: Path, name: str, mesh: Any, graded: VolumeMesh | None = None, **body: Any) -> Point:
    """Measure one mesh, unless that was done; `graded` is the mesh itself, where walls and quadratic elements count."""
    kept = results / f"{name}.json"
    if kept.is_file():
        return Point(**json.loads(kept.read_text(encoding="utf-8")))
    nodes, elements, smoothed = bend(mesh, damping=DAMPING, element="smoothed", **body)
    linear = bend(mesh, element="linear", **body)[2]
    print(f"{name}: {nodes} nodes, {smoothed:.2f} mm smoothed, {linear:.2f} mm linear", flush=True)
    across = quadratic = None
    if graded is not None:
        across = measure(graded).elements_across_walls
        if nodes <= MOST_FOR_QUADRATIC:
            quadratic = bend(mesh, damping=DAMPING, element="quadratic", **body)[2]
    point = Point(name, nodes, elements, across, smoothed, linear, quadratic)
    kept.write_text(json.dumps(asdict(point), indent=2) + "\n", encoding="utf-8")
    return point


def page_section(study: ConvergenceStudy) -> Iterator[str]:
    """The study as Markdown: limit and two tables."""
    limit = study.limit
    yield f"Limit: {limit.value:.1f} ± {limit.doubt:.1f} mm from quadratic elements (± when one mesh is left out).\n"
    titles = [
        "size, mm",
        "nodes",
        "tetrahedra",
        "layers",
        "smoothed, mm",
        "of the limit",
        "linear, mm",
        "quadratic, mm",
    ]
    yield heading(titles)
    for point in study.graded:
        smoothed, quadratic = f"{point.bend:.1f}", "" if point.quadratic_bend is None else f"{point.quadratic_bend:.1f}"
        share, linear = f"{point.bend / limit.value:.0%}", f"{point.linear_bend:.1f}"
        yield row([point.name, point.nodes, point.elements, point.across, smoothed, share, linear, quadratic])
    yield "\nMeshes of one size all over, and SOFA's:\n"
    yield heading(["mesh", "nodes", "tetrahedra", "smoothed, mm", "linear, mm"])
    for point in (*study.even, *study.tutorial):
        yield row([point.name, point.nodes, point.elements, f"{point.bend:.1f}", f"{point.linear_bend:.1f}"])


def draw(study: ConvergenceStudy, path: Path) -> None:
    """Draw displacement against nodes."""
    limit = study.limit
    with svg_axes(path, (8.4, 3.6)) as axes:
        axes.axhspan(limit.value - limit.doubt, limit.value + limit.doubt, color="0.9")
        axes.axhline(limit.value, color="0.5", linewidth=1, label=f"limit, {limit.value:.1f} ± {limit.doubt:.1f} mm")
        nodes = np.geomspace(min(study.quadratic), study.graded[-1].nodes, 50)
        axes.plot(nodes, limit.at(nodes), ":", color="0.5", linewidth=1)
        for points, style, label in (
            (list(study.quadratic.items()), "d", "quadratic, at the number of corners"),
            ([(point.nodes, point.bend) for point in study.graded], "o-", "smoothed, taichisoft mesh"),
            ([(point.nodes, point.bend) for point in study.even], "s-", "smoothed, one size all over"),
            ([(point.nodes, point.linear_bend) for point in study.graded], "o:", "linear, taichisoft mesh"),
            ([(point.nodes, point.linear_bend) for point in study.even], "s:", "linear, one size all over"),
            ([(point.nodes, point.bend) for point in study.tutorial], "^", "smoothed, SOFA's tutorial"),
        ):
            if points:
                axes.plot(*zip(*points, strict=True), style, markersize=4, linewidth=1, label=label)
        axes.set_xscale("log")
        axes.set_ylim(bottom=0)
        axes.set_xlabel("nodes of the finger")
        axes.set_ylabel("largest displacement at 30 kPa [mm]")
        axes.legend(frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))


def main(
    output: PageOption = None,
    results: Annotated[Path, typer.Option(metavar="DIR", help="Where figures are kept.")] = Path("out/convergence"),
    tutorial_meshes: Annotated[Path | None, typer.Option(metavar="DIR", help="Meshes of SOFA's tutorial.")] = None,
    sizes: Annotated[str, typer.Option(metavar="MM,MM", help="Largest elements of graded meshes.")] = SIZES,
    even_sizes: Annotated[str, typer.Option(metavar="MM,MM", help="Elements of meshes of one size.")] = EVEN_SIZES,
) -> None:
    """How the finger's bend converges with its mesh."""
    graded, even = (sorted(map(float, filter(None, text.split(","))), reverse=True) for text in (sizes, even_sizes))

    def lines() -> Iterator[str]:
        study = measure_all(graded, even, tutorial_meshes, results)
        yield from page_section(study)
        if output is not None:
            draw(study, output.with_name(PLOT))

    fill_section(output, "convergence", lines())


if __name__ == "__main__":
    run_program(main, "taichisoft_benchmarks.convergence")
