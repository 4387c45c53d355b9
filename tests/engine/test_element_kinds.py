"""Kinds of elements: the names in scenes, constant strains, masses, and the domains of an element's stress."""

from typing import get_args

import numpy as np
import pytest
from blocks import block_hexahedra, make_block

from taichisoft import VolumeMesh
from taichisoft.mechanics import ELEMENT_KINDS
from taichisoft.mesh import SIX_TETRAHEDRA, element_volumes, with_middle_nodes
from taichisoft.scene.soft_body import SoftBodySettings


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
def test_the_stress_of_an_element_is_that_of_domains_with_nodes_of_its_own(name: str) -> None:
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
