"""Linear and quadratic tetrahedra by numpy, held to fields whose energy is known."""

import numpy as np
import pytest
from blocks import make_block

from taichisoft.errors import TaichisoftError
from taichisoft.meshes.files import read_volume_mesh
from taichisoft.meshes.volume_mesh import boundary_triangles
from taichisoft.scenes.shipped import data_folder
from taichisoft_benchmarks.studies.finger_at_rest import bend
from taichisoft_benchmarks.studies.quadratic_tetrahedra import (
    DeformedCavity,
    elastic_forces,
    make_elements,
    quadratic_bend,
    stiffness,
)

E, NU = 500.0, 0.3
BLOCK = make_block((4, 2, 2), (40.0, 10.0, 8.0))
VOLUME = 40.0 * 10.0 * 8.0


def energy(field, quadratic: bool) -> float:
    """Energy of a displacement [mm] that is given at every node [uJ]."""
    elements = make_elements(BLOCK.nodes, BLOCK.elements, quadratic)
    matrix = stiffness(elements, np.full(elements.weights.shape, E), NU)
    moved = np.stack(field(*elements.nodes.T), axis=1).ravel()
    return 0.5 * float(moved @ matrix @ moved)


@pytest.mark.parametrize("quadratic", [False, True])
def test_a_constant_strain_has_its_energy(quadratic: bool) -> None:
    """A pull along x with free sides: E e^2 V / 2, exact for both."""
    pull = 0.01
    exact = 0.5 * E * pull**2 * VOLUME
    assert energy(lambda x, y, z: (pull * x, -NU * pull * y, -NU * pull * z), quadratic) == pytest.approx(exact)


def bent(x, y, z, curvature: float = 0.002):
    """Pure bending about z."""
    return curvature * x * y, 0.5 * curvature * (NU * (z**2 - y**2) - x**2), -NU * curvature * y * z


def test_bending_has_its_energy_in_quadratic_elements_and_too_much_in_linear_ones() -> None:
    """E I k^2 L / 2 with I = width height^3 / 12: why thin walls of linear elements are too stiff."""
    exact = 0.5 * E * (8.0 * 10.0**3 / 12) * 0.002**2 * 40.0
    assert energy(bent, quadratic=True) == pytest.approx(exact)
    assert energy(bent, quadratic=False) > 1.5 * exact


def turned(angle: float) -> np.ndarray:
    return np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize("quadratic", [False, True])
def test_elastic_forces_are_those_of_a_stretch_that_is_turned(quadratic: bool) -> None:
    """None inside a uniform stress, and at the end E e A along the turned axis."""
    pull, angle = 0.02, 1.9
    elements = make_elements(BLOCK.nodes, BLOCK.elements, quadratic)
    stretched = elements.nodes * (1 + pull, 1 - NU * pull, 1 - NU * pull)
    _, forces = elastic_forces(elements, np.full(elements.weights.shape, E), NU, stretched @ turned(angle).T)
    along = elements.nodes[:, 0]
    at_end = np.isclose(along, along.max())
    np.testing.assert_allclose(forces[at_end].sum(axis=0), -E * pull * 80.0 * turned(angle)[:, 0], atol=1e-9)
    inside = ~at_end & ~np.isclose(along, along.min())
    np.testing.assert_allclose(forces[inside], 0.0, atol=1e-9)


def test_an_element_that_is_turned_inside_out_is_an_error() -> None:
    elements = make_elements(BLOCK.nodes, BLOCK.elements, True)
    with pytest.raises(TaichisoftError, match="inside out"):
        elastic_forces(elements, np.full(elements.weights.shape, E), NU, elements.nodes * (-1.0, 1.0, 1.0))


@pytest.mark.parametrize("quadratic", [False, True])
def test_pressure_is_the_slope_of_the_volume(quadratic: bool) -> None:
    """A block with curved sides has the volume of Euler's relation for functions of degree three, along any motion."""
    elements = make_elements(BLOCK.nodes, BLOCK.elements, quadratic)
    cavity = DeformedCavity(elements, boundary_triangles(BLOCK.elements))
    rest = elements.nodes
    assert float((cavity.volume_gradient(rest) * rest).sum()) / 3 == pytest.approx(VOLUME)
    bulged = rest + 0.02 * np.roll(rest, 1, axis=1) * rest
    motion = np.sin(rest)
    volumes = [
        float((cavity.volume_gradient(place) * place).sum()) / 3
        for place in (bulged + 1e-4 * motion, bulged - 1e-4 * motion)
    ]
    slope = float((cavity.volume_gradient(bulged) * motion).sum())
    assert slope == pytest.approx((volumes[0] - volumes[1]) / 2e-4, rel=1e-7)
    np.testing.assert_allclose(cavity.volume_gradient(bulged).sum(axis=0), 0.0, atol=1e-9)


def test_linear_elements_rest_where_the_engine_does_and_quadratic_ones_bend_farther() -> None:
    pytest.importorskip("cvxopt")
    mesh = read_volume_mesh(data_folder() / "meshes" / "tutorial-coarse.msh")
    linear = quadratic_bend(mesh, quadratic=False)
    assert linear == pytest.approx(bend("tutorial-coarse", element="linear")[2], abs=5e-3)
    assert quadratic_bend(mesh, pressure=5.0) > 2 * quadratic_bend(mesh, quadratic=False, pressure=5.0)
