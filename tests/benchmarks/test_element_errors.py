"""Bodies whose deformation is known, by the study of elements on small meshes."""

import numpy as np
import pytest

from taichisoft_benchmarks.regular_meshes import bar, hollow_sphere, rounded, tube
from taichisoft_benchmarks.studies.element_errors import (
    BEAM,
    BEAM_LOADS,
    INNER,
    OUTER,
    beam_frequency,
    beam_sag,
    sphere_error,
    tube_error,
)


def test_meshes_have_the_volumes_of_their_bodies() -> None:
    """A box exactly; a sphere and a tube of flat sides a little less, by the square of an angle over an edge."""
    from taichisoft.mesh import tetrahedron_volumes

    def volume(mesh) -> float:
        return tetrahedron_volumes(mesh.nodes, mesh.elements).sum()

    assert volume(bar((3, 2, 2), BEAM)) == pytest.approx(np.prod(BEAM), rel=1e-12)
    shell = 4 / 3 * np.pi * (OUTER**3 - INNER**3)
    assert volume(hollow_sphere(INNER, OUTER, 6, 2)) == pytest.approx(shell, rel=0.03)
    wall = np.pi * (OUTER**2 - INNER**2) * 20.0
    assert volume(tube(INNER, OUTER, 20.0, 40, 2, 2)) == pytest.approx(wall, rel=0.005)


@pytest.mark.parametrize("poisson_ratio", [0.3, 0.499])
def test_smoothed_tetrahedra_follow_lame(poisson_ratio: float) -> None:
    """A tube of 720 nodes under pressure within 1 %, a sphere of 972 within 3 %, where linear tetrahedra lock."""
    assert abs(tube_error("smoothed", poisson_ratio, tube(INNER, OUTER, 20.0, 24, 4, 5))) < 0.01
    assert abs(sphere_error("smoothed", poisson_ratio, hollow_sphere(INNER, OUTER, 4, 5))) < 0.03


def test_linear_tetrahedra_lock() -> None:
    """What the others are for: at 0.499 a quarter of a tube's growth is missing."""
    assert tube_error("linear", 0.499, tube(INNER, OUTER, 20.0, 24, 4, 5)) < -0.2


def test_quadratic_tetrahedra_follow_lame() -> None:
    """A tube with 240 corners, within 2.5 %: its sides are straight."""
    assert abs(tube_error("quadratic", 0.499, tube(INNER, OUTER, 20.0, 20, 3, 2))) < 0.025


@pytest.mark.parametrize(("poisson_ratio", "bound"), [(0.3, 0.003), (0.49, 0.015)])
def test_pressure_on_curved_sides_follows_lame(poisson_ratio: float, bound: float) -> None:
    """A tube of twelve cells around: 0.13 and 1.05 % off, where straight sides take 3.6 %.

    A pressure that acts on flat triangles between the nodes of the curved sides is 2.2 % off at 0.3.
    """
    straight = tube(INNER, OUTER, 20.0, 12, 2, 2)
    assert abs(tube_error("quadratic", poisson_ratio, rounded(straight, axes=2))) < bound
    assert abs(tube_error("quadratic", poisson_ratio, straight)) > 0.03


@pytest.mark.parametrize(("load", "measured"), [("own weight", 6.5), ("52 g", 17.0), ("101 g", 25.8)])
def test_the_measured_beam(load: str, measured: float) -> None:
    """Dragon Skin 10 at 0.499, one modulus for all loads: within 5 % of the measured displacement of the tip."""
    assert beam_sag("quadratic", (10, 3, 3), BEAM_LOADS[load]) == pytest.approx(measured, rel=0.05)


def test_a_beam_swings_as_measured() -> None:
    """7.7 Hz, within 5 %; no low mode of motion comes in between."""
    assert beam_frequency("smoothed", (13, 4, 4), step=0.004, duration=0.8) == pytest.approx(7.7, rel=0.05)
