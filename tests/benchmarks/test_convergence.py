"""The convergence study of the finger's bend."""

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

from taichisoft_benchmarks import convergence
from taichisoft_benchmarks.case_scenes import tutorial_surfaces
from taichisoft_benchmarks.convergence import ConvergenceStudy, Point, limit_of
from taichisoft_benchmarks.errors import BenchmarkError
from taichisoft_benchmarks.one_body import bend
from taichisoft_studies.refinement import MESH_ORDER


def test_series_is_extrapolated_to_its_limit() -> None:
    """u = limit - factor h^order, with h = nodes^(-1/3)."""
    nodes = [2000, 4000, 9000]
    limit = limit_of(nodes, [59.0 - 700.0 * count ** (-MESH_ORDER / 3) for count in nodes])
    assert (limit.value, limit.factor, limit.doubt) == pytest.approx((59.0, 700.0, 0.0), abs=1e-9)


def test_order_is_that_of_corner_of_270_degrees() -> None:
    """The smallest root of Williams' equation for the symmetric stresses in a wedge with free sides."""
    angle = 1.5 * np.pi
    exponent = brentq(lambda power: np.sin(power * angle) + power * np.sin(angle), 0.3, 0.6)
    assert pytest.approx(2 * exponent, abs=1e-4) == MESH_ORDER


def test_noise_shows_as_doubt() -> None:
    nodes, noises = [2000, 4000, 9000, 20000, 40000], [0.2, -0.2, 0.2, -0.2, 0.2]
    bends = [59.0 - 700.0 * count ** (-MESH_ORDER / 3) + noise for count, noise in zip(nodes, noises, strict=True)]
    limit = limit_of(nodes, bends)
    assert 0.0 < abs(limit.value - 59.0) < 2 * limit.doubt


def test_two_meshes_are_refused() -> None:
    with pytest.raises(BenchmarkError, match="needs three meshes; there are 2"):
        limit_of([1000, 8000], [1.0, 2.0])


def test_rest_does_not_depend_on_steps() -> None:
    """The tolerance is twice what a node may still move when the finger counts as resting."""
    nodes, _, first = bend("tutorial-coarse", element="linear")
    assert nodes == 626
    assert bend("tutorial-coarse", step=1.0, damping=0.3, element="linear")[2] == pytest.approx(first, abs=2e-4)


@pytest.mark.parametrize(("name", "expected"), [("pneunetCutCoarse.vtk", 12.3), ("pneunetCut.vtk", 28.6)])
def test_tutorial_meshes_bend_as_known(shared: Path, name: str, expected: float) -> None:
    """Their displacements come from a calculation in numpy, with SOFA's rotations, and are known to one digit after the
    point."""
    folder = shared / "tutorial-meshes"
    body = {"element": "linear", "corotation": "edges", **tutorial_surfaces(folder)}
    assert bend(str(folder / name), even_mass=True, **body)[2] == pytest.approx(expected, abs=0.05)


def test_measured_mesh_is_not_measured_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        convergence, "bend", lambda mesh, **body: (10, 20, 3.0 if body["element"] == "smoothed" else 1.0)
    )
    first = convergence._point(tmp_path, "8 mm", "finger.msh")
    assert (first.nodes, first.bend, first.linear_bend, first.quadratic_bend) == (10, 3.0, 1.0, None)
    monkeypatch.delattr(convergence, "bend")
    assert convergence._point(tmp_path, "8 mm", "finger.msh") == first


def point(name: str, nodes: int, across: int | None, quadratic: float | None = None) -> Point:
    return Point(name, nodes, 5 * nodes, across, 59.0 - 700.0 * nodes ** (-MESH_ORDER / 3), 57.0, quadratic)


def test_study_fills_its_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The figures are made up: measuring takes minutes."""

    def measured(sizes, even_sizes, tutorial_meshes, results):
        graded = [point(f"{size:g}", int(50000 / size**2), 1, 56.4 if size == 8 else None) for size in sizes]
        limit = limit_of([p.nodes for p in graded], [p.bend for p in graded])
        return ConvergenceStudy(graded, [point("5 mm", 1860, None)], [point("coarse.vtk", 376, None)], limit)

    monkeypatch.setattr(convergence, "measure_all", measured)
    page = tmp_path / "page.md"
    page.write_text("no marks")
    with pytest.raises(BenchmarkError, match="has no line <!-- convergence -->"):
        convergence.main(page, sizes="2,8,4,3")
    page.write_text("before\n<!-- convergence -->\nold\n<!-- end -->\nafter\n")
    convergence.main(page, sizes="2,8,4,3")
    once, plot = page.read_text(), (tmp_path / convergence.PLOT).read_bytes()
    limits = "Limit: 59.0 ± 0.0 mm from quadratic elements"
    assert once.startswith(f"before\n<!-- convergence -->\n{limits}")
    assert "| 57.0 | 56.4 |\n" in once
    assert once.endswith("<!-- end -->\nafter\n")
    assert once.index("| 8 | 781 |") < once.index("| 2 | 12500 |") < once.index("| 5 mm | 1860 | 9300 | ")
    convergence.main(page, sizes="2,8,4,3")
    assert (page.read_text(), (tmp_path / convergence.PLOT).read_bytes()) == (once, plot)
    assert "largest displacement at 30 kPa" in plot.decode()
