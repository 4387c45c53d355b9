"""Stress from positions: Hooke's law, the engine's nodal forces, invariance to rotation."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from blocks import make_block
from scipy.spatial.transform import Rotation

from taichisoft.mechanics import ElasticSystem, linear_tetrahedra
from taichisoft.mechanics.elasticity import Elasticity
from taichisoft.scene import lame_parameters
from taichisoft.scene.scene import Time
from taichisoft_outputs.stress import StressLaw, nodal_mean, von_mises

MESH = make_block((2, 2, 3), (20.0, 25.0, 30.0))
YOUNG = np.linspace(300.0, 700.0, len(MESH.elements))
POISSON = np.linspace(0.2, 0.45, len(MESH.elements))
TURN = Rotation.from_euler("xyz", [0.4, -1.1, 2.0]).as_matrix()


def stress_at(position: np.ndarray, **options: Any) -> np.ndarray:
    return StressLaw(MESH.nodes, MESH.elements, POISSON, **options).stress(position, YOUNG)


@pytest.mark.parametrize("polar", [False, True])
def test_rigid_motion_has_no_stress(polar: bool) -> None:
    moved = MESH.nodes @ TURN.T + [10.0, -20.0, 30.0]
    assert np.abs(stress_at(moved, polar=polar)).max() < 1e-10 * YOUNG.max()


@pytest.mark.parametrize("polar", [False, True])
def test_uniaxial_stretch_is_youngs_modulus_times_strain(polar: bool) -> None:
    """A bar stretched by e and thinned by nu e: s_zz = E e, all else 0; turned with the bar, von Mises the same."""
    strain, poisson = 0.01, np.full(len(YOUNG), 0.3)
    stretched = MESH.nodes * (1.0 + strain * np.array([-0.3, -0.3, 1.0]))
    law = StressLaw(MESH.nodes, MESH.elements, poisson, polar=polar)
    stress = law.stress(stretched, YOUNG)
    expected = np.zeros_like(stress)
    expected[:, 2, 2] = YOUNG * strain
    tolerance = 1e-12 * YOUNG.max()
    if not polar:  # edges turn by less than the strain, and the strain in their axes differs by its square
        tolerance = 3.0 * YOUNG.max() * strain**2
    np.testing.assert_allclose(stress, expected, atol=tolerance)
    np.testing.assert_allclose(von_mises(stress), YOUNG * strain, atol=2.0 * tolerance)
    turned = law.stress(stretched @ TURN.T, YOUNG)
    np.testing.assert_allclose(turned, TURN @ stress @ TURN.T, atol=1e-10 * YOUNG.max())


@pytest.mark.parametrize("corotation", ["edges", "polar"])
def test_sums_to_the_nodal_forces_of_the_engine(corotation: str) -> None:
    """f_a = -sum over elements of w s R g_a, to round-off: large and uneven deformation, with a rotation."""
    random = np.random.default_rng(7)
    position = (MESH.nodes + random.normal(0.0, 1.0, MESH.nodes.shape)) @ TURN.T
    system = ElasticSystem(Elasticity([_body(corotation)], Time(step=0.01)))
    system.position[:] = position
    system.assemble()
    stress = stress_at(position, polar=corotation == "polar")
    gradients, volumes = linear_tetrahedra(MESH.nodes, MESH.elements)
    in_world = np.einsum("eij,eaj->eai", system.rotation, gradients[:, 0])
    parts = -volumes[:, :, None] * np.einsum("eij,eaj->eai", stress, in_world)
    total = np.zeros_like(MESH.nodes)
    np.add.at(total, MESH.elements, parts)
    np.testing.assert_allclose(total, system.force, atol=1e-9 * np.abs(total).max())


def test_an_inverted_element_keeps_a_rotation() -> None:
    """Polar rotations are no reflections: mirrored is a strain of -2 along one axis, and von Mises 2 mu |-2|."""
    mirrored = MESH.nodes * [1.0, 1.0, -1.0]
    shear_modulus = lame_parameters(YOUNG, POISSON)[:, 1]
    np.testing.assert_allclose(von_mises(stress_at(mirrored, polar=True)), 4.0 * shear_modulus, rtol=1e-9)


def test_von_mises_of_known_states() -> None:
    """Pure pressure 0; pure shear t: sqrt(3) t; tension s: s."""
    pressure, shear, tension = -5.0 * np.eye(3), np.zeros((3, 3)), np.diag([0.0, 4.0, 0.0])
    shear[0, 1] = shear[1, 0] = 2.0
    found = von_mises(np.stack([pressure, shear, tension]))
    np.testing.assert_allclose(found, [0.0, 2.0 * np.sqrt(3.0), 4.0], atol=1e-12)


def test_nodal_mean_weighs_with_volume() -> None:
    """Two tetrahedra on one face, the second three times as high: shared nodes get (1 v + 5 (3 v)) / 4 v = 4."""
    nodes = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, -3]])
    elements = np.array([[0, 1, 2, 3], [0, 2, 1, 4]])
    means = nodal_mean(np.array([1.0, 5.0]), elements, nodes)
    np.testing.assert_allclose(means, [4.0, 4.0, 4.0, 1.0, 5.0])


def _body(corotation: str) -> Any:
    """What the engine's assembly needs of a soft body."""
    settings = SimpleNamespace(corotation=corotation, rayleigh_stiffness=0.0, rayleigh_mass=0.0, damped_anchors=False)
    return SimpleNamespace(
        settings=settings,
        modes=None,
        nodes=slice(0, len(MESH.nodes)),
        rest_position=MESH.nodes,
        elements=MESH.elements,
        lame=lame_parameters(YOUNG, POISSON),
        node_mass=np.ones(len(MESH.nodes)),
        anchor_stiffness=np.zeros((len(MESH.nodes), 3)),
        domains=None,
        reinforcements=None,
    )
