"""What feels no force: a rigid motion, and the inside of a body under the same strain everywhere."""

import numpy as np
import pytest
from blocks import make_block
from conftest import Figures, examples
from hypothesis import given
from hypothesis import strategies as st
from scenes import silicone, simulate
from scipy.spatial.transform import Rotation

from taichisoft import Model, VolumeMesh, write_volume_mesh
from taichisoft.mechanics.elasticity import internal_force
from taichisoft.mesh import boundary_triangles

SIZE = (30.0, 20.0, 10.0)
INNER = 8
"""Nodes of the block that are not on its surface."""


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Model]:
    """A block of 162 tetrahedra, its inner nodes shifted by up to a fifth of a cell; with both corotations."""
    mesh = make_block((3, 3, 3), SIZE)
    inner = _inner_nodes(mesh.elements)
    assert len(inner) == INNER
    nodes = mesh.nodes.copy()
    nodes[inner] += np.random.default_rng(1).uniform(-0.2, 0.2, (INNER, 3)) * np.array(SIZE) / 3
    path = tmp_path_factory.mktemp("mesh") / "irregular.msh"
    write_volume_mesh(VolumeMesh("irregular", nodes, mesh.elements).check(), path)
    return {
        corotation: simulate(soft_bodies={"block": silicone(str(path), element="linear", corotation=corotation)}).model
        for corotation in ("edges", "polar")
    }


def _inner_nodes(elements: np.ndarray) -> np.ndarray:
    return np.setdiff1d(np.arange(elements.max() + 1), boundary_triangles(elements))


def _forces(model: Model, position: np.ndarray) -> np.ndarray:
    assert model.elasticity is not None
    return internal_force(model.elasticity, position)


def _inner_and_largest_force(model: Model, deformation: np.ndarray) -> tuple[float, float]:
    """Largest forces at an inner node and at any node [mN] under x = F X."""
    force = np.abs(_forces(model, model.rest_position @ deformation.T))
    return force[_inner_nodes(model.soft_bodies[0].elements)].max(), force.max()


@pytest.mark.parametrize("corotation", ["edges", "polar"])
@examples(50)
@given(seed=st.integers(0, 10**6), angle=st.floats(0, np.pi), shift=st.floats(-1e3, 1e3))
def test_a_rigid_motion_gives_no_force(
    models: dict[str, Model], corotation: str, seed: int, angle: float, shift: float
) -> None:
    """f(R X + t) = 0 for every rotation and shift.

    Tolerance 1e-8 mN: round-off of coordinates of 1e3 mm (1e-13) over cells of 5 mm is a strain of 2e-14, times
    E = 500 kPa on faces of 100 mm^2 gives 1e-9 mN. A strain of 1 % gives 500 mN.
    """
    model = models[corotation]
    axis = np.random.default_rng(seed).normal(size=3)
    turn = Rotation.from_rotvec(axis / np.linalg.norm(axis) * angle).as_matrix()
    assert np.abs(_forces(model, model.rest_position @ turn.T + shift)).max() < 1e-8


@examples(50)
@given(seed=st.integers(0, 10**6), stretch=st.floats(1e-3, 0.3))
def test_affine_patch_with_polar_rotations(models: dict[str, Model], seed: int, stretch: float) -> None:
    """x = F X for any F with strains up to 30 %: every element has the same stress, so no inner node feels a force.

    Tolerance 1e-9 of the largest force: round-off over a strain of 1e-3.
    """
    strain = np.random.default_rng(seed).uniform(-1, 1, (3, 3)) * stretch
    deformation = Rotation.random(rng=np.random.default_rng(seed)).as_matrix() @ (np.eye(3) + strain)
    inner, largest = _inner_and_largest_force(models["polar"], deformation)
    assert inner <= 1e-9 * largest


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_hookes_law(models: dict[str, Model], axis: int) -> None:
    """Stretched by e along one axis and held across: s = (lambda + 2 mu) e along it, lambda e across, no shear.

    The nodes of a face carry its traction times its area, exactly; tolerance 1e-11: round-off over e = 1e-3.
    """
    model, stretch = models["polar"], 1e-3
    young, poisson = 500.0, 0.3
    first = young * poisson / ((1 + poisson) * (1 - 2 * poisson))
    second = young / (2 * (1 + poisson))
    deformation = np.eye(3)
    deformation[axis, axis] += stretch
    force = _forces(model, model.rest_position @ deformation)
    for face in range(3):
        on_face = np.isclose(model.rest_position[:, face], SIZE[face] / 2)
        expected = np.zeros(3)
        expected[face] = -(first + 2 * second * (face == axis)) * stretch * np.prod(SIZE) / SIZE[face]
        np.testing.assert_allclose(force[on_face].sum(axis=0), expected, rtol=1e-11, atol=1e-9)


def test_affine_patch_with_edge_rotations(models: dict[str, Model], figures: Figures) -> None:
    """The same with each element's rotation from its own edges: only for infinitesimal strains.

    Elements of one strain e take rotations that differ by O(e), which cost a force of O(e^2): at e = 1e-4 less
    than 1e-3 of the largest force, and ten times less of it at a tenth of the strain.
    """
    strain = np.random.default_rng(7).uniform(-1, 1, (3, 3))
    share = {}
    for size in (1e-4, 1e-5):
        inner, largest = _inner_and_largest_force(models["edges"], np.eye(3) + size * strain)
        share[size] = inner / largest
    figures.at_most("inner over largest force at a strain of 1e-4", share[1e-4], 1e-3)
    figures.close("its ratio at a tenth of the strain", share[1e-4] / share[1e-5], 10.0, 0.2)
