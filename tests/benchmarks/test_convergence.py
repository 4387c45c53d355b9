"""The convergence study of the finger's bend."""

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

from taichisoft_benchmarks.case_scenes import tutorial_surfaces
from taichisoft_benchmarks.convergence import limit_of
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
