"""Linear and quadratic tetrahedra by numpy, held to fields whose energy is known."""

import numpy as np
import pytest
from conftest import make_block

from taichisoft_benchmarks.quadratic_tetrahedra import compliance, make_elements, stiffness

E, NU = 500.0, 0.3
BLOCK = make_block((4, 2, 2), (40.0, 10.0, 8.0))
VOLUME = 40.0 * 10.0 * 8.0


def energy(field, quadratic: bool) -> float:
    """Of a displacement [mm] that is given at every node [uJ]."""
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


def test_quadratic_elements_bend_the_finger_farther() -> None:
    """On one mesh more freedom can only give more; linear elements approach from below, too."""
    pytest.importorskip("cvxopt")
    from taichisoft.mesh_files import read_volume_mesh
    from taichisoft.shipped import data_folder

    coarse, medium = (
        read_volume_mesh(data_folder() / "meshes" / f"tutorial-{name}.msh") for name in ("coarse", "medium")
    )
    assert compliance(coarse, False) < compliance(medium, False) < 1.5 < 1.8 < compliance(coarse, True) < 2.4
