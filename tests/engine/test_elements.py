"""Kinds of elements, and laws of rubber as functions."""

from typing import get_args

import numpy as np
import pytest
from blocks import block_hexahedra, make_block

from taichisoft import VolumeMesh
from taichisoft.mechanics import ELEMENT_KINDS
from taichisoft.mechanics.kernels.domain_deformation import for_kernels
from taichisoft.mesh import SIX_TETRAHEDRA, element_volumes, with_middle_nodes
from taichisoft.runtime import RUBBER_LAWS, kernel
from taichisoft.runtime.language import Scalars
from taichisoft.runtime.rubber_laws import SMALLEST_STRETCH
from taichisoft.scene.soft_body import SoftBodySettings

# Kinds of elements: the names in scenes, constant strains, masses, and the domains of an element's stress.


def test_scenes_name_all_kinds() -> None:
    assert get_args(SoftBodySettings.model_fields["element"].annotation) == tuple(ELEMENT_KINDS)


def block_for(name: str, cells: tuple[int, int, int]) -> VolumeMesh:
    """A block of 30 x 20 x 10 mm with elements of four nodes, those of hexahedra six by six."""
    mesh = make_block(cells, (30.0, 20.0, 10.0))
    if name == "hexahedral":
        mesh.elements[:] = block_hexahedra(cells)[:, SIX_TETRAHEDRA].reshape(-1, 4)
    return mesh


@pytest.mark.parametrize("name", ELEMENT_KINDS)
def test_constant_strain_passes_the_patch_test(name: str) -> None:
    """Every domain of a block with moved inner nodes has the F of an affine motion, and a constant stress is at rest
    inside: sum of w P g is 0 at inner nodes; both weights add up to the volume. To round-off."""
    mesh, kind = block_for(name, (3, 3, 3)), ELEMENT_KINDS[name]
    inner = ((mesh.nodes > mesh.nodes.min(axis=0) + 1e-6) & (mesh.nodes < mesh.nodes.max(axis=0) - 1e-6)).all(axis=1)
    mesh.nodes[inner] += np.random.default_rng(1).uniform(-1.0, 1.0, (inner.sum(), 3))
    if len(kind.mass_shares) == 10:
        mesh = with_middle_nodes(mesh)
    inner = ((mesh.nodes > mesh.nodes.min(axis=0) + 1e-6) & (mesh.nodes < mesh.nodes.max(axis=0) - 1e-6)).all(axis=1)
    assert inner.any()
    domains = kind.domains(mesh.nodes, mesh.elements, np.zeros(len(mesh.elements), dtype=np.int32))
    affine = np.eye(3) + np.random.default_rng(2).uniform(-0.3, 0.3, (3, 3))
    found = domains.deformation(mesh.nodes @ affine.T)
    np.testing.assert_allclose(found, np.broadcast_to(affine, found.shape), atol=1e-12)
    assert domains.volume.sum(axis=0) == pytest.approx(2 * [element_volumes(mesh.nodes, mesh.elements).sum()])
    for weight in domains.volume.T:
        force = np.zeros_like(mesh.nodes)
        np.add.at(force, domains.node, np.repeat(weight, np.diff(domains.start))[:, None] * domains.gradient)
        assert np.abs(force[inner]).max() < 1e-11 * np.abs(force).max() + 1e-12
    assert kind.mass_shares.sum() == pytest.approx(1.0)


@pytest.mark.parametrize("name", ELEMENT_KINDS)
def test_stress_domains_contain_nodes_of_the_element(name: str) -> None:
    """Each domain that counts for an element, of shape or of volume, contains a node of the element, and has weight."""
    mesh, kind = block_for(name, (2, 2, 2)), ELEMENT_KINDS[name]
    mesh = with_middle_nodes(mesh) if len(kind.mass_shares) == 10 else mesh
    material = np.zeros(len(mesh.elements), dtype=np.int32)
    domains = kind.domains(mesh.nodes, mesh.elements, material)
    for weight, found in zip(
        domains.volume.T, kind.stress_domains(mesh.elements, len(mesh.nodes), material), strict=True
    ):
        for own, numbers in zip(mesh.elements, found.reshape(len(mesh.elements), -1), strict=True):
            assert (weight[numbers] > 0.0).all()
            assert all(np.isin(domains.node[domains.start[d] : domains.start[d + 1]], own).any() for d in numbers)


# Laws of rubber as functions: derivatives that belong together, and the same numbers in numpy and in kernels.

VARIABLE = np.linspace(0.3, 3.0, 50)


@pytest.mark.parametrize("name", RUBBER_LAWS)
def test_the_last_derivative_is_the_slope_of_the_first(name: str) -> None:
    """By central differences, to 1e-7 of the largest."""
    law = RUBBER_LAWS[name]
    values = np.random.default_rng(0).uniform(1.0, 3.0, len(law.coefficients))
    ahead, behind = (law.derivatives(VARIABLE + shift, *values)[0] for shift in (1e-5, -1e-5))
    last = law.derivatives(VARIABLE, *values)[-1]
    np.testing.assert_allclose(np.subtract(ahead, behind) / 2e-5, last, atol=1e-7 * np.abs(last).max() + 1e-9)


@pytest.mark.parametrize("name", RUBBER_LAWS)
def test_tension_begins_with_three_times_the_shear_modulus(name: str) -> None:
    """Of incompressible rubber E = 3 mu; by central differences, to 1e-5."""
    law = RUBBER_LAWS[name]
    given = {one: 2.5 for one in law.names}
    low, high = law.tension(given, np.array([1.0 - 1e-4, 1.0 + 1e-4]))
    assert (high - low) / 2e-4 == pytest.approx(3.0 * law.shear_modulus(given), rel=1e-5)


def test_sum_continues_as_parabola_at_small_stretches() -> None:
    """The slope w' at stretches of 0.04, -0.48 and -1 lies on the tangent at 0.05, to round-off."""
    law = RUBBER_LAWS["ogden"]
    first = np.array([0.04, -0.48, -1.0])
    stress = law.principal_stress({"mu1": 60.0, "alpha1": 1.3}, np.column_stack([first, np.ones(3), np.ones(3)]))
    slope, bend = law.derivatives(SMALLEST_STRETCH, 60.0, 1.3)
    # With the other stretches 1 the stress is w'(s) + w'(1) (s - 2).
    expected = slope + bend * (first - SMALLEST_STRETCH) + 60.0 * (first - 2.0)
    np.testing.assert_allclose(stress[:, 0], expected, rtol=1e-12)


def growth(x: float, rate: float) -> float:
    """A function that a law could have."""
    return rate * np.exp(rate * x)


growth_in_kernels = for_kernels(growth)


@kernel
def fill(x: Scalars, y: Scalars):
    """Fill y with `growth` of x."""
    for i in range(x.shape[0]):
        y[i] = growth_in_kernels(x[i], 0.5)


def test_functions_of_numpy_are_taichis_in_kernels() -> None:
    result = np.zeros_like(VARIABLE)
    fill(VARIABLE, result)
    np.testing.assert_allclose(result, growth(VARIABLE, 0.5), rtol=1e-14)  # type: ignore[arg-type]
